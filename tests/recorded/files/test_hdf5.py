"""HDF5 logs."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.lab_logs import write_hdf5

from elastid.base.errors import DataError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import hdf5
from elastid.recorded.files.formats import contents, read_channels


def test_an_hdf5_log_that_is_cut_short_is_named(tmp_path: Path) -> None:
    """The message of the library below does not say which of many files it was."""
    path = tmp_path / "cut.h5"
    with h5py.File(path, "w") as file:
        file["u"] = np.arange(5000.0)
    path.write_bytes(path.read_bytes()[:20000])
    with pytest.raises(DataError, match=r"cut\.h5: damaged, cut short or no HDF5 file .* copy it or export it again"):
        contents(path, TextFormatSpec())


def test_an_array_that_cannot_be_read_is_refused_with_the_file_and_what_to_do(
    tmp_path: Path, log: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arrays are read after the file was opened; the guard is around each of them."""

    def broken(*_: object) -> None:
        raise RuntimeError("checksum")

    write_hdf5(tmp_path, log)
    monkeypatch.setattr(hdf5, "_read", broken)
    with pytest.raises(DataError, match=r"log\.h5: damaged, cut short or no HDF5 file \(checksum\); copy it"):
        read_channels(tmp_path / "log.h5", [ChannelSpec("u", "motor 1", "w2")], TextFormatSpec())
