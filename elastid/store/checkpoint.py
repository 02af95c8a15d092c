"""The checkpoint of an interrupted stage: a file for each finished part of its work, which the next run reads."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, MutableMapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from elastid.fit.problem.least_squares import LocalOptimum
from elastid.store.files import write_text
from elastid.store.values import from_json, json_value
from elastid.validation.comparison import Refit

# Types of the parts by their kind in a file.
_TYPES = {"local optimum": LocalOptimum, "refit": Refit}
_KIND_OF = {type_: kind for kind, type_ in _TYPES.items()}


@dataclass(frozen=True, eq=False)
class Checkpoint(MutableMapping[str, Any]):
    """Finished local optima and refits by name, each in a file of the folder that is whole or absent.

    key: hash of everything that they depend on; parts under another key are not there. Numbers are kept to the last
    bit. A part that is absent, damaged or of another key or type is a KeyError.
    """

    folder: Path
    key: str

    def __getitem__(self, name: str) -> Any:
        try:
            content = json.loads(self._path(name).read_text(encoding="utf-8"))
            if content["key"] == self.key and content["sha256"] == _digest(content["value"]):
                return from_json(content["value"], _TYPES[content["kind"]])
        except (OSError, ValueError, TypeError, AttributeError):
            pass
        raise KeyError(name)

    def __setitem__(self, name: str, value: Any) -> None:
        content = {"key": self.key, "kind": _KIND_OF[type(value)], "value": json_value(value, float)}
        write_text(self._path(name), json.dumps(content | {"sha256": _digest(content["value"])}))

    def __delitem__(self, name: str) -> None:
        try:
            self._path(name).unlink()
        except FileNotFoundError:
            raise KeyError(name) from None

    def __iter__(self) -> Iterator[str]:
        names = (unquote(path.stem) for path in sorted(self.folder.glob("*.json")))
        return (name for name in names if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    @property
    def words(self) -> str:
        """Their number, or an empty text."""
        return f"{n} finished parts" if (n := len(self)) else ""

    def _path(self, name: str) -> Path:
        return self.folder / f"{quote(name, safe=' ')}.json"


def _digest(value: Any) -> str:
    """SHA-256 of the fields of a part: a bit that flips in a number leaves valid JSON, and another result."""
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()
