"""The checkpoint of an interrupted stage: a file for each finished part of its work, which the next run reads."""

from __future__ import annotations

import hashlib
import json
from collections import UserDict
from contextlib import suppress
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


class Checkpoint(UserDict[str, Any]):
    """Finished local optima and refits by name, each in a file of the folder that is whole or absent.

    key: hash of everything that they depend on; parts under another key are not there. Numbers are kept to the last
    bit. A part that is damaged or of another key or type is not there either.
    """

    def __init__(self, folder: Path, key: str) -> None:
        super().__init__()
        self.folder, self.key = folder, key
        for path in sorted(folder.glob("*.json")):
            with suppress(OSError, ValueError, TypeError, AttributeError, KeyError):
                content = json.loads(path.read_text(encoding="utf-8"))
                if content["key"] == key and content["sha256"] == _digest(content["value"]):
                    super().__setitem__(unquote(path.stem), from_json(content["value"], _TYPES[content["kind"]]))

    def __setitem__(self, name: str, value: Any) -> None:
        content = {"key": self.key, "kind": _KIND_OF[type(value)], "value": json_value(value, float)}
        path = self.folder / f"{quote(name, safe=' ')}.json"
        write_text(path, json.dumps(content | {"sha256": _digest(content["value"])}))
        super().__setitem__(name, value)

    @property
    def words(self) -> str:
        """Their number, or an empty text."""
        return f"{n} finished parts" if (n := len(self)) else ""


def _digest(value: Any) -> str:
    """SHA-256 of the fields of a part: a bit that flips in a number leaves valid JSON, and another result."""
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()
