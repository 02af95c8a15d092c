"""The repetitions of a signal."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.repair import Finding, counts, flat

N, P = 500, 6


LINES = np.arange(2, 150)


def wave(t: FloatArray, seed: int = 0) -> FloatArray:
    """Two periodic signals (n, 2) of period N at times t in samples: a torque of rms 1 and a position with it."""
    rng = np.random.default_rng(seed)
    U = np.exp(2j * np.pi * rng.random(len(LINES))) * np.sqrt(2 / len(LINES))
    G = 1e3 / (1 + 2j * 0.03 * LINES / 40 - (LINES / 40) ** 2)
    phasors = np.exp(2j * np.pi * np.outer(np.asarray(t) / N, LINES))
    return np.asarray(np.stack([(phasors @ U).real, (phasors @ (U * G)).real], axis=1))


CLEAN = wave(np.arange(P * N))


DRIFT = np.arange(P * N)[:, None] / (P * N) * np.array([0.0, 5e4])


def test_flat_removes_offset_and_slope_of_each_period_and_counts_add_up() -> None:
    """What is left is the periodic signal without its own line."""
    x = CLEAN[:, 1] + DRIFT[:, 1]
    np.testing.assert_allclose(flat(x, N), flat(CLEAN[:, 1], N), atol=1e-7)
    assert counts([Finding("a", 1, ""), Finding("b", 2, ""), Finding("a", 3, "")]) == {"a": 4, "b": 2}
