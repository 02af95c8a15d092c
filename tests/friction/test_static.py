"""The function phi_1 of the exact updates."""

from collections.abc import Mapping

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.friction.static import LINEAR, SLIDING_VELOCITY, Conditions, Curve, Tustin, columns, phi_1, slopes


def test_phi_1_has_the_derivatives_of_its_series() -> None:
    """1, -1/2, 1/3 at 0; no jump where the series hands over."""
    x = ca.SX.sym("x")
    first = ca.jacobian(phi_1(x), x)
    values = ca.Function("phi", [x], [phi_1(x), first, ca.jacobian(first, x)])
    np.testing.assert_allclose([float(part) for part in values(0.0)], [1, -0.5, 1 / 3], rtol=1e-12)
    below, above = float(values(1e-3 * (1 - 1e-9))[0]), float(values(1e-3)[0])
    np.testing.assert_allclose(below, above, rtol=1e-12)


def torque(v: np.ndarray, *numbers: float) -> np.ndarray:
    """Torques (n,) at velocities v (n,); numbers: F_c, F_s, 1 / nu_s, alpha_3, or Coulomb's F_c alone."""
    symbol, curve = ca.SX.sym("v"), Curve(*(numbers if len(numbers) > 1 else (*numbers, *numbers, 0.0)))
    law = ca.Function("law", [symbol], [Tustin().torque(symbol, ca.SX(0, 1), curve)])
    return law.map(len(v))(v[None]).full()[0]


@given(st.floats(-10, 10), st.floats(0, 1e3))
@settings(deadline=None)
def test_friction_takes_energy_and_never_more_than_its_level(v: float, F_c: float) -> None:
    """tau_f v >= 0 on the left-hand side, so the motion loses energy, and |tau_f| <= F_c."""
    (tau_f,) = torque(np.array([v]), F_c)
    assert tau_f * v >= 0
    assert abs(tau_f) <= F_c


def test_under_gaussian_velocity_friction_is_viscous_on_average() -> None:
    """Bussgang: E[tau_f v] / E[v^2] = sqrt(2 / pi) F_c / sigma_v, up to (v_s / sigma_v)^2."""
    F_c, sigma = 20.0, 0.05
    v = np.linspace(-8 * sigma, 8 * sigma, 200_001)
    density = np.exp(-((v / sigma) ** 2) / 2)
    slope = np.sum(torque(v, F_c) * v * density) / np.sum(v**2 * density)
    np.testing.assert_allclose(slope, np.sqrt(2 / np.pi) * F_c / sigma, rtol=2 * (SLIDING_VELOCITY / sigma) ** 2)


ETA = {"stribeck_velocity": 0.1, "exponent": 1.3, "temperature.stribeck_velocity": 2e-3, "temperature.decay": 20.0}
NUMBERS = dict(zip(LINEAR, (3.0, 5.0, 4.0, 2.0, 0.1, 0.3, -0.02, -0.03, 1.5, 0.4, 0.2), strict=True))


def closed_form(c: Conditions, eta: Mapping[str, float]) -> np.ndarray:
    """s tau_f (n,) of NUMBERS, a temperature that is not known being T_0 = 25."""
    (F_c, F_s, f, a2, mu_c, mu_s, T_c, T_s, T_f, D_c, D_f), v = NUMBERS.values(), c.speed
    theta = np.where(np.isnan(c.temperature), 0.0, c.temperature - 25.0)
    nu = eta["stribeck_velocity"] + eta["temperature.stribeck_velocity"] * theta
    e, e_L = (np.exp(-((v / x) ** eta["exponent"])) for x in (nu, eta.get("load.stribeck_velocity", nu)))
    warm = theta * (T_c + (T_s * e)) + T_f * v * np.expm1(-theta / eta["temperature.decay"])
    by_load = c.load * (mu_c + (mu_s - mu_c) * e_L)
    return F_c + (F_s - F_c) * e + f * v + a2 * v**2 + by_load + warm + c.direction * (D_c + D_f * v)


@pytest.mark.parametrize("eta", [ETA, ETA | {"load.stribeck_velocity": 0.3}])
def test_friction_columns_equal_closed_form_and_differences(eta: dict[str, float]) -> None:
    rng = np.random.default_rng(1)
    warm = np.where(np.arange(30) % 5, rng.uniform(20, 60, 30), np.nan)
    c = Conditions(rng.uniform(0.01, 1, 30), rng.choice([-1.0, 0, 1], 30), rng.uniform(0, 20, 30), warm)
    np.testing.assert_allclose(columns(c, LINEAR, eta, 25.0) @ [*NUMBERS.values()], closed_form(c, eta), rtol=1e-12)
    for name, slope in zip(eta, slopes(c, NUMBERS, tuple(eta), eta, 25.0).T, strict=True):
        h = 1e-5 * eta[name]
        up, down = (closed_form(c, eta | {name: eta[name] + step}) for step in (h, -h))
        np.testing.assert_allclose(slope, (up - down) / (2 * h), rtol=1e-5, atol=1e-6 * np.abs(slope).max())
