"""The checksum of an artefact: SHA-256 of its HDF5 part, in the user block in front of it.

A bit that flips on a disk changes numbers without a word of HDF5.  The user block is text and belongs to no program:
every reader of HDF5 looks for the data behind it.
"""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from pathlib import Path

# The smallest that HDF5 allows.
USER_BLOCK = 512
_MARK = b"elastid, SHA-256 of what follows these 512 bytes: "
_PIECE = 1 << 22


def write_checksum(path: Path) -> None:
    """Put the checksum of a finished file into its user block."""
    digest = _digest(path)
    with path.open("r+b") as file:
        file.write(_user_block(digest))


def is_intact(path: Path | str) -> bool:
    """True for a file that is as it was written, or has no checksum. Each version of a file is read once."""
    version = os.stat(path)
    return _is_intact(Path(path), version.st_ino, version.st_size, version.st_mtime_ns)


def has_checksum(path: Path | str) -> bool:
    """True for a file with a checksum: those of older versions have none, nor those whose first bytes are damaged."""
    with Path(path).open("rb") as file:
        return file.read(len(_MARK)) == _MARK


@lru_cache(maxsize=256)
def _is_intact(path: Path, inode: int, size: int, written_ns: int) -> bool:
    with path.open("rb") as file:
        head = file.read(USER_BLOCK)
    return not head.startswith(_MARK) or head == _user_block(_digest(path))


def _user_block(digest: bytes) -> bytes:
    return (_MARK + digest + b"\n").ljust(USER_BLOCK, b"\0")


def _digest(path: Path) -> bytes:
    digest = hashlib.sha256()
    with path.open("rb", buffering=0) as file:
        file.seek(USER_BLOCK)
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest().encode()
