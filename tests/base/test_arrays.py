"""Arrays that cannot be edited, labels of fields, and the unit that a name states."""

import os
import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from elastid.base import large_arrays
from elastid.base.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    fold_periods,
    frozen,
    frozen_value,
    quotient,
)
from elastid.base.large_arrays import LargeArray, map_dataset, mean_of_rows, move_beside, move_to_file, release
from elastid.base.value_range import format_values


@frozen_value(eq=False)
class Sample:
    """One field of every kind."""

    x: FloatArray
    G: ComplexArray
    lines: IntArray
    kept: BoolArray | None = None
    name: str = ""

    def __post_init__(self) -> None:
        assert not self.x.flags.writeable
        if self.x.shape != self.G.shape:
            raise ValueError(f"x has shape {self.x.shape}, G {self.G.shape}")


def test_arrays_of_value_are_read_only_copies() -> None:
    """Whatever was given stays as it was, and so does the value."""
    x = np.arange(3)
    value = Sample(x, x, x.tolist(), name="a")
    assert [array.dtype for array in (value.x, value.G, value.lines)] == [np.float64, np.complex128, np.int64]
    assert value.kept is None
    x[0] = 5
    assert value.x[0] == 0
    for array in (value.x, value.G, value.lines, replace(value, kept=np.ones(3)).kept):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(FrozenInstanceError):
        value.name = "b"


def test_a_value_checks_itself_once_it_is_frozen() -> None:
    """Its own `__post_init__` is called, on a changed copy too."""
    with pytest.raises(ValueError, match=r"x has shape \(3,\), G \(2,\)"):
        replace(Sample(np.zeros(2), np.zeros(2), np.zeros(2, int)), x=np.zeros(3))


def test_a_large_array_reads_the_rows_asked_for() -> None:
    """As double precision, by slices, columns and steps like an array in memory; whole where it is asked for."""
    values = np.arange(20, dtype=np.float32).reshape(10, 2) / 3
    asked = []

    def rows(first: int, last: int) -> np.ndarray:
        asked.append((first, last))
        return values[first:last]

    large = LargeArray((10, 2), values.dtype, rows)
    expected = values.astype(np.float64)
    np.testing.assert_array_equal(large[2:7:2, 1], expected[2:7:2, 1])
    np.testing.assert_array_equal(large[-3:], expected[-3:])
    assert large[8:3].shape == (0, 2)
    assert asked == [(2, 7), (7, 10), (8, 8)]
    np.testing.assert_array_equal(large[::-1], expected[::-1])
    np.testing.assert_array_equal(large @ np.eye(2), expected)
    assert large[0:1].dtype == large.copy().dtype == np.float64
    assert (len(large), large.size) == (10, 20)
    assert frozen(large) is large
    np.testing.assert_allclose(mean_of_rows(large, 6), expected[:6].mean(axis=0), rtol=1e-15)


def test_mapped_datasets_are_large_and_contiguous(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By their bytes in a large file, or by their number of values in any file."""
    monkeypatch.setattr(large_arrays, "MIN_MAPPED_BYTES", 64)
    single = np.arange(32, dtype=np.float32).reshape(16, 2)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["small"], file["large"], file["single"] = np.zeros(2), np.zeros(8), single
        file.create_dataset("pieces", data=np.zeros(8), chunks=(4,))
    for least_bytes, least_values, names in (
        (0, 99, {"large", "single"}),
        (1 << 40, 99, set()),
        (1 << 40, 2, {"small", "large", "single"}),
    ):
        monkeypatch.setattr(large_arrays, "MIN_LARGE_FILE", least_bytes)
        monkeypatch.setattr(large_arrays, "MIN_LARGE_VALUES", least_values)
        with h5py.File(tmp_path / "a.h5") as file:
            assert {name for name in file if map_dataset(tmp_path / "a.h5", file[name]) is not None} == names
            if "single" in names:
                np.testing.assert_array_equal(map_dataset(tmp_path / "a.h5", file["single"])[3:9], single[3:9])


FILLED = """
import sys
from pathlib import Path
import numpy as np
from elastid.base.large_arrays import move_to_file
kept = [move_to_file(Path(sys.argv[1]), np.full(1000, i)) for i in range(3)]
print(sum(array.sum() for array in kept), flush=True)
input()
"""


def test_file_arrays_have_no_name_and_vanish_with_process(tmp_path) -> None:
    """However it ends, since the file has no name from the first moment."""
    process = subprocess.Popen(
        [sys.executable, "-c", FILLED, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "3000\n"
    assert not any(tmp_path.iterdir())
    process.kill()
    process.communicate()
    assert not any(tmp_path.iterdir())


def test_file_arrays_keep_values_after_release_and_in_processes(tmp_path, monkeypatch) -> None:
    """Several dtypes and sizes. Storage beside an array in memory, or in a missing folder, returns the array itself.

    If the system writes only a part of the data, further writes complete it.
    """
    write = os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda file, data, place: write(file, data[:30_000], place))
    given = [np.arange(n, dtype=dtype).reshape(-1, 1) for n, dtype in ((5, float), (0, complex), (70_000, np.int64))]
    kept = [move_to_file(tmp_path, array) for array in given]
    for array, again in zip(given, kept, strict=True):
        release(again)
        assert not again.flags.writeable
        np.testing.assert_array_equal(again, array, strict=True)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(again)), array)
        np.testing.assert_array_equal(move_beside(again, array), array)
    assert move_beside(given[0], given[0]) is given[0]
    assert move_to_file(tmp_path / "nowhere", given[0]) is given[0]


def test_values_in_pieces_quotients_and_rows_of_text() -> None:
    """An incomplete piece is dropped; a zero divisor gives the default; a long row ends with the number of others."""
    np.testing.assert_array_equal(fold_periods(np.arange(7.0), 3), [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(quotient(3.0, np.array([2.0, 0.0, -1.0]), 7.0), [1.5, 7.0, 7.0])
    assert format_values(np.array(["", "a"])) == ", a"
    assert format_values(np.array(["b"] * 43)).endswith("b and 3 more")
    assert format_values(np.array([[0.0, np.nan], [-2.0, 1.0]])).startswith("-2 to 1, 1 ")
    assert format_values(np.arange(41)) == "0 to 40"
    assert format_values(np.array([True, False])) == "True, False"
