"""Lock of a run folder: one writer at a time.

The system releases the lock when its owner ends, however it ends. The lock file names the owner, for the message to a
second writer. The library filelock (4.2) would not make this shorter: it neither names the owner nor gives access to
the open file, leaves its file in the folder, and treats links differently.
"""

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from elastid.base.errors import ElastidError
from elastid.base.files import open_regular_file
from elastid.store.files import remove_leftovers

LOCK = ".lock"


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Make a folder and lock it for this process; ElastidError with the name of another writer.

    Also ElastidError if the folder is a file or the lock file a link. A file system without locks is not protected.
    Removes temporary files of a killed writer.
    """
    if folder.exists() and not folder.is_dir():
        raise ElastidError("files/folder", f"{folder} is a file, and results go into a folder: give another one")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    with _locked_file(path) as file:
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
        with suppress(OSError):  # another process may have locked it meanwhile
            path.unlink(missing_ok=True)


@contextmanager
def _locked_file(path: Path) -> Iterator[BinaryIO]:
    while True:
        with open(path, "a+b", opener=open_regular_file) as file:
            if not _lock(file):
                raise ElastidError("files/folder", _refusal(path))
            # Between opening and locking, its owner may have removed the file.
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

            # Windows prevents reading of a locked byte, so the byte is far after the name of the owner.
            file.seek(1 << 20)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        pass  # a file system without locks
    return True


def _refusal(path: Path) -> str:
    try:
        owner = json.loads(path.read_bytes())
        owner_text = f"process {owner['process']} on {owner['host']} has been writing there since {owner['since']}"
    except (OSError, ValueError, TypeError, KeyError):
        owner_text = "another elastid is writing there"
    return f"{path.parent}: {owner_text}; wait until it has ended, or give another folder with --run"
