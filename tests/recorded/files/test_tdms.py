"""TDMS logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import formats
from elastid.recorded.files.formats import read_channels
from elastid.recorded.files.log import ArrayLog

TEXT = TextFormatSpec()


def _read(path: Path, *names: str, column: int | None = None) -> np.ndarray:
    return read_channels(path, [ChannelSpec("u", "motor 1", name, column) for name in names], TEXT)


def test_a_negative_increment_of_tdms_is_no_rate(tmp_path: Path) -> None:
    """`inspect` showed a signal at -1 Hz."""
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([ChannelObject("g", "torque", np.arange(9.0), {"wf_increment": -1.0})])
    with formats.opened_log(tmp_path / "log.tdms", TEXT) as log:
        assert isinstance(log, ArrayLog)
        assert log.arrays["g/torque"].rate_hz is None


def test_times_of_tdms_are_seconds(tmp_path: Path) -> None:
    """From the first."""
    from nptdms import ChannelObject, TdmsWriter

    at = np.datetime64("2026-05-01T10:00:00", "us") + np.arange(3) * np.timedelta64(4000, "us")
    with TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment([ChannelObject("a", "t", at), ChannelObject("a", "x", np.array([1, 2, 3]))])
    np.testing.assert_allclose(_read(tmp_path / "log.tdms", "a/t", "a/x"), [[0, 1], [0.004, 2], [0.008, 3]])
