"""Check that an HDF5 file contains all its data.

HDF5 can name data in other files: external links, external storage, virtual datasets. A log could thereby have any file
that its reader may open read as a measurement.
"""

from collections.abc import Iterator
from itertools import islice
from typing import Any

from h5py import h5d, h5g, h5l, h5o

from elastid.base.errors import DataError


def check_self_contained(file: Any) -> None:
    """Raise DataError if an open h5py.File names data in other files, contains itself, or declares too much data."""
    root = file["/"].id
    if next(islice(_members(file.filename, root, "", (_address(root),)), 100_000, None), None) is not None:
        text = "more than 100000 groups and datasets are in it; export fewer signals"
        raise DataError("files/unsafe", text, file.filename)


def _members(path: str, group: Any, parent: str, ancestors: tuple[int, ...]) -> Iterator[str]:
    """Check each member below a group (h5py.h5g.GroupID), then yield its path; ancestors: addresses of groups."""
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
    """Raise DataError for values in another file, or a size that the stored bytes cannot give."""
    layout = dataset.get_create_plist()
    if layout.get_external_count() > 0 or layout.get_layout() == h5d.VIRTUAL:
        raise DataError(
            "files/unsafe",
            f"the values of {name} lie in another file, which is not opened; save them in the file itself",
            path,
        )
    size = dataset.get_space().get_simple_extent_npoints() * dataset.get_type().get_size()
    stored = dataset.get_storage_size()
    # The compression ratio of deflate is about 1000 at most.
    if size > max(1 << 28, 2000 * stored):
        raise DataError(
            "files/unsafe",
            f"{name} claims {size / 1e9:.3g} GB, and {stored} bytes of it are in the file; export it again",
            path,
        )


def _address(group: Any) -> int:
    return int(h5o.get_info(group).addr)
