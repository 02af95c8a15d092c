"""Files of a run folder, whole or absent, none reached through a link, and HDF5 files that contain all their data.

A run folder may come from elsewhere. Through a link in it, the program would overwrite, extend or fill files of its
user outside of it. The run folder itself may be a link: its user has named it.

HDF5 can name data in other files: external links, external storage, virtual datasets.  A log that does so would have
any file that its reader may open read as a measurement.
"""

import csv
import os
import re
import shutil
import time
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ELOOP
from itertools import islice
from pathlib import Path
from typing import Any

from elastid.base.errors import DataError, ElastidError, StudyError


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
    # Its own name, so that two programs that make the same file do not write into each other's.
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
    """Rename a file; again while another program, such as a virus scanner or a viewer, keeps either open (Windows)."""
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
    """Flush the new name of a file to the disk, if the system supports it."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def check_self_contained(file: Any) -> None:
    """Refuse an open HDF5 file that names data elsewhere, contains itself, or claims more data than it can hold.

    file: h5py.File.  Raises DataError with the place inside the file.
    """
    root = file["/"].id
    if next(islice(_members(file.filename, root, "", (_address(root),)), 100_000, None), None) is not None:
        text = "more than 100000 groups and datasets are in it; export fewer signals"
        raise DataError("files/unsafe", text, file.filename)


def _members(path: str, group: Any, parent: str, ancestors: tuple[int, ...]) -> Iterator[str]:
    """Yield the path of each member below a group, once it is checked; ancestors: addresses of the groups around it.

    group: h5py.h5g.GroupID, whose members are there in half the time of h5py.Group.
    """
    from h5py import h5d, h5g, h5l, h5o

    for key in group:
        name = f"{parent}/{key.decode(errors='replace')}"
        if group.links.get_info(key).type == h5l.TYPE_EXTERNAL:
            raise DataError(
                "files/unsafe",
                f"{name} is a link to another file ({group.links.get_val(key)[0].decode(errors='replace')}), which is "
                "not opened. Copy the data into this file",
                path,
            )
        try:
            item = h5o.open(group, key)
        except KeyError:  # a link inside the file that leads nowhere
            item = None
        if isinstance(item, h5d.DatasetID):
            _check_dataset(path, name, item)
        elif isinstance(item, h5g.GroupID):
            if _address(item) in ancestors or len(ancestors) > 32:
                raise DataError(
                    "files/unsafe", f"the group {name} contains itself, or lies too deep; export the file again", path
                )
            yield from _members(path, item, name, (*ancestors, _address(item)))
        yield name


def _check_dataset(path: str, name: str, dataset: Any) -> None:
    from h5py import h5d

    layout = dataset.get_create_plist()
    if layout.get_external_count() > 0 or layout.get_layout() == h5d.VIRTUAL:
        raise DataError(
            "files/unsafe",
            f"the values of {name} lie in another file, which is not opened; save them in the file itself",
            path,
        )
    size = dataset.get_space().get_simple_extent_npoints() * dataset.get_type().get_size()
    stored = dataset.get_storage_size()
    # Compression makes data at most some 1000 times smaller; small datasets may be anything.
    if size > max(1 << 28, 2000 * stored):
        raise DataError(
            "files/unsafe",
            f"{name} claims {size / 1e9:.3g} GB, and {stored} bytes of it are in the file; export it again",
            path,
        )


def _address(group: Any) -> int:
    import h5py

    return int(h5py.h5o.get_info(group).addr)


def from_template(template: str, /, **values: Any) -> str:
    """Read a text file of the package, by its path in it, and fill in its $names."""
    from importlib.resources import files  # at the start of a command these take longer than all else here
    from string import Template

    return Template((files("elastid") / template).read_text("utf-8")).substitute(values)


def read_table(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Read a CSV file. Return the row number, from 1, and the cells by column name of each row.

    Empty rows, rows that begin with #, a first row `sep=;` and an empty last column are skipped. Cells may be separated
    by semicolons or tabs; their numbers then may have a decimal comma. UTF-16 files need a byte order mark.
    """
    try:
        raw = path.read_bytes()
        lines = raw.decode("utf-16" if raw.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig").splitlines()
        lines[:1] = [line for line in lines[:1] if not re.fullmatch(r'"?sep=."?', line)] or [""]
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError("files/table", f"it cannot be read as a table ({error})", f"{path}:1:1") from None
    head = next((line for line in lines if line.strip(" ,;\t") and not line.startswith("#")), "")
    separator = next((character for character in ";\t" if character in head and "," not in head), ",")
    cells = (next(csv.reader([line], delimiter=separator), []) for line in lines)
    rows = [(n, [_with_point(cell.strip(), separator) for cell in row]) for n, row in enumerate(cells, start=1)]
    rows = [(n, row) for n, row in rows if any(row) and not row[0].startswith("#")]
    if rows and not any(row[-1] for _, row in rows):  # each row ends with a separator
        rows = [(n, row[:-1]) for n, row in rows]
    if len(rows) < 2:
        raise StudyError("files/table", "a table has a row of names and at least one below it", f"{path}:1:1")
    (head_row, headings), *rows_below = rows
    names = [name_and_unit(head)[0] for head in headings]
    if repeated_names := [name for name in names if names.count(name) > 1]:
        raise StudyError(
            "files/table", f"{len(repeated_names)} columns have the name {repeated_names[0]}", f"{path}:{head_row}:1"
        )
    for number, row in rows_below:
        if len(row) != len(headings):
            text = f"{len(row)} cells separated by {separator!r}, but row {head_row} has {len(headings)} headings"
            raise StudyError("files/table", text, f"{path}:{number}:1")
        yield number, dict(zip(headings, row, strict=True))


def _with_point(cell: str, separator: str) -> str:
    number = r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?(?:\s*[^\d\s,.][^,]*)?)$"
    return cell if separator == "," else re.sub(number, r"\1.\2", cell)


_HEAD = re.compile(r"(?:joint\s+)?(.*?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])]|\s*(°)|\s+(deg|degrees?|rad|m|s))?")


def name_and_unit(head: str) -> tuple[str, str]:
    """Split a column heading into name and unit: `1 deg`, `1 (deg)` and `joint 1 [deg]` are 1 and deg."""
    match = _HEAD.fullmatch(head)
    name, *units = match.groups() if match else (head,)
    return name, next(filter(None, units), "")
