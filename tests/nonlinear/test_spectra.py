"""Mean periods against the signals that they are of."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused

from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.period_lines import gather_lines
from elastid.nonlinear.spectra import ConfigurationSpectra
from elastid.record import Configuration, Record

RATE_HZ, N, P = 500.0, 500, 3
SPEC = EstimatorSpec(friction="none", transient_periods=0)


def record(noise: float = 0.0, **changes: object) -> Record:
    """Torque of lines 5 and 9 and an angle of lines 1 and 5 about 0.3 rad."""
    t, rng = np.arange(P * N) / RATE_HZ, np.random.default_rng(3)
    u = 2 * np.cos(2 * np.pi * 5 * t + 0.4) + np.cos(2 * np.pi * 9 * t)
    y = 0.3 + 0.02 * np.sin(2 * np.pi * t) + 0.001 * np.cos(2 * np.pi * 5 * t) + noise * rng.standard_normal(P * N)
    places = ("motor 1",)
    made = Record(
        "r", Configuration("a", (0.3,)), 0, 0, RATE_HZ, N, places, places, ("position",), u[:, None], y[:, None]
    )
    return replace(made, **changes)


LINES = gather_lines([record()], SPEC, np.array([5, 9]))


def test_amplitudes_and_mean_are_those_of_the_signals() -> None:
    assert LINES.freq_hz[:3] == pytest.approx([1.0, 2.0, 3.0])
    assert LINES.U[[4, 8], 0, 0] == pytest.approx([2 * np.exp(0.4j), 1.0])
    assert LINES.Y[[0, 4], 0, 0] == pytest.approx([-0.02j, 0.001])
    assert LINES.mean[0] == pytest.approx([0.3])
    assert np.flatnonzero(LINES.excited).tolist() == [4, 8]


def test_the_fine_grid_is_the_signal_between_its_samples() -> None:
    t = np.arange(LINES.points) / (RATE_HZ * LINES.points / N)
    fine = LINES.fine(LINES.Y[:, :, 0].T)[0]
    assert fine == pytest.approx(0.02 * np.sin(2 * np.pi * t) + 0.001 * np.cos(2 * np.pi * 5 * t), abs=1e-12)
    assert LINES.amplitudes(fine[None])[0] == pytest.approx(LINES.Y[:, 0, 0], abs=1e-12)


def test_motion_beyond_half_the_rate_is_folded_into_samples() -> None:
    """A force at line N - 3, of an inertia that moves by 1 at the last line F, is seen at line 3."""
    F, force = N // 2 - 1, np.cos(2 * np.pi * (N - 3) * np.arange(LINES.points) / LINES.points)
    expected = np.zeros(F)
    expected[2] = (F / (N - 3)) ** 2
    assert LINES.folded(force[None])[1][0] == pytest.approx(expected, abs=1e-12)


def test_noise_is_the_variance_of_the_mean_over_the_periods() -> None:
    """White noise of std s has amplitudes of variance 4 s^2 / (N P)."""
    lines = gather_lines([record(1e-5)], SPEC, np.array([5, 100]))
    assert lines.noise[0] == pytest.approx(4 * 1e-5**2 / (N * P), rel=0.5)


@pytest.mark.parametrize("size", [1.0, 1e-6])
@pytest.mark.parametrize("count", [1, 8])
def test_sign_of_gaussian_velocity_has_two_over_pi_linear(count, size):
    """Of all experiments where they exceed the motors; else of the lines beside those excited, in any unit."""
    rng, points = np.random.default_rng(0), 2**14
    lines = np.arange(1, points // 2)
    excited = (rng.random(len(lines)) < 0.05) | (count > 1)
    U = np.where(excited[:, None], np.exp(2j * np.pi * rng.random((len(lines), count))), 0)
    spectrum = np.zeros((points // 2 + 1, count), complex)
    spectrum[lines] = U
    Phi = size * np.fft.rfft(np.sign(np.fft.irfft(spectrum, axis=0)), axis=0)[lines] * 2 / points
    data = ConfigurationSpectra(
        lines, 1.0 * lines, excited, *(x[:, None] for x in (U, U, Phi)), np.arange(count), np.zeros(1)
    )
    linear = 2 / np.pi * (1 if count > 1 else 20)  # of the power at each line, as all of it is at one of twenty
    assert data.nonlinear_fraction()[0] == pytest.approx((1 - 2 / np.pi) / (1 - 2 / np.pi + linear), rel=0.07)


@pytest.mark.parametrize("changes", [{"outputs": ("joint 1",)}, {"period_samples": P * N, "is_periodic": False}])
def test_missing_angle_and_missing_period_are_refused(changes: dict[str, object]) -> None:
    with refused("gears/records", place="configuration a"):
        gather_lines([record(**changes)], SPEC, np.array([5, 9]))
