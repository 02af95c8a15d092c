"""Artefacts: HDF5 files with provenance; damaged files and files of other programs are rejected.

HDF5 cannot close a file that it cannot write: on a full disk it tries again at the end of the process, which crashes.
Therefore `DiskFile` keeps the first error until the file is closed, and reports success to HDF5.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from elastid.base.errors import DataError, ElastidError, StudyError
from elastid.base.files import replacing
from elastid.base.hdf5_check import check_self_contained
from elastid.store.files import USER_BLOCK, is_intact, once_per_version, write_checksum

FORMAT = 12  # version of the layout of all artefacts; a reader accepts its own version only
TEXT = h5py.string_dtype()


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
    def entries(self) -> dict[str, str]:
        """Entries of the stamp on a page, by heading."""
        hashes = {"hash of the inputs": self.inputs, "hash of the code": self.code}
        return {"made by": self.software or f"elastid {self.version}", "seed": str(self.seed), **hashes}

    def matches(self, other: "Stamp") -> bool:
        """Return True if another stamp has the same inputs and code."""
        return (self.inputs, self.code) == (other.inputs, other.code)


NO_STAMP = Stamp()


@contextmanager
def create_artefact(path: Path | str, kind: str, stamp: Stamp) -> Iterator[Any]:
    """Open a new HDF5 file; it appears under its name when it is complete and on the disk."""
    with replacing(path) as temporary:
        with DiskFile(temporary) as disk, h5py.File(disk, "w", userblock_size=USER_BLOCK) as file:
            file.attrs["elastid"] = kind
            file.attrs["format"] = FORMAT
            provenance = file.create_group("provenance")
            for name, value in asdict(stamp).items():
                if name == "study":
                    provenance.create_dataset(name, data=value, dtype=TEXT)
                else:
                    provenance.attrs[name] = value
            yield file
        write_checksum(temporary)


@contextmanager
def open_artefact(path: Path | str, kind: str) -> Iterator[Any]:
    """Open an artefact read-only; StudyError if it is missing or of another kind, DataError if it is damaged."""
    path = Path(path)
    if path.is_dir():
        raise StudyError("files/kind", "is a folder; name one of the files in it", path)
    if not path.is_file():
        raise StudyError("files/missing", "no such file", path)
    # Before HDF5 opens it, since some kinds of damage end the process.
    if not is_intact(path):
        raise DataError("files/damaged", "its content has changed since it was written; delete it and run again", path)
    try:
        with h5py.File(path, "r") as file:
            _require_kind(path, file, kind)
            yield file
    except (ElastidError, MemoryError):
        raise
    except Exception as error:  # h5py and NumPy raise various errors for damaged files
        why = (str(error).strip("'\"") or type(error).__name__).splitlines()[0]
        text = f"no HDF5 file of elastid, damaged, or of an older layout ({why}); name another, or make it again"
        raise DataError("files/damaged", text, path) from error


def _require_kind(path: Path, file: Any, kind: str) -> None:
    _check_self_contained(path)
    file_kind, version = plain(file.attrs.get("elastid")), plain(file.attrs.get("format", 0))
    if file_kind != kind:
        content = f"holds {file_kind}" if file_kind else "was not written by elastid"
        text = f"{content}, expected {kind}; name another; `elastid inspect {path}` shows its content"
        raise StudyError("files/kind", text, path)
    if version != FORMAT:
        raise DataError(
            "files/version",
            f"format {version}, written by {'a newer' if version > FORMAT else 'an older'} elastid; this one reads "
            f"format {FORMAT}: update it, or delete the file and run its stage again",
            path,
        )


@once_per_version
def _check_self_contained(path: Path) -> None:
    with h5py.File(path, "r") as file:
        check_self_contained(file)


def read_stamp(path: Path | str) -> Stamp | None:
    """Return the provenance of an artefact; None if the file is missing, damaged or of another program."""
    try:
        if not is_intact(Path(path)):
            return None
        with h5py.File(path, "r") as file:
            attributes = {name: plain(value) for name, value in file["provenance"].attrs.items()}
            attributes["study"] = file["provenance/study"].asstr()[()]
    except Exception:  # h5py raises various errors for damaged files
        return None
    names = {field.name for field in fields(Stamp)}
    return Stamp(**attributes) if {"inputs", "code"} <= set(attributes) <= names else None


def plain(value: Any) -> Any:
    """Convert a NumPy number to a Python number."""
    return value.item() if isinstance(value, np.generic) else value


def kind_of(path: Path | str) -> str | None:
    """Return the kind of artefact in a file; None for other files."""
    try:
        with h5py.File(path, "r") as file:
            kind = file.attrs.get("elastid")
    except Exception:  # not HDF5, or damaged
        return None
    return kind if isinstance(kind, str) else None


class DiskFile(io.FileIO):
    """New binary file for HDF5; after an error nothing more is written, and `close` raises the error."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all bytes, or none after an error; return their number in any case."""
        remaining = memoryview(data).cast("B")
        total = len(remaining)
        try:
            while self._error is None and len(remaining):
                remaining = remaining[super().write(remaining) :]
        except OSError as error:
            self._error = error
        return total

    def readinto(self, buffer: Any) -> int:
        """Read written bytes, and zeros after the end of the file."""
        view = memoryview(buffer).cast("B")
        count = super().readinto(view) or 0
        view[count:] = bytes(len(view) - count)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Change the size of the file."""
        try:
            return 0 if self._error is not None else super().truncate(size)
        except OSError as error:
            self._error = error
            return 0

    def close(self) -> None:
        """Close the file; raise the first OSError of writing."""
        error, self._error = self._error, None
        super().close()
        if error is not None:
            raise error
