"""Spikes are replaced, steps and noise are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.base.arrays import FloatArray
from elastid.recorded.repair import Log, counts
from elastid.recorded.repair.spikes import REPLACED, despiked

N, P = 500, 6


LINES = np.arange(2, 150)


LOG = Log("log.csv", ("torque", "angle"), 1000.0)


def wave(t: FloatArray, seed: int = 0) -> FloatArray:
    """Two periodic signals (n, 2) of period N at times t in samples: a torque of rms 1 and a position with it."""
    rng = np.random.default_rng(seed)
    U = np.exp(2j * np.pi * rng.random(len(LINES))) * np.sqrt(2 / len(LINES))
    G = 1e3 / (1 + 2j * 0.03 * LINES / 40 - (LINES / 40) ** 2)
    phasors = np.exp(2j * np.pi * np.outer(np.asarray(t) / N, LINES))
    return np.asarray(np.stack([(phasors @ U).real, (phasors @ (U * G)).real], axis=1))


CLEAN = wave(np.arange(P * N))


DRIFT = np.arange(P * N)[:, None] / (P * N) * np.array([0.0, 5e4])


NOISE = np.random.default_rng(9).normal(size=CLEAN.shape) * np.array([1e-3, 1.0])


def test_spikes_are_found_and_nothing_else_is_touched() -> None:
    """Five spikes of 30 sigma of the noise, on a drift and a decaying transient; noise, not truth, is what is left."""
    ring = np.exp(-np.arange(P * N) / 80) * np.cos(2 * np.pi * np.arange(P * N) / 12.5)
    signals = CLEAN + DRIFT + NOISE + ring[:, None] * np.array([0.1, 300.0])
    spoilt, where = signals.copy(), [640, 1033, 1034, 2222, 2990]
    spoilt[where, 1] += np.array([40, -40, -40, 30, 50.0])
    repaired = despiked(spoilt, N, 1, LOG)
    untouched = np.ones(signals.shape, dtype=bool)
    untouched[where, 1] = False
    np.testing.assert_array_equal(repaired.signals[untouched], signals[untouched])
    assert counts(repaired.findings) == {REPLACED: 5}
    assert np.abs(repaired.signals - signals)[where, 1].max() < 6
    assert "angle: 5 of 3000 samples are spikes, the first is sample 640 (0.64 s)" in repaired.findings[0].text


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), level=st.sampled_from([0.0, 1e-3, 1.0]), q=st.sampled_from([0.0, 0.01, 3.0]))
def test_noise_and_steps_of_an_encoder_are_no_spikes(seed: int, level: float, q: float) -> None:
    """White noise of any size, coarse steps, or both: not one sample changes."""
    signals = wave(np.arange(4 * N), seed)
    signals += level * signals.std(axis=0) * np.random.default_rng(seed).normal(size=signals.shape)
    if q:
        signals[:, 1] = q * np.round(signals[:, 1] / q)
    repaired = despiked(signals, N, 1, LOG)
    assert repaired.findings == ()
    np.testing.assert_array_equal(repaired.signals, signals)


@pytest.mark.parametrize("periods", [3, 4, 5])
def test_few_periods_of_a_slow_wander_have_no_spikes_but_their_own(periods: int) -> None:
    """One of three periods is their median, and a sample of it between others of it is no spike; one of 30 sigma is."""
    rng = np.random.default_rng(periods)
    for seed in range(20):
        n = periods * N
        slow = np.cumsum(rng.normal(size=(n, 2)), axis=0) * np.array([5e-5, 0.05])
        signals = wave(np.arange(n), seed) + slow + rng.normal(size=(n, 2)) * np.array([1e-4, 0.1])
        repaired = despiked(signals, N, 1, LOG)
        np.testing.assert_array_equal(repaired.signals, signals)
        spoilt = signals.copy()
        spoilt[N + 77, 1] += 6.0
        repaired = despiked(spoilt, N, 1, LOG)
        assert counts(repaired.findings) == {REPLACED: 1}
        assert np.abs(repaired.signals - signals).max() < 2.0


def test_what_is_no_single_spike_is_left_with_a_word() -> None:
    """2 % of a channel; a burst of oscillation that only one period has."""
    rng = np.random.default_rng(5)
    many = CLEAN + NOISE
    many[rng.choice(P * N, 60, replace=False), 0] += 1.0
    repaired = despiked(many, N, 1, LOG)
    np.testing.assert_array_equal(repaired.signals, many)
    assert "differ from the other periods: too many for spikes, left unchanged" in repaired.findings[0].text
    burst = CLEAN + NOISE
    burst[1200:1260, 0] += np.sin(np.arange(60) * 2.0)
    assert despiked(burst, N, 1, LOG).findings == ()
    assert despiked(many[: 2 * N], N, 1, LOG).findings == ()
