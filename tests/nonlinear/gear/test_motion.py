"""The equation of the hidden motion against its closed form, and the covariance of what it leaves."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.nonlinear.gear.motion import newton, smoothed_covariance
from elastid.nonlinear.gear.period_lines import DriveLines, PeriodLines
from tests.plants.two_mass_gear import POSTURE


@pytest.mark.parametrize("h", [1.0, 50.0])
def test_a_hardening_spring_at_rest_is_cardanos(h: float) -> None:
    """x + h x^3 = x_0, point by point, where forces move the deflection by themselves alone."""
    x_0 = np.linspace(-1, 1, 101)[None]
    x = newton(lambda x: (h * x**3, 3 * h * x**2), lambda force: force, x_0, np.zeros_like(x_0))[0]
    root = np.sqrt(x_0**2 / (4 * h**2) + 1 / (27 * h**3))
    exact = np.cbrt(x_0 / (2 * h) + root) + np.cbrt(x_0 / (2 * h) - root)
    assert x == pytest.approx(exact, abs=1e-4)


def test_coulomb_friction_that_turns_gradually_sticks_and_slides() -> None:
    """w + F tanh(w / w_s) = w_0: nearly at rest within F, slower by F beyond it."""
    w_0 = np.linspace(-3, 3, 61)[None]

    def law(w: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.tanh(w / 0.2), (1 - np.tanh(w / 0.2) ** 2) / 0.2

    w = newton(law, lambda force: force, w_0, w_0.copy())[0]
    assert w + np.tanh(w / 0.2) == pytest.approx(w_0, abs=1e-3)
    fast = np.abs(w_0) > 1.8
    assert w[fast] == pytest.approx((w_0 - np.sign(w_0))[fast], abs=2e-3)


def test_a_start_worse_than_none_is_left_for_the_motion_without_forces() -> None:
    """x + 50 x^3 = x_0 from 100 times the motion, which eight steps of Newton's method would not leave."""
    x_0 = np.linspace(-1, 1, 101)[None]
    x = newton(lambda x: (50 * x**3, 150 * x**2), lambda force: force, x_0, 100 * x_0)[0]
    assert x + 50 * x**3 == pytest.approx(x_0, abs=1e-3)


def quiet_lines(told: int, experiments: int = 1, noise: float = 0.0) -> PeriodLines:
    """Lines of 0.2 s, of one motor, whose angle has noise of a variance."""
    none = np.zeros((told, 1, experiments), complex)
    rest = np.zeros((1, experiments))
    numbers = np.array([noise]), np.zeros((told, 1)), np.ones(told, bool), np.arange(experiments)
    return PeriodLines(POSTURE, 500.0, 100, none + 1, none, rest, rest, *numbers, rest[:, 0])


def test_the_covariance_of_residuals_follows_a_resonance_that_is_narrower_than_its_window() -> None:
    """Noise of torque through a mode of three lines' width, and of angles: within 20 % at the peak and beside it."""
    lines, rng = quiet_lines(100, experiments=400, noise=1e-16), np.random.default_rng(1)
    omega = lines.s.imag / lines.s.imag[29]
    G = 1e-6 / (1 - omega**2 + 0.05j * omega)[:, None, None]
    normal = rng.standard_normal((4, 100, 1, 400)) / np.sqrt(2)
    r = 0.03 * G * (normal[0] + 1j * normal[1]) + 1e-8 * (normal[2] + 1j * normal[3])
    true = 9e-4 * np.abs(G[:, 0, 0]) ** 2 + 1e-16
    found = smoothed_covariance(r, lines, cast(DriveLines, SimpleNamespace(G=G)))[:, 0, 0].real
    assert found == pytest.approx(true, rel=0.2)
