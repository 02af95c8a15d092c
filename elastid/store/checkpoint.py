"""Checkpoint of an interrupted stage: a file for each finished part of its work, which the next run reads."""

import json
from collections.abc import Iterator, MutableMapping
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from elastid.base.files import replacing
from elastid.store.kinds import fields_of, from_json

# Type by the name that is stored in a file.
_TYPES = {
    "LocalOptimum": "elastid.fit.problem.least_squares:LocalOptimum",
    "Refit": "elastid.validation.comparison:Refit",
    "Record": "elastid.record:Record",
    "FrictionRecord": "elastid.friction_record:FrictionRecord",
}


class Checkpoint(MutableMapping[str, Any]):
    """Finished parts by name, each in a file of the folder, which is read at each use.

    key: hash of everything that the parts depend on. Files with another key or type and damaged files are ignored. A
    file is a NumPy archive (JSON, and arrays with all bits), which takes a tenth of the time of HDF5.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key

    def __getitem__(self, name: str) -> Any:
        with suppress(Exception):  # NumPy raises various errors for damaged archives
            with self._path(name).open("rb") as archive, np.load(archive) as file:
                arrays = {entry: file[entry] for entry in file.files}
            part = json.loads(arrays["part"].item(), object_hook=lambda entry: arrays.get(entry.get("array"), entry))
            if part["key"] == self.key:
                return from_json(part["value"], resolve_name(_TYPES[part["type"]]))
        raise KeyError(name)

    def __setitem__(self, name: str, value: Any) -> None:
        arrays = dict[str, Any]()

        def content(value: Any) -> Any:
            if isinstance(value, np.ndarray):
                arrays[entry := f"array {len(arrays)}"] = value
                return {"array": entry}
            return {field.name: getattr(value, field.name) for field in fields_of(type(value))}

        type_ = type(value).__name__
        resolve_name(_TYPES[type_])
        part = json.dumps({"key": self.key, "type": type_, "value": value}, default=content)
        with replacing(self._path(name)) as temporary, temporary.open("wb") as file:
            np.savez(file, part=np.array(part), **arrays)

    def __delitem__(self, name: str) -> None:
        self._path(name).unlink()

    def __iter__(self) -> Iterator[str]:
        return (name for path in sorted(self.folder.glob("*.npz")) if (name := unquote(path.stem)) in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _path(self, name: str) -> Path:
        return self.folder / f"{quote(name, safe=' ')}.npz"
