"""A stranger's HDF5 file reads no other file, and ends in one sentence where it is built to harm."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from elastid.base.errors import DataError
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.formats import contents
from elastid.store.reading import described

SECRET = b"a secret that belongs to somebody else.."


def external_values(file: Any, secret: Path) -> None:
    """The bytes of another file as a signal."""
    file.create_dataset("a", (len(SECRET),), "u1", external=[(str(secret), 0, len(SECRET))])


def external_link(file: Any, secret: Path) -> None:
    """A name for what lies in another file."""
    file["g/a"] = h5py.ExternalLink(str(secret), "/a")


def virtual_values(file: Any, secret: Path) -> None:
    """A signal that is put together from other files."""
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "a", shape=(5,))
    file.create_virtual_dataset("v", layout)


def group_in_itself(file: Any, secret: Path) -> None:
    """By a hard link."""
    group = file.create_group("g")
    group["again"] = group


def link_to_the_root(file: Any, secret: Path) -> None:
    """By a soft link."""
    file.create_group("g")["again"] = h5py.SoftLink("/")


def bomb(file: Any, secret: Path) -> None:
    """Terabytes that were never written."""
    file.create_dataset("a", (10**12,), "f8", chunks=(10**6,), compression="gzip")


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (external_values, "the values of /a lie in another file, which is not opened"),
        (external_link, "/g/a is a link into another file"),
        (virtual_values, "the values of /v lie in another file, which is not opened"),
        (group_in_itself, "the group /g/again contains itself"),
        (link_to_the_root, "the group /g/again contains itself"),
        (bomb, r"/a claims 8e\+03 GB, and 0 bytes of it are in the file"),
    ],
)
def test_a_file_that_reaches_out_is_refused(tmp_path: Path, harm: Callable[[Any, Path], None], message: str) -> None:
    """As a log, and as something that says it is a result of elastid."""
    secret, path = tmp_path / "secret", tmp_path / "log.h5"
    secret.write_bytes(SECRET)
    with h5py.File(path, "w") as file:
        file.attrs["elastid"] = "frf"
        harm(file, secret)
    with pytest.raises(DataError, match=message):
        contents(path, TextFormatSpec())
    with pytest.raises(DataError, match=message):
        described(path)


def test_links_inside_a_file_are_followed(tmp_path: Path) -> None:
    """A second name of a signal is one; a link that leads nowhere is none."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["axis/torque"] = np.arange(5.0)
        file["torque"], file["gone"] = h5py.SoftLink("/axis/torque"), h5py.SoftLink("/nowhere")
    assert contents(tmp_path / "log.h5", TextFormatSpec()) == {"axis/torque": (5,), "torque": (5,)}
