"""Parquet logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.formats import contents, read_channels

TEXT = TextFormatSpec()


def _read(path: Path, *names: str, column: int | None = None) -> np.ndarray:
    return read_channels(path, [ChannelSpec("u", "motor 1", name, column) for name in names], TEXT)


def test_dates_are_seconds_and_missing_values_are_missing(tmp_path: Path) -> None:
    """Time stamps of Parquet, its null, and whole numbers and floats of 32 bits as they are."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    at = np.datetime64("2026-05-01T10:00:00", "ns") + np.arange(4) * np.timedelta64(2_500_000, "ns")
    table = pa.table(
        {"t": at, "x": pa.array([1, None, 3, 4]), "f": np.arange(4, dtype=np.float32), "who": ["a", "b", "c", "d"]}
    )
    pq.write_table(table, tmp_path / "log.dat")
    assert contents(tmp_path / "log.dat", TEXT) == dict.fromkeys(("t", "x", "f"), (4,))
    np.testing.assert_array_equal(
        _read(tmp_path / "log.dat", "t", "x", "f"), [[0, 1, 0], [0.0025, np.nan, 1], [0.005, 3, 2], [0.0075, 4, 3]]
    )
