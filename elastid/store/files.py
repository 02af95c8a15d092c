"""Files of a run folder: whole or absent, with checksums that a damaged disk is noticed by, and with one writer.

An artefact carries the SHA-256 of its HDF5 part in the user block in front of it, which is text and belongs to no
program: every reader of HDF5 looks for the data behind it.  The checksums of texts, pages and figures are in
checksums.sha256, as `sha256sum --check` reads them: a bit that flips in summary.json would change a number that a fleet
or another program reads, and one in references/*.csv a motion of the robot.

The lock is taken back by the system when its owner ends, however it ends.  Its file names the owner, for the message
that a second writer gets.  The library filelock (4.2) would not make this shorter: it neither names the owner nor hands
out the open file to write the name to, leaves its file in the folder, and follows rules of its own for links.
"""

import csv
import hashlib
import json
import os
import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, BinaryIO, TextIO, TypeVar

from elastid.base.errors import ElastidError
from elastid.base.escape import csv_cell
from elastid.base.files import open_regular_file, replacing, write_atomically

T = TypeVar("T")

# The smallest that HDF5 allows.
USER_BLOCK = 512
_MARK = b"elastid, SHA-256 of what follows these 512 bytes: "
CHECKSUMS = "checksums.sha256"
LOCK = ".lock"


@contextmanager
def text_file(path: Path | str) -> Iterator[TextIO]:
    """Open a new text file; it takes its name only when it is complete and on the disk."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        yield file


def write_text(path: Path, text: str) -> None:
    """Write a new text file, whole or absent."""
    write_atomically(path, text.encode())


def write_rows(path: Path, rows: Iterable[Iterable[Any]]) -> Path:
    """Write a new CSV file at a path, its cells as spreadsheets take them (`csv_cell`)."""
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


def once_per_version(check: Callable[[Path], T]) -> Callable[[Path | str], T]:
    """Return a check of a file that is made once for each version of it: results are opened often."""
    cached_check = lru_cache(maxsize=256)(lambda path, inode, size, written_ns: check(path))

    @wraps(check)
    def checked(path: Path | str) -> T:
        version = os.stat(path)
        return cached_check(Path(path), version.st_ino, version.st_size, version.st_mtime_ns)

    return checked


@once_per_version
def is_intact(path: Path) -> bool:
    """Return True for a file that is as it was written, or has no checksum."""
    with path.open("rb") as file:
        head = file.read(USER_BLOCK)
    return not head.startswith(_MARK) or head == _user_block(path)


def has_checksum(path: Path | str) -> bool:
    """Return True for a file with a checksum, which files of older versions and files with damaged first bytes lack."""
    with Path(path).open("rb") as file:
        return file.read(len(_MARK)) == _MARK


def _user_block(path: Path) -> bytes:
    with path.open("rb", buffering=0) as file:
        file.seek(USER_BLOCK)
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return (_MARK + digest.encode() + b"\n").ljust(USER_BLOCK, b"\0")


def changed_texts(folder: Path, names: Iterable[str]) -> tuple[str, ...]:
    """Return the files that have changed since `keep_checksums`; a file without a checksum has not.

    names: of files, of folders, or patterns such as `references/*.csv`, relative to the folder.
    """
    hashes = _checksums(folder)
    return tuple(
        name for name in _files(folder, names) if name in hashes and hashes[name] != content_hash(folder / name)
    )


def is_as_written(path: Path) -> bool | None:
    """Tell if a file of a run folder is as it was at `keep_checksums`; None for a file without a checksum."""
    path = path.resolve()
    for folder in path.parents[:2]:  # a run folder and those in it: figures, references
        if (digest := _checksums(folder).get(path.relative_to(folder).as_posix())) is not None:
            return digest == content_hash(path)
    return None


def keep_checksums(folder: Path, names: Iterable[str]) -> None:
    """Save checksums of the existing files, and delete entries of removed files. names: as for `changed_texts`."""
    hashes = _checksums(folder)
    current = {name: digest for name, digest in hashes.items() if (folder / name).is_file()}
    current |= {name: content_hash(folder / name) for name in _files(folder, names)}
    if current != hashes:
        with text_file(folder / CHECKSUMS) as file:
            file.writelines(f"{current[name]}  {name}\n" for name in sorted(current))


def remove_texts(folder: Path, names: Iterable[str]) -> None:
    """Remove the files that are unchanged since `keep_checksums`. names: as for `changed_texts`."""
    for path in [folder / name for name in _files(folder, names) if is_as_written(folder / name)]:
        path.unlink()


def _checksums(folder: Path) -> dict[str, str]:
    """Return checksum by name; a damaged line names no file, or reports an intact file as changed."""
    path = folder / CHECKSUMS
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines) if name and "\0" not in name}


def _files(folder: Path, names: Iterable[str]) -> Iterator[str]:
    for name in names:
        for path in sorted(folder.glob(name)):
            inside = sorted(path.rglob("*")) if path.is_dir() else [path]
            yield from (file.relative_to(folder).as_posix() for file in inside if file.is_file())


def content_hash(path: Path) -> str:
    """Return SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock the folder, made where it is missing, for this program alone; ElastidError names who writes in it already.

    ElastidError, too, where it is a file, or the file of the lock is a link. On a disk whose system knows no locks
    it is not guarded. Temporary files of a killed writer are removed.
    """
    if folder.exists() and not folder.is_dir():
        raise ElastidError("files/folder", f"{folder} is a file, and results go into a folder: give another one")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    with _locked(path) as file:
        file.seek(0)
        file.truncate()
        since = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"
        file.write(json.dumps({"process": os.getpid(), "host": socket.gethostname(), "since": since}).encode())
        file.flush()
        remove_leftovers(folder)
        try:
            yield
        finally:
            if os.name == "posix":  # elsewhere an open file cannot be removed
                path.unlink(missing_ok=True)
    if os.name != "posix":
        with suppress(OSError):  # another program has it by now
            path.unlink(missing_ok=True)


@contextmanager
def _locked(path: Path) -> Iterator[BinaryIO]:
    while True:
        with open(path, "a+b", opener=open_regular_file) as file:
            if not _lock(file):
                raise ElastidError("files/folder", _refusal(path))
            # Between opening and locking, the owner may have removed it.
            if os.path.lexists(path) and os.path.samestat(os.fstat(file.fileno()), path.lstat()):
                yield file
                return


def _lock(file: BinaryIO) -> bool:
    """Return True if the lock was free; it then lasts until the file is closed."""
    try:
        if os.name == "posix":
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            import msvcrt

            # Windows keeps others from reading a locked byte: this one is far behind the owner's name.
            file.seek(1 << 20)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        pass  # a disk without locks
    return True


def _refusal(path: Path) -> str:
    try:
        owner = json.loads(path.read_bytes())
        owner_text = f"process {owner['process']} on {owner['host']} has been writing there since {owner['since']}"
    except (OSError, ValueError, TypeError, KeyError):
        owner_text = "another elastid is writing there"
    return f"{path.parent}: {owner_text}; wait until it has ended, or give another folder with --run"
