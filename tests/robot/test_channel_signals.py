"""Signals through delays and low passes of their channels against closed forms."""

import numpy as np
import pytest

from elastid.robot import Channel, before_channels, log_signal

RATE, N, PERIODS = 1000.0, 500, 5
LINES = np.arange(2, 100, 7)


@pytest.mark.parametrize("late", [Channel("u", delay=5.75e-3), Channel("y", "", 2.0, -0.26e-3, 0.8e-3)])
def test_logged_multisine_has_phase_and_gain_of_its_channel(late: Channel) -> None:
    """g cos(omega (t - T) - atan(omega T_l)) / sqrt(1 + (omega T_l)^2) on a ramp, and back to the true signal."""
    t, omega = np.arange(PERIODS * N) / RATE, 2 * np.pi * LINES * RATE / N
    phases = np.random.default_rng(0).uniform(0, 2 * np.pi, len(LINES))
    true = np.cos(t[:, None] * omega + phases).sum(axis=1) + 3.0 + 0.5 * t
    lag = np.arctan(omega * late.low_pass)
    size = 1 / np.sqrt(1 + (omega * late.low_pass) ** 2)
    ramp = 3.0 + 0.5 * (t - late.delay - late.low_pass)
    expected = late.gain * ((size * np.cos((t[:, None] - late.delay) * omega + phases - lag)).sum(axis=1) + ramp)
    result = log_signal(true[:, None], RATE, [(late,)])
    inner = slice(N, -N)
    np.testing.assert_allclose(result[inner, 0], expected[inner], atol=0.03)
    np.testing.assert_allclose(before_channels(result, RATE, [(late,)])[inner, 0], true[inner], atol=0.03)
    (spectrum,) = np.fft.rfft(result[N : 2 * N, 0] - late.gain * ramp[N : 2 * N])[None, LINES]
    closed = late.gain * N / 2 * size * np.exp(1j * (phases - lag - omega * late.delay + omega * t[N]))
    np.testing.assert_allclose(spectrum, closed, rtol=1e-3)
