"""Files are whole or absent, the same bytes for the same value, and refused where they are not ours."""

import time

import h5py
from plants.artefacts import STAMP, some_fit
from plants.refusals import refused

from elastid.store.artefacts import FORMAT, read_stamp
from elastid.store.files import write_checksum
from elastid.store.measured import read_responses
from elastid.store.results import read_fit, write_fit


def test_the_same_value_gives_the_same_bytes(tmp_path):
    """No clock in a file: a second apart, bit for bit the same."""
    write_fit(tmp_path / "one.h5", some_fit(), STAMP)
    time.sleep(1.1)
    write_fit(tmp_path / "two.h5", some_fit(), STAMP)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_a_foreign_truncated_or_missing_file_is_refused_by_name(tmp_path):
    """One sentence that names the file, no HDF5 noise."""
    path = tmp_path / "fit.h5"
    gone = tmp_path / "gone"
    with refused("files/missing", holds=str(gone)):
        read_fit(gone / "run" / "fit.h5")
    with refused("files/missing", holds="fit.h5"):
        read_fit(path)
    write_fit(path, some_fit(), STAMP)
    with refused("files/kind", place="fit.h5"):
        read_responses(path)
    path.write_bytes(path.read_bytes()[:3000])
    with refused("files/damaged", place="fit.h5"):
        read_fit(path)
    assert read_stamp(path) is None
    path.write_text("not HDF5")
    with refused("files/damaged", place="fit.h5", holds="HDF5"):
        read_fit(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with refused("files/kind", place="fit.h5"):
        read_fit(path)
    assert read_stamp(path) is None


def test_a_file_of_another_format_is_refused(tmp_path):
    """A file has the version of its layout, one without is of before there were versions."""
    path = tmp_path / "fit.h5"
    write_fit(path, some_fit(), STAMP)
    with h5py.File(path, "r+") as file:
        assert file.attrs["format"] == FORMAT
        del file.attrs["format"]
    write_checksum(path)
    with refused("files/version", place="fit.h5", holds="format 0"):
        read_fit(path)
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = FORMAT + 1
    write_checksum(path)
    with refused("files/version", place="fit.h5", holds=str(FORMAT + 1)):
        read_fit(path)
