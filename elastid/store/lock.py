"""One writer for a run folder: a lock that the system takes back when its owner ends, however it ends.

The file names the owner, for the message that a second writer gets; a file that a killed run left has no lock on it.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from elastid.base.errors import ElastidError
from elastid.base.files import unlinked

LOCK = ".lock"
# Windows locks bytes, and keeps others from reading those: the locked byte is far behind the owner's name.
_BYTE = 1 << 20


@contextmanager
def one_writer(folder: Path) -> Iterator[None]:
    """The folder, made where it is missing, for this program alone; ElastidError names who writes in it already.

    ElastidError, too, where the file of the lock is a link.

    On a disk whose system knows no locks it is not guarded.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    with _locked(path) as file:
        file.seek(0)
        file.truncate()
        file.write(json.dumps(_this_program()).encode())
        file.flush()
        try:
            yield
        finally:
            if os.name == "posix":  # elsewhere an open file cannot be removed
                path.unlink(missing_ok=True)
    if os.name != "posix":
        _remove(path)


@contextmanager
def _locked(path: Path) -> Iterator[BinaryIO]:
    """The locked file, which is still the one of that name."""
    while True:
        with open(path, "a+b", opener=unlinked) as file:
            if not _lock(file):
                raise ElastidError(_refusal(path))
            # Between opening and locking, the owner may have removed it.
            if os.path.lexists(path) and os.path.samestat(os.fstat(file.fileno()), path.lstat()):
                yield file
                return


def _lock(file: BinaryIO) -> bool:
    """True where the lock was free; it is held then until the file is closed."""
    try:
        if os.name == "posix":
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            import msvcrt

            file.seek(_BYTE)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        pass  # a disk without locks
    return True


def _this_program() -> dict[str, str | int]:
    return {"process": os.getpid(), "host": socket.gethostname(), "since": f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"}


def _refusal(path: Path) -> str:
    try:
        owner = json.loads(path.read_text(encoding="utf-8"))
        who = f"process {owner['process']} on {owner['host']} has been writing there since {owner['since']}"
    except (OSError, ValueError, TypeError, KeyError):
        who = "another elastid is writing there"
    return f"{path.parent}: {who}; wait until it has ended, or give another folder with --run"


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return  # another program has it by now
