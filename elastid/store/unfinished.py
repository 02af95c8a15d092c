"""What a stopped stage had finished: a file for each part of its work, so that the next run goes on from there."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, MutableMapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from elastid.fit.result import LocalOptimum
from elastid.fit.uncertainty.profile import Profile
from elastid.store.files import text_file
from elastid.validation.results import LeftOut, Refit

_READ: dict[str, Callable[[dict[str, Any]], Any]] = {
    "LocalOptimum": lambda document: LocalOptimum(**document),
    "Profile": lambda document: Profile(
        document["name"],
        tuple(document["interval"]),
        np.array(document["x"]),
        np.array(document["cost"]),
    ),
    "Refit": lambda document: Refit(
        **document | {"left_out": {name: LeftOut(**score) for name, score in document["left_out"].items()}}
    ),
}

# Names begin with what they are.
_WORDS = {
    "start": ("start", "starts"),
    "polished": ("of them polished", "of them polished"),
    "profile": ("profile", "profiles"),
    "bootstrap": ("repetition of the bootstrap", "repetitions of the bootstrap"),
    "refit": ("fit", "fits"),
}


@dataclass(frozen=True, eq=False)
class Finished(MutableMapping[str, Any]):
    """Starts, profiles and refits by name, each in a file of the folder that is whole or absent.

    key: what they all hang on; what was finished under another key is not there. Numbers come back to the last bit.
    """

    folder: Path
    key: str

    def __getitem__(self, name: str) -> Any:
        """What is finished; KeyError where it is not."""
        try:
            content = json.loads(self._path(name).read_text(encoding="utf-8"))
            if content["key"] == self.key:
                return _READ[content["kind"]](content["value"])
        except (OSError, ValueError, TypeError):
            pass
        raise KeyError(name)

    def __setitem__(self, name: str, value: Any) -> None:
        """Keep what is finished."""
        content = {"key": self.key, "kind": type(value).__name__, "value": asdict(value)}
        with text_file(self._path(name)) as file:
            json.dump(content, file, default=_plain)

    def __delitem__(self, name: str) -> None:
        """Forget it."""
        try:
            self._path(name).unlink()
        except FileNotFoundError:
            raise KeyError(name) from None

    def __iter__(self) -> Iterator[str]:
        """The names of what is there."""
        names = (unquote(path.stem) for path in sorted(self.folder.glob("*.json")))
        return (name for name in names if name in self)

    def __len__(self) -> int:
        """How much is there."""
        return sum(1 for _ in self)

    @property
    def words(self) -> str:
        """How much of what is there: `12 starts, 1 profile`; empty where there is nothing."""
        counts = Counter(name.partition("-")[0] for name in self)
        return ", ".join(f"{n} {words[n > 1]}" for kind, words in _WORDS.items() if (n := counts[kind]))

    def clear(self) -> None:
        """Forget everything, also what was finished under other keys or not at all."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, name: str) -> Path:
        return self.folder / f"{quote(name, safe=' ')}.json"


def _plain(value: Any) -> Any:
    """Arrays as lists: JSON writes the shortest text that reads back as the same number, as Python knows infinity."""
    return value.tolist()
