"""checksums.sha256: the checksums of the texts, pages and figures of a run folder, as `sha256sum --check` reads them.

HDF5 files carry their own.  A bit that flips in summary.json would change a number that a fleet or another program
reads, and one in references/*.csv a motion of the robot.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from elastid.store.files import text_file

CHECKSUMS = "checksums.sha256"
# A run folder and those in it: figures, references.
FOLDERS_DEEP = 2


def changed_texts(folder: Path, names: Iterable[str]) -> tuple[str, ...]:
    """The files that have changed since `keep_checksums`; a file without a checksum has not.

    names: of files, of folders, or patterns such as `references/*.csv`, relative to the folder.
    """
    known = _known(folder)
    return tuple(name for name in _files(folder, names) if name in known and known[name] != _hash(folder / name))


def is_as_written(path: Path) -> bool | None:
    """True for a file of a run folder that is as it was at `keep_checksums`; None for a file without a checksum."""
    path = path.resolve()
    for folder in path.parents[:FOLDERS_DEEP]:
        if (expected := _known(folder).get(path.relative_to(folder).as_posix())) is not None:
            return expected == _hash(path)
    return None


def keep_checksums(folder: Path, names: Iterable[str]) -> None:
    """Take down the files as they are now, and forget those that are gone; names: as those of `changed_texts`."""
    known = _known(folder)
    now = {name: digest for name, digest in known.items() if (folder / name).is_file()}
    now |= {name: _hash(folder / name) for name in _files(folder, names)}
    if now != known:
        with text_file(folder / CHECKSUMS) as file:
            file.writelines(f"{now[name]}  {name}\n" for name in sorted(now))


def _known(folder: Path) -> dict[str, str]:
    """Checksum by name; a damaged line names no file, or reports an intact file as changed."""
    path = folder / CHECKSUMS
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
    pairs = (line.partition("  ") for line in lines)
    return {name: digest for digest, _, name in pairs if name and "\0" not in name}


def _files(folder: Path, names: Iterable[str]) -> Iterator[str]:
    for name in names:
        for path in sorted(folder.glob(name)):
            inside = sorted(path.rglob("*")) if path.is_dir() else [path]
            yield from (each.relative_to(folder).as_posix() for each in inside if each.is_file())


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
