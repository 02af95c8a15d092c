"""How a motor moves above the excited lines: by the lines below, and by what friction and the loop do there."""

from dataclasses import replace

import numpy as np
import pytest
from nonlinear.test_reconstruct import RATE, J, friction_of, simulated

from elastid.nonlinear.accelerance import upper_accelerance, with_inertial_accelerance
from elastid.nonlinear.moments import Moments
from elastid.nonlinear.spectra import ConfigurationSpectra

NOTHING = np.zeros(0), np.zeros(0, dtype=np.int64), "position"


def accelerance(hz: np.ndarray, k_hz: float, resonances_hz: tuple[float, ...]) -> np.ndarray:
    """Of a motor of 24 kg m^2, at k_hz if locked on its spring, with resonances of a fifth of its inertia each."""
    omega = 2 * np.pi * hz
    A = 1 / (1 - (k_hz / hz) ** 2 + 0j)
    for at in resonances_hz:
        A = A - 0.2 * omega**2 / ((2 * np.pi * at) ** 2 - omega**2 + 0.05j * 2 * np.pi * at * omega)
    return A / 24.0


def excited_to_60_hz(k_hz: float, *resonances_hz: float) -> ConfigurationSpectra:
    lines = np.arange(5, 61)
    G = -accelerance(lines, k_hz, resonances_hz) / (2 * np.pi * lines) ** 2
    U = np.exp(2j * np.pi * np.random.default_rng(1).random((len(lines), 1, 2)))
    Y, Phi, of_all = G[:, None, None] * U, np.zeros((len(lines), 0, 2)) + 0j, np.ones(len(lines), dtype=bool)
    quiet = 0 * U, 0 * Y, 0 * Phi
    at_rest = np.array([0, 1]), np.zeros(1), np.zeros(1), 56
    return ConfigurationSpectra(lines, lines.astype(float), of_all, U, Y, Phi, *quiet, *at_rest)


@pytest.mark.parametrize("resonances_hz", [(), (45.0,), (63.0,)])
def test_the_upper_lines_show_how_a_motor_moves_above_them(resonances_hz: tuple[float, ...]) -> None:
    """On a spring, or with one resonance inside or just above the band: to 1 % of the motion up to twice the band."""
    a, above = upper_accelerance([excited_to_60_hz(11.3, *resonances_hz)], *NOTHING)
    a_1, b, c, e, alpha, beta = above[0, 0]
    assert a == pytest.approx((1 + 0.2 * len(resonances_hz)) / 24.0, rel=0.01)
    assert a_1 == a
    hz = np.linspace(60, 120, 61)
    s = 2j * np.pi * hz
    true = accelerance(hz, 11.3, resonances_hz)
    left = (a * s**2 + b * s + c + e / s**2) / (s**2 + alpha * s + beta) - true
    assert np.linalg.norm(left) < 0.01 * np.linalg.norm(true)


def test_upper_lines_of_more_resonances_than_one_continue_nothing() -> None:
    """The accelerance is then that of the highest lines."""
    a, above = upper_accelerance([excited_to_60_hz(11.3, 40.0, 46.0, 52.0)], *NOTHING)
    np.testing.assert_array_equal(above, 0.0)
    assert a == pytest.approx(accelerance(np.array([57.5]), 11.3, (40.0, 46.0, 52.0)).real, rel=0.1)


def test_the_inertia_of_a_motor_is_found_above_the_excited_lines() -> None:
    """To 1 %, from an accelerance that is 10 % off; to 10 % where none is known, and from that to 1 %."""
    record, _ = simulated()
    unknown = with_inertial_accelerance(friction_of(0.0), [record])
    np.testing.assert_allclose(unknown.accelerance, 1 / J, rtol=0.1)
    for near in (friction_of(1.1 / J), unknown):
        np.testing.assert_allclose(with_inertial_accelerance(near, [record]).accelerance, 1 / J, rtol=0.01)


def test_noise_that_a_loop_turns_round_shows_no_inertia() -> None:
    """A loop whose torque answers noise of the angle as a mass of J / 40 would move by it."""
    record, _ = simulated()
    n = record.n_samples
    noise = 0.3 * np.std(record.y) * np.random.default_rng(4).standard_normal(n)
    moved = Moments.held(np.eye(1, n)[0]).integral(2) / RATE**2
    moved[0] = 0
    torque = np.fft.irfft(J / 40 * np.divide(np.fft.rfft(noise), moved, where=moved != 0, out=0 * moved), n)
    record = replace(record, y=record.y + noise[:, None], u=record.u + torque[:, None])
    small = replace(friction_of(1.1 / J), levels=np.array([1e-6]))
    np.testing.assert_array_equal(with_inertial_accelerance(small, [record]).accelerance, 1.1 / J)
