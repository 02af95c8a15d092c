"""HDF5 files of anybody, believed only where they hold all of their data themselves.

HDF5 can name data in other files: external links, external storage, virtual datasets.  A log that does so would have
any file that its reader may open read as a measurement.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from elastid.base.errors import DataError

MAX_DEPTH = 32
MAX_MEMBERS = 100_000
# Compression makes data at most some 1000 times smaller; small datasets may be anything.
MAX_EXPANSION, SMALL_BYTES = 2000, 1 << 28


def require_own_data(file: Any) -> None:
    """Refuse an open HDF5 file that names data elsewhere, contains itself, or claims more data than it can hold.

    file: h5py.File.  Raises DataError with the place inside the file.
    """
    members = _members(file.filename, file["/"], "", (_address(file["/"]),))
    if next(islice(members, MAX_MEMBERS, None), None) is not None:
        raise DataError(f"{file.filename}: more than {MAX_MEMBERS} groups and datasets are in it; export fewer signals")


def _members(path: str, group: Any, place: str, above: tuple[int, ...]) -> Iterator[str]:
    """The place of each member below a group, once it was looked at; above: the groups that it lies in."""
    import h5py

    for key in group:
        name = f"{place}/{key}"
        link = group.get(key, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise DataError(
                f"{path}: {name} is a link into another file ({link.filename}), which is not opened; copy what it "
                "points to into one file"
            )
        item = group.get(key)  # None where a link inside the file leads nowhere
        if isinstance(item, h5py.Dataset):
            _require_own_values(path, name, item)
        elif isinstance(item, h5py.Group):
            if _address(item) in above or len(above) > MAX_DEPTH:
                raise DataError(f"{path}: the group {name} contains itself, or lies too deep; export the file again")
            yield from _members(path, item, name, (*above, _address(item)))
        yield name


def _require_own_values(path: str, name: str, dataset: Any) -> None:
    if dataset.external or dataset.is_virtual:
        raise DataError(
            f"{path}: the values of {name} lie in another file, which is not opened; save them in the file itself"
        )
    claimed, stored = dataset.size * dataset.dtype.itemsize if dataset.shape else 0, dataset.id.get_storage_size()
    if claimed > max(SMALL_BYTES, MAX_EXPANSION * stored):
        raise DataError(
            f"{path}: {name} claims {claimed / 1e9:.3g} GB, and {stored} bytes of it are in the file; export it again"
        )


def _address(group: Any) -> int:
    """Where a group lies in its file: the same whatever link leads to it."""
    import h5py

    return int(h5py.h5o.get_info(group.id).addr)
