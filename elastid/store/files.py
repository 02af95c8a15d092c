"""Text files of a run folder, written whole or not at all, and checksums of all its files, by which damage is detected.

The checksum (SHA-256) of an artefact is in its user block, which every reader of HDF5 skips. The checksums of texts,
pages and figures are in checksums.sha256, for `sha256sum --check`: a flipped bit in summary.json would change a number
that other programs read, and one in references/*.csv a motion of the robot.
"""

import csv
import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from operator import attrgetter
from pathlib import Path
from typing import Any, TextIO, TypeVar, cast

from elastid.base.escape import csv_cell
from elastid.base.files import replacing, write_atomically

Check = TypeVar("Check", bound=Callable[..., Any])
_VERSION = attrgetter("st_ino", "st_size", "st_mtime_ns")

USER_BLOCK = 512  # bytes, the least size in HDF5
_MARK = b"elastid, SHA-256 of what follows these 512 bytes: "
CHECKSUMS = "checksums.sha256"


@contextmanager
def text_file(path: Path | str) -> Iterator[TextIO]:
    """Open a new text file; it appears under its name when it is complete and on the disk."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        yield file


def write_text(path: Path, text: str) -> None:
    """Write a new text file, whole or not at all."""
    write_atomically(path, text.encode())


def write_rows(path: Path, rows: Iterable[Iterable[Any]]) -> Path:
    """Write a new CSV file with the cells of `csv_cell`; return its path."""
    with text_file(path) as file:
        csv.writer(file, lineterminator="\n").writerows(map(csv_cell, row) for row in rows)
    return path


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of a killed run."""
    for temporary in folder.glob(".*.unfinished"):
        temporary.unlink(missing_ok=True)


def write_checksum(path: Path) -> None:
    """Put the checksum of a finished file into its user block."""
    block = _user_block(path)
    with path.open("r+b") as file:
        file.write(block)


def once_per_version(check: Check) -> Check:
    """Make a function of a file and further values run once for each version of the file."""
    cached_check = lru_cache(maxsize=64)(lambda version, *arguments: check(*arguments))

    @wraps(check)
    def checked(path: Path | str, *others: Any) -> Any:
        path = Path(path)
        return cached_check(path.exists() and _VERSION(path.stat()), path, *others)  # `check` reports a missing file

    return cast(Check, checked)


@once_per_version
def is_intact(path: Path) -> bool:
    """Return True for a file that is unchanged or has no checksum."""
    with path.open("rb") as file:
        head = file.read(USER_BLOCK)
    return not head.startswith(_MARK) or head == _user_block(path)


def has_checksum(path: Path | str) -> bool:
    """Return True for a file with a checksum; an older version writes no checksum, and damage can delete it."""
    with Path(path).open("rb") as file:
        return file.read(len(_MARK)) == _MARK


def _user_block(path: Path) -> bytes:
    return (_MARK + content_hash(path, USER_BLOCK).encode() + b"\n").ljust(USER_BLOCK, b"\0")


def changed_texts(folder: Path, names: Iterable[str]) -> tuple[str, ...]:
    """Return the files with a checksum that have changed since `save_checksums`.

    names: files, folders or patterns such as `references/*.csv`, relative to the folder.
    """
    hashes = _checksums(folder)
    return tuple(
        name for name in _files(folder, names) if name in hashes and hashes[name] != content_hash(folder / name)
    )


def is_as_written(path: Path) -> bool | None:
    """Return True if a file of a run folder is unchanged since `save_checksums`; None without a checksum."""
    path = path.resolve()
    for folder in path.parents[:2]:  # the run folder, or one that contains figures or references
        if (digest := _checksums(folder).get(path.relative_to(folder).as_posix())) is not None:
            return digest == content_hash(path)
    return None


def save_checksums(folder: Path, names: Iterable[str]) -> None:
    """Save checksums of the existing files, and delete entries of removed files. names: as for `changed_texts`."""
    hashes = _checksums(folder)
    current = {name: digest for name, digest in hashes.items() if (folder / name).is_file()}
    current |= {name: content_hash(folder / name) for name in _files(folder, names)}
    if current != hashes:
        with text_file(folder / CHECKSUMS) as file:
            file.writelines(f"{current[name]}  {name}\n" for name in sorted(current))


def remove_texts(folder: Path, names: Iterable[str]) -> None:
    """Remove the files that are unchanged since `save_checksums`. names: as for `changed_texts`."""
    for path in [folder / name for name in _files(folder, names) if is_as_written(folder / name)]:
        path.unlink()


def _checksums(folder: Path) -> dict[str, str]:
    """Return the checksum by name; a damaged line names no file, or an intact file seems to have changed."""
    path = folder / CHECKSUMS
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines) if name and "\0" not in name}


def _files(folder: Path, names: Iterable[str]) -> Iterator[str]:
    for name in names:
        for path in sorted(folder.glob(name)):
            inside = sorted(path.rglob("*")) if path.is_dir() else [path]
            yield from (file.relative_to(folder).as_posix() for file in inside if file.is_file())


def content_hash(path: Path, start: int = 0) -> str:
    """Return the SHA-256 of a file from a byte on."""
    with path.open("rb", buffering=0) as file:
        file.seek(start)
        return hashlib.file_digest(file, "sha256").hexdigest()
