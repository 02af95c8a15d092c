"""Delays, times and clocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.waves import CLEAN, DRIFT, LOG, N, P, wave

from elastid.recorded.repair import counts
from elastid.recorded.repair.time_stamps import at_times, clock_drift, delay, resampled


@pytest.mark.parametrize("excess", [0.2, -0.13, 0.03])
def test_a_clock_that_differs_is_measured_and_resampled(excess: float) -> None:
    """A period of N + e samples: e within 1e-3, and the signal back to 2e-4 of its size, drift or not."""
    n = int(np.ceil(P * (N + excess)))
    t = np.arange(n) * N / (N + excess)
    for drift in (0.0, 1.0):
        signals = wave(t) + drift * np.outer(t / (P * N), [0.0, 5e4])
        assert clock_drift(signals[:, :1], N).excess == pytest.approx(excess, abs=1e-3)
        repaired = resampled(signals, signals[:, :1], N, LOG)
        error = repaired.signals - CLEAN - drift * DRIFT
        # Near its ends the log leans on what it is continued with.
        assert np.all(np.abs(error[50:-50]).max(axis=0) < 2e-4 * CLEAN.std(axis=0))
        assert f"the period is {N + excess:.3f}" in repaired.findings[0].text
        assert counts(repaired.findings) == {"samples resampled": P * N}


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), noise=st.sampled_from([0.0, 0.01, 0.5]))
def test_clocks_that_agree_are_left_alone(seed: int, noise: float) -> None:
    """Noise alone looks like no drift."""
    signals = wave(np.arange(4 * N), seed)
    signals += noise * np.random.default_rng(seed).normal(size=signals.shape)
    assert resampled(signals, signals[:, :1], N, LOG).findings == ()


def test_a_wrong_period_is_no_drift_of_a_clock() -> None:
    """Half a percent is beyond any clock: left to the check of the period, which names the right one."""
    signals = wave(np.arange(P * N) * N / (N + 2.5))
    assert resampled(signals, signals[:, :1], N, LOG).findings == ()


@settings(max_examples=20, deadline=None)
@given(tau=st.floats(-240, 240), noise=st.sampled_from([0.0, 0.3]))
def test_the_delay_between_two_logs_is_found_to_a_hundredth_of_a_sample(tau: float, noise: float) -> None:
    """Any delay within half a period, with noise on both."""
    rng = np.random.default_rng(1)
    a, b = wave(np.arange(P * N))[:, 0], wave(np.arange(P * N) - tau)[:, 0]
    a, b = (x + noise * rng.normal(size=x.shape) for x in (a, b))
    found, correlation = delay(a, b, N)
    assert found == pytest.approx(tau, abs=0.03 if noise else 1e-6)
    assert correlation > 0.9
    assert delay(a, rng.normal(size=P * N), N)[1] < 0.5


def test_interpolation_is_exact_in_its_band_and_keeps_the_rest_out() -> None:
    """Halved rate: what the lower rate can hold stays to 2e-4, what it cannot is gone to 1e-3."""
    t, half = np.arange(4000.0), np.arange(100, 1900) * 2.0
    low, high = np.cos(2 * np.pi * 0.21 * t), np.cos(2 * np.pi * 0.3 * t)
    result = at_times(np.stack([low, high], axis=1), half, 1000, band=0.5)
    np.testing.assert_allclose(result[:, 0], np.cos(2 * np.pi * 0.21 * half), atol=2e-4)
    np.testing.assert_allclose(result[:, 1], 0.0, atol=1e-3)
    constant = at_times(np.full((4000, 1), 7.0), np.array([-40.3, 17.7, 4010.2]), 1000)
    np.testing.assert_allclose(constant, 7.0, rtol=1e-12)
