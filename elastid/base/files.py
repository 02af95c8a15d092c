"""Files and folders below a run folder, none of which is reached through a symbolic link.

A run folder may come from elsewhere. Through a link in it, the program would overwrite, extend or fill files of its
user outside of it. The run folder itself may be a link: its user has named it.
"""

from __future__ import annotations

import os
import shutil
from errno import ELOOP
from pathlib import Path

from elastid.base.errors import ElastidError


def own_path(run_folder: Path, *names: str) -> Path:
    """The path of a file or folder below a run folder; ElastidError where a folder on the way or itself is a link."""
    path = run_folder
    for name in names:
        path = path / name
        if _is_link(path):
            raise _refusal(path)
    return path


def make_folder(run_folder: Path, *names: str) -> Path:
    """A folder below a run folder, made where it is missing; ElastidError for a link on the way."""
    path = own_path(run_folder, *names)
    path.mkdir(parents=True, exist_ok=True)
    return path


def clear_folder(run_folder: Path, *names: str) -> Path:
    """The path of a folder below a run folder, removed with its files; ElastidError for a link on the way."""
    path = own_path(run_folder, *names)
    shutil.rmtree(path, ignore_errors=True)
    return path


def unlinked(path: str, flags: int) -> int:
    """The opener (of `open`) of a file that is no link; ElastidError where it is one."""
    if not hasattr(os, "O_NOFOLLOW") and _is_link(Path(path)):
        raise _refusal(Path(path))
    try:
        return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        if error.errno == ELOOP or _is_link(Path(path)):  # BSD says EMLINK
            raise _refusal(Path(path)) from None
        raise


def _is_link(path: Path) -> bool:
    """True for a symbolic link, and for a junction of Windows."""
    return path.is_symlink() or (hasattr(path, "is_junction") and path.is_junction())


def _refusal(path: Path) -> ElastidError:
    return ElastidError(
        f"{path}: is a link, and nothing is written through links in a run folder; remove it, or give another folder "
        "with --run"
    )
