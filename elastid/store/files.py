"""Files that are whole or absent, and the HDF5 idioms of every layout."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, TextIO

import h5py
import numpy as np

from elastid.base.errors import DataError, ElastidError
from elastid.base.escape import group_name
from elastid.base.mapped import PIECE_VALUES, release
from elastid.base.note import Note
from elastid.base.own_data import require_own_data
from elastid.store.checksum import USER_BLOCK, is_intact, write_checksum
from elastid.store.disk import DiskFile

# Version of the layout of all artefacts; raised where a reader of before could not read or would misread a file.
FORMAT = 1
_TEXT = h5py.string_dtype()


@dataclass(frozen=True)
class Stamp:
    """Provenance of an artefact: hashes of its inputs and of the code that made it, and the text of the study.

    inputs: hash of the sections of the study, of files and of earlier artefacts.  code: hash of the package's source
    and of the versions of the libraries that results depend on.  software: these versions and the platform, in words.
    Date and command are in run.log: the same study gives the same bytes.
    """

    inputs: str = ""
    code: str = ""
    version: str = ""
    seed: int = 0
    study: str = ""
    software: str = ""

    @property
    def shown(self) -> dict[str, str]:
        """What a page says of it."""
        return {
            "made by": self.software or f"elastid {self.version}",
            "seed": str(self.seed),
            "hash of the inputs": self.inputs,
            "hash of the code": self.code,
        }

    def is_of(self, wanted: Stamp) -> bool:
        """Whether inputs and code are those of another stamp."""
        return (self.inputs, self.code) == (wanted.inputs, wanted.code)


NO_STAMP = Stamp()


@contextmanager
def created(path: Path | str, kind: str, stamp: Stamp) -> Iterator[Any]:
    """A new HDF5 file to fill; it takes its name only when it is complete and on the disk."""
    with replacing(path) as temporary:
        with DiskFile(temporary) as disk, h5py.File(disk, "w", userblock_size=USER_BLOCK) as file:
            file.attrs["elastid"] = kind
            file.attrs["format"] = FORMAT
            provenance = file.create_group("provenance")
            for name, value in asdict(stamp).items():
                if name == "study":  # an attribute holds 64 KB at most
                    provenance.create_dataset(name, data=value, dtype=_TEXT)
                else:
                    provenance.attrs[name] = value
            yield file
        write_checksum(temporary)


@contextmanager
def text_file(path: Path | str) -> Iterator[TextIO]:
    """A new text file; it takes its name only when it is complete and on the disk."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        yield file


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Another path to write to; the file takes its name only when it is complete and on the disk."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Its own name, so that two programs that make the same file do not write into each other's.
    temporary = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
        _flush_folder(path.parent)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


def _flush_folder(folder: Path) -> None:
    """Have the new name of a file on the disk, too, where the system can do that."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of a killed run."""
    for temporary in [*folder.glob(".*.unfinished"), *folder.glob(".*.part")]:
        temporary.unlink(missing_ok=True)


@contextmanager
def opened(path: Path | str, kind: str) -> Iterator[Any]:
    """An artefact, read-only; DataError where it is missing, changed, truncated, damaged or of another kind."""
    path = Path(path)
    if path.is_dir():
        raise DataError(f"{path}: is a folder; name one of the files in it")
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    # Before HDF5 looks at it: some damages end the process there.
    if not is_intact(path):
        raise DataError(f"{path}: its content has changed since it was written; delete it and run again")
    try:
        with h5py.File(path, "r") as file:
            _require_kind(path, file, kind)
            yield file
    except (ElastidError, MemoryError):
        raise
    except OSError as error:
        raise DataError(
            f"{path}: not a readable HDF5 file ({_first_line(error)}); name one that elastid has written; if it "
            "was one, it is damaged: delete it and run again"
        ) from None
    except Exception as error:  # what a damaged file makes h5py and NumPy raise
        raise DataError(
            f"{path}: damaged, or of an older layout ({_first_line(error)}); delete it and run again"
        ) from error


def _require_kind(path: Path, file: Any, kind: str) -> None:
    """DataError of an artefact of another kind, or of a later format than this."""
    _require_own_data(path)
    found, written = _plain(file.attrs.get("elastid")), _plain(file.attrs.get("format", 0))
    if found != kind:
        holds = f"holds {found}" if found else "was not written by elastid"
        raise DataError(f"{path}: {holds}, expected {kind}; name another; `elastid inspect` shows what a file holds")
    if written > FORMAT:
        raise DataError(
            f"{path}: format {written}, written by a newer elastid; this one reads up to {FORMAT}: update it, or "
            "delete the file and run again"
        )


def _require_own_data(path: Path) -> None:
    """`require_own_data`, of each version of a file once: results have thousands of members, and are opened often."""
    found = os.stat(path)
    _search_for_foreign_data(path, found.st_ino, found.st_size, found.st_mtime_ns)


@lru_cache(maxsize=256)
def _search_for_foreign_data(path: Path, inode: int, size: int, written_ns: int) -> None:
    with h5py.File(path, "r") as file:
        require_own_data(file)


def read_stamp(path: Path | str) -> Stamp | None:
    """Provenance of an artefact; None where it is missing, truncated or foreign."""
    try:
        if not is_intact(Path(path)):
            return None
        with h5py.File(path, "r") as file:
            attributes = {name: _plain(value) for name, value in file["provenance"].attrs.items()}
            attributes["study"] = file["provenance/study"].asstr()[()]
    except Exception:  # what a damaged file makes h5py raise
        return None
    known = {field.name for field in fields(Stamp)}
    return Stamp(**attributes) if {"inputs", "code"} <= set(attributes) <= known else None


def scale(group: Any, name: str, values: Sequence[Any] | np.ndarray[Any, Any], long_name: str, units: str = "") -> Any:
    """A dimension scale: an axis with its values, texts or numbers."""
    dataset = _dataset(group, name, values)
    dataset.make_scale(name)
    _label(dataset, long_name, units)
    return dataset


def variable(group: Any, name: str, values: Any, axes: Sequence[Any], long_name: str, units: str = "") -> None:
    """An array on named axes, each a scale."""
    dataset = _dataset(group, name, values)
    for dimension, axis in zip(dataset.dims, axes, strict=True):
        dimension.attach_scale(axis)
        dimension.label = axis.name.rsplit("/", 1)[-1]
    _label(dataset, long_name, units)


def _dataset(group: Any, name: str, values: Any) -> Any:
    """A dataset of texts or numbers; an array that is kept in a file is copied in pieces."""
    if isinstance(values, tuple | list) and (not values or isinstance(values[0], str)):
        return group.create_dataset(name, data=list(values), dtype=_TEXT)
    if not isinstance(values, np.memmap):
        return group.create_dataset(name, data=values)
    dataset = group.create_dataset(name, values.shape, values.dtype)
    rows = max(1, PIECE_VALUES * len(values) // values.size)
    for first in range(0, len(values), rows):
        dataset[first : first + rows] = values[first : first + rows]
        release(values)
    return dataset


def _label(dataset: Any, long_name: str, units: str) -> None:
    dataset.attrs["long_name"] = long_name
    if units:
        dataset.attrs["units"] = units


def texts(group: Any, name: str) -> tuple[str, ...]:
    """A dataset of texts."""
    return tuple(group[name].asstr()[:].tolist())


def attributes(group: Any) -> dict[str, Any]:
    """The attributes of a group as plain numbers and texts."""
    return {name: _plain(value) for name, value in group.attrs.items()}


def attribute(group: Any, name: str) -> Any:
    """One attribute of a group alone: a reader of many values need not read all of them for each."""
    return _plain(group.attrs[name])


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


# A name as that of a group.
key = group_name


def _first_line(error: Exception) -> str:
    return str(error).strip("'\"").splitlines()[0] if str(error) else type(error).__name__


def write_notes(group: Any, notes: Sequence[Note]) -> None:
    """The notes of a value: their texts as an axis, and code, severity and place of each along it."""
    axis = scale(group, "note", [note.text for note in notes], "text of a note")
    for field, meaning in (("code", "kind of the note"), ("severity", "severity"), ("place", "place it is about")):
        variable(group, f"note_{field}", [getattr(note, field) for note in notes], [axis], meaning)


def read_notes(group: Any) -> tuple[Note, ...]:
    """The notes of a value."""
    columns = (texts(group, name) for name in ("note_code", "note", "note_place", "note_severity"))
    return tuple(
        Note(code, text, place, "warning" if severity == "warning" else "information")
        for code, text, place, severity in zip(*columns, strict=True)
    )


def write_sliding(group: Any, places: tuple[str, ...]) -> None:
    """The inputs and outputs that translate."""
    scale(group, "sliding", places, "inputs and outputs that translate: N and m instead of N*m and rad")


def read_sliding(group: Any) -> tuple[str, ...]:
    """The inputs and outputs that translate."""
    return texts(group, "sliding")


def write_input_units(group: Any, units: tuple[str, ...]) -> None:
    """The unit of each input, where one is a voltage or a current."""
    scale(group, "input_units", units, "unit of each input, where one is neither torque nor force")


def read_input_units(group: Any) -> tuple[str, ...]:
    """The unit of each input, where one is a voltage or a current; of none in a file without them."""
    return texts(group, "input_units") if "input_units" in group else ()


def kind_of(path: Path | str) -> str | None:
    """The kind of artefact in a file; None where it is none of elastid."""
    try:
        with h5py.File(path, "r") as file:
            kind = file.attrs.get("elastid")
    except Exception:  # no HDF5, or so damaged that h5py raises anything
        return None
    return kind if isinstance(kind, str) else None
