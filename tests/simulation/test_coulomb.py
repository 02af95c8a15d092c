"""Coulomb friction brakes, and looks to a multisine like viscous friction."""

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.friction.static import SLIDING_VELOCITY, coulomb, coulomb_expression

velocities = st.floats(-10, 10)
levels = st.floats(0, 1e3)


@given(velocities, levels)
@settings(deadline=None)
def test_friction_takes_energy_and_never_more_than_its_level(v: float, F_c: float) -> None:
    """tau_f v >= 0 on the left-hand side, so the motion loses energy, and |tau_f| <= F_c."""
    torque = coulomb(np.array([v]), np.array([F_c]))[0]
    assert torque * v >= 0
    assert abs(torque) <= F_c


def test_friction_is_coulombs_away_from_standstill() -> None:
    """At five sliding velocities tanh is within 1e-4 of the sign."""
    v = np.array([-5.0, 5.0]) * SLIDING_VELOCITY
    np.testing.assert_allclose(coulomb(v, np.array([20.0, 30.0])), [-20.0, 30.0], rtol=1e-4)


@given(st.lists(velocities, min_size=2, max_size=2))
@settings(deadline=None, max_examples=20)
def test_the_expression_equals_the_numbers(v: list[float]) -> None:
    """The CasADi expression and NumPy agree to rounding."""
    symbol, F_c = ca.SX.sym("v", 2), np.array([20.0, 0.0])
    torque = ca.Function("torque", [symbol], [coulomb_expression(symbol, F_c)])
    np.testing.assert_allclose(torque(v).full()[:, 0], coulomb(np.array(v), F_c), rtol=1e-12, atol=1e-12)


def test_under_gaussian_velocity_friction_is_viscous_on_average() -> None:
    """Bussgang: E[tau_f v] / E[v^2] = sqrt(2 / pi) F_c / sigma_v, up to (v_s / sigma_v)^2."""
    F_c, sigma = 20.0, 0.05
    v = np.linspace(-8 * sigma, 8 * sigma, 200_001)
    density = np.exp(-((v / sigma) ** 2) / 2)
    slope = np.sum(coulomb(v, np.array(F_c)) * v * density) / np.sum(v**2 * density)
    np.testing.assert_allclose(slope, np.sqrt(2 / np.pi) * F_c / sigma, rtol=2 * (SLIDING_VELOCITY / sigma) ** 2)
