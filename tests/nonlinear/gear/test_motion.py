"""The equation of the hidden motion against its closed form."""

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.nonlinear.gear.motion import newton


@pytest.mark.parametrize("h", [1.0, 50.0])
def test_a_hardening_spring_at_rest_is_cardanos(h: float) -> None:
    """x + h x^3 = x_0, point by point, where forces move the deflection by themselves alone."""
    x_0 = np.linspace(-1, 1, 101)[None]
    x = newton(lambda x: (h * x**3, 3 * h * x**2), lambda force: force, x_0, np.zeros_like(x_0))
    root = np.sqrt(x_0**2 / (4 * h**2) + 1 / (27 * h**3))
    exact = np.cbrt(x_0 / (2 * h) + root) + np.cbrt(x_0 / (2 * h) - root)
    assert x == pytest.approx(exact, abs=1e-4)


def test_coulomb_friction_that_turns_gradually_sticks_and_slides() -> None:
    """w + F tanh(w / w_s) = w_0: nearly at rest within F, slower by F beyond it."""
    w_0 = np.linspace(-3, 3, 61)[None]

    def law(w: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.tanh(w / 0.2), (1 - np.tanh(w / 0.2) ** 2) / 0.2

    w = newton(law, lambda force: force, w_0, w_0.copy())
    assert w + np.tanh(w / 0.2) == pytest.approx(w_0, abs=1e-3)
    fast = np.abs(w_0) > 1.8
    assert w[fast] == pytest.approx((w_0 - np.sign(w_0))[fast], abs=2e-3)
