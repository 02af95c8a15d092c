"""Files of a run folder, written whole or not at all and never through a link, and text templates of the package.

A run folder may come from elsewhere. Through a link in it, the program would overwrite, extend or fill files of its
user outside of it. The run folder itself may be a link: its user has named it.
"""

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ELOOP
from pathlib import Path
from typing import Any

from elastid.base.errors import ElastidError


def path_below(run_folder: Path, *names: str) -> Path:
    """Return the path of a file or folder below a run folder; ElastidError if it or a folder above it is a link."""
    path = run_folder
    for name in names:
        path = path / name
        if _is_link(path):
            raise _refusal(path)
    return path


def clear_folder(run_folder: Path, *names: str) -> Path:
    """Remove a folder below a run folder with its files and return its path; ElastidError for a link on the way."""
    path = path_below(run_folder, *names)
    shutil.rmtree(path, ignore_errors=True)
    return path


def open_regular_file(path: str, flags: int) -> int:
    """Open a regular file (for `open`); raise ElastidError for a link, device or pipe."""
    if _is_link(Path(path)) or (Path(path).exists() and not Path(path).is_file()):
        raise _refusal(Path(path))
    try:
        return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        if error.errno == ELOOP or _is_link(Path(path)):  # BSD says EMLINK
            raise _refusal(Path(path)) from None
        raise


def _is_link(path: Path) -> bool:
    return path.is_symlink() or (hasattr(path, "is_junction") and path.is_junction())


def _refusal(path: Path) -> ElastidError:
    return ElastidError(
        "files/folder",
        "is a link or no file, which nothing is written to in a run folder; remove it, or give another with --run",
        path,
    )


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path to write to; it is synced and renamed when the file is complete."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The process number keeps two programs that make the same file from writing into one temporary file.
    temporary = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    temporary.unlink(missing_ok=True)  # a link would be followed
    try:
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        _rename(temporary, path)
        _flush_folder(path.parent)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


RENAME_PAUSES_S = (0.1, 0.2, 0.4, 0.6, 0.7)  # between attempts, 2 s in total


def _rename(temporary: Path, path: Path) -> None:
    """Rename a file; retry while another program, such as a virus scanner, keeps one of the files open (Windows)."""
    for pause in RENAME_PAUSES_S:
        try:
            temporary.replace(path)
            return
        except PermissionError:
            time.sleep(pause)
    temporary.replace(path)


def write_atomically(path: Path, data: bytes) -> None:
    """Write a new file, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def _flush_folder(folder: Path) -> None:
    """Flush the new name of a file to the disk, where the system supports it."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def from_template(template: str, /, **values: Any) -> str:
    """Read a text file of the package, by its path in it, and fill in its $names."""
    from importlib.resources import files  # these two imports would dominate the start of a command
    from string import Template

    return Template((files("elastid") / template).read_text("utf-8")).substitute(values)
