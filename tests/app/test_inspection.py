"""`elastid inspect` shows rates, units and values of everything that elastid reads or writes."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.refusals import refused
from scipy.io import savemat

from elastid.app.inspection import describe_file
from elastid.logs.files import log as log_of_arrays

T = np.arange(50) / 20.0


def _row(page: str, signal: str) -> list[str]:
    return next(line.split() for line in page.splitlines() if line.startswith(f"  {signal} "))


def test_text_log_shows_first_lowest_highest_and_clock_rate(tmp_path: Path) -> None:
    """A column of words is shown with the reason why it has no numbers."""
    rows = [f"{t},{100 * t * (-1) ** i},{'ok' if i else 'start'}" for i, t in enumerate(T)]
    (tmp_path / "log.csv").write_text("time,x,state\n" + "\n".join(rows))
    page = describe_file(tmp_path / "log.csv")
    assert "rises evenly: 20 Hz if it is the time in s" in page
    assert _row(page, "x")[:5] == ["x", "50", "0", "-245", "240"]
    assert "cannot be read" in page
    assert "'start' is not a number" in page


def test_hdf5_is_shown_with_its_units_in_pieces_or_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Values that are not finite are counted, numbers and texts beside the signals are shown."""
    values = np.stack([np.sin(T), np.where(T == 1, np.nan, 3 * np.sin(T))], axis=1)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["bench/angles"], file["fs"] = values, 20.0
        file["bench/angles"].attrs["units"] = "rad"
    page = describe_file(tmp_path / "log.h5")
    assert _row(page, "bench/angles")[1:5] == ["50", "x", "2", "rad"]
    assert "2.99935" in page
    assert "1 values are not finite" in page
    assert "fs: 20" in page
    monkeypatch.setattr(log_of_arrays, "_BLOCK_VALUES", 8)
    assert describe_file(tmp_path / "log.h5") == page


def test_matlab_object_is_refused_with_export_command(tmp_path: Path) -> None:
    """No word of delimiters; a text is not a signal; for objects it says how to save them."""
    savemat(tmp_path / "log.mat", {"rec": {"x": np.sin(T), "note": "run 7"}, "fs": 20.0})
    page = describe_file(tmp_path / "log.mat")
    assert "delimiter" not in page
    assert _row(page, "rec.x")[1:4] == ["1", "x", "50"]
    assert {"  rec.note: run 7", "  fs: 20"} <= set(page.splitlines())
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        file["table"], file["title"] = np.arange(6, dtype=np.uint32), np.arange(5, dtype=np.uint16)[:, None]
        file["table"].attrs["MATLAB_object_decode"] = 3
        file["title"].attrs["MATLAB_class"] = np.bytes_("char")
    with (tmp_path / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))
    page = describe_file(tmp_path / "new.mat")
    assert "0 signals" in page
    assert "x = T.Variables; save('log.mat', 't', 'x', '-v7')" in page


def test_a_summary_shows_its_numbers(tmp_path: Path) -> None:
    """Every key with its value; a list of numbers in a line; a damaged one is refused."""
    content = {"status": "converged", "parameters": {"k_1": {"value": 50.0, "interval95": [49.5, 50.5]}}, "notes": []}
    (tmp_path / "summary.json").write_text(json.dumps(content))
    lines = [line.strip() for line in describe_file(tmp_path / "summary.json").splitlines()]
    assert {"status: converged", "k_1:", "value: 50.0", "interval95: [49.5, 50.5]"} <= set(lines)
    (tmp_path / "summary.json").write_text('{"status": ')
    with refused("files/damaged", place="summary.json"):
        describe_file(tmp_path / "summary.json")
