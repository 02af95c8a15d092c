"""A channel that hangs at one value."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.repair import Log, counts
from elastid.recorded.repair.stops import without_stuck

N, P = 400, 4
LOG = Log("log.csv", ("torque", "angle"), 200.0)


def wave(seed: int = 0) -> FloatArray:
    """Two periodic signals with noise of a thousandth."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(P * N) / N
    sines = [np.cos(k * t[:, None] + rng.uniform(0, 6, 2)) for k in range(2, 30)]
    return np.asarray(sum(sines) + 1e-3 * rng.normal(size=(P * N, 2)))


def test_a_channel_that_hangs_lacks_these_samples() -> None:
    """From the second sample of one value on, the first of which was measured; the other channel is as it was."""
    signals = wave()
    signals[530:590, 1] = signals[530, 1]
    repaired = without_stuck(signals, N, LOG)
    assert np.flatnonzero(np.isnan(repaired.signals[:, 1])).tolist() == list(range(531, 590))
    np.testing.assert_array_equal(repaired.signals[:, 0], signals[:, 0])
    assert counts(repaired.findings) == {"stuck samples": 59}
    assert "angle is stuck for 59 samples from sample 531 (2.655 s) on" in repaired.findings[0].text


def test_what_stands_in_every_period_or_within_a_count_does_not_hang() -> None:
    """An excitation with a pause, a joint that rests, a coarse encoder, a short hold and a limit."""
    signals = wave()
    signals[np.arange(P * N) % N > 300] = 0.0
    signals[100:115, 0] = signals[100, 0]
    assert without_stuck(signals, N, LOG).findings == ()
    for seed in range(20):
        coarse = np.stack([np.round(wave(seed)[:, 0] / 4) * 4, np.clip(wave(seed)[:, 1], -3, 3)], axis=1)
        assert without_stuck(coarse, N, LOG).findings == ()
