"""Logs with the faults of a real robot, from the file to the response: what is mended equals the clean one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.axis_logs import (
    CLEAN,
    LINES,
    RATE,
    N,
    P,
    error_of,
    record_of,
)
from plants.notes import said

from elastid.base.arrays import FloatArray
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec


def _spoilt(name: str, at: Any, value: Any) -> dict[str, FloatArray]:
    column = CLEAN[name].copy()
    column[at] = value
    return CLEAN | {name: column}


def _all(change: Any) -> dict[str, FloatArray]:
    return {name: change(column) for name, column in CLEAN.items()}


FAULTS: list[tuple[str, dict[str, FloatArray], dict[str, int], float]] = [
    ("nothing", CLEAN, {}, 1.0),
    ("missing samples", _spoilt("y", [10, 11, 900, 2999], np.nan), {"missing samples filled": 4}, 1.2),
    ("a gap in all", _all(lambda x: np.r_[x[:800], np.full(30, np.inf), x[830:]]), {"missing samples filled": 90}, 1.5),
    (
        "most of a period missing",
        _all(lambda x: np.r_[x[:1100], np.full(200, np.nan), x[1300:]]),
        {"missing samples filled": 600, "repetitions left out": 1},
        1.5,
    ),
    (
        "spikes",
        _spoilt("y", [77, 1234, 2500], 5 * CLEAN["y"].max()),
        {"samples taken as missing": 3},
        1.2,
    ),
    (
        "a spike of the torque",
        _spoilt("u", [1777], -5.0),
        {"samples taken as missing": 1},
        1.2,
    ),
    ("a drift", CLEAN | {"y": CLEAN["y"] + 100 * CLEAN["y"].std() * np.linspace(0, 1, P * N)}, {}, 1.2),
]


@pytest.mark.parametrize(("signals", "repairs", "worse"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_the_response_of_a_mended_log_is_as_exact_as_that_of_a_clean_one(
    signals: dict[str, FloatArray], repairs: dict[str, int], worse: float, tmp_path: Path
) -> None:
    """At most half as wrong again as with the noise alone (1e-4 of each signal); every repair counted and said."""
    clean, mended = record_of(tmp_path, CLEAN), record_of(tmp_path, signals)
    assert error_of(clean) < 0.02
    assert error_of(mended) < worse * error_of(clean) + 1e-12
    assert mended.repairs == repairs
    assert len(said(mended.notes)) >= bool(repairs)
    assert all(note.startswith("record home-r0-e0: ") for note in said(mended.notes))


def test_a_slow_carrier_is_no_analysed_line(tmp_path: Path) -> None:
    """Thirty times the excitation on line 1 of u and y, r without: only the excited lines."""
    size = 30 * np.array([CLEAN["u"].std(), CLEAN["y"].std()])
    carrier = np.sin(2 * np.pi * np.arange(P * N) / N)
    record = record_of(tmp_path, CLEAN | {"u": CLEAN["u"] + size[0] * carrier, "y": CLEAN["y"] + size[1] * carrier})
    response = estimate([record], EstimatorSpec(quantity="position"))
    np.testing.assert_allclose(response.freq_hz, LINES * RATE / N)
