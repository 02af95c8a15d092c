"""Dynamic friction obeys its differential equations and bounds, and slides as Tustin's law says."""

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.friction_laws import Numeric
from scipy.integrate import solve_ivp

from elastid.friction.dynamic import Bristle, MaxwellElements
from elastid.friction.static import SLIDING_VELOCITY, Curve, Law, Tustin
from elastid.robot import Friction, LuGre

F_C, F_S, NU_S = 1.0, 1.5, 1e-2


STRIBECK, COULOMB = Curve(F_C, F_S, 1 / NU_S), Curve(F_C, F_C, 0.0)


LUGRE, DAHL = Bristle(1e4, 30.0), Bristle(1e4)


ELEMENTS = MaxwellElements((4e3, 3e3, 2e3, 1e3), (0.1, 0.2, 0.3, 0.4), (0.0,) * 4, 200.0)


DYNAMIC = [LUGRE, DAHL, ELEMENTS]


def motion(seed: int, top: float = 0.2) -> Callable[[np.ndarray], np.ndarray]:
    """v(t), at most `top` rad/s, of a smooth random motion over 1 s with many reversals."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 8)

    def v(t: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * np.arange(1, 9) * np.asarray(t)[..., None] + phases).sum(axis=-1)

    largest = np.abs(v(np.linspace(0, 1, 1000))).max()
    return lambda t: top / largest * v(t)


def taken(law: Law, curve: Curve, v: np.ndarray, viscous: float, step: float) -> float:
    """Energy in J that the law and viscous friction have taken at the worst moment, from unbent bristles."""
    states, _ = Numeric(law, curve, step).follow(v)
    torque = Numeric(law, curve).torque.map(len(v))(v[None], states.T).full()[0]
    return float(np.cumsum((torque + viscous * v) * v * step).min())


@pytest.mark.parametrize(("law", "curve"), [(LUGRE, STRIBECK), (DAHL, COULOMB)])
def test_exact_updates_follow_the_differential_equation(law: Bristle, curve: Curve) -> None:
    """Steps of 1 ms are within 2 % of F_c of scipy's Radau; with a tenth of the step the error is 50 times smaller."""
    v, (speed, bend) = motion(1, top=0.05), (ca.SX.sym(name) for name in "vz")
    rate = ca.Function("rate", [speed, bend], [law.rate(speed, bend, curve)])
    ends = np.arange(1, 501) * 1e-3
    radau = solve_ivp(
        lambda t, z: rate(v(t), z).full()[0],
        (0, 0.5),
        [0.0],
        "Radau",
        rtol=1e-9,
        atol=1e-13,
        t_eval=ends,
        max_step=1e-3,
    )
    errors = []
    for parts in (1, 10):
        step = 1e-3 / parts
        states, _ = Numeric(law, curve, step).follow(v((np.arange(500 * parts) + 0.5) * step))
        errors.append(law.sigma_0 * np.abs(states[parts - 1 :: parts, 0] - radau.y[0]).max() / F_C)
    assert errors[0] < 2e-2
    assert errors[1] < errors[0] / 50


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=60), st.floats(1e-6, 0.1))
@settings(deadline=None, max_examples=60)
def test_no_step_takes_bristles_beyond_what_sticks(velocities: list[float], step: float) -> None:
    """|sigma_0 z| <= F_s whatever the velocities and however long the steps; of Maxwell elements nu_i F_s each."""
    v = np.array(velocities)
    for law in (LUGRE, DAHL):
        states, _ = Numeric(law, STRIBECK, step).follow(v)
        assert np.abs(states * law.sigma_0).max() <= F_S * (1 + 1e-12)
    states, _ = Numeric(ELEMENTS, STRIBECK, step).follow(v)
    assert np.all(np.abs(states[:, :4] * ELEMENTS.sigma_0) <= F_S * np.array(ELEMENTS.nu) * (1 + 1e-12))


@pytest.mark.parametrize("law", DYNAMIC)
@pytest.mark.parametrize("v", [-0.5, -0.02, -0.004, 0.004, 0.02, 0.5])
def test_steady_sliding_takes_tustins_torque_in_both_directions(law: Law, v: float) -> None:
    """sgn(v) g(v) + alpha_3 v |v|, to rounding, from rest and from the other direction."""
    curve = Curve(F_C, F_S, 1 / NU_S, 0.3)
    expected = math.copysign(F_C + (F_S - F_C) * math.exp(-((v / NU_S) ** 2)), v) + 0.3 * v * abs(v)
    one = Numeric(law, curve, 1e-3)
    for before in (0.0, -v):
        _, torque = one.follow(np.concatenate([np.full(2000, before), np.full(4000, v)]))
        np.testing.assert_allclose(torque[-1], expected, rtol=1e-9)
    static = Numeric(Tustin(), curve).torque(v, np.zeros(0)).full()[0, 0]
    np.testing.assert_allclose(static, expected, rtol=1 - math.tanh(abs(v) / SLIDING_VELOCITY) + 1e-12)


def test_lugre_drifts_below_break_away_and_maxwell_slip_stays() -> None:
    """Strain cycles about a bent state relax LuGre's torque cycle by cycle; Maxwell slip's loop is closed."""
    bend, cycle = np.full(50, 1e-2), np.tile(np.repeat([-1e-2, 1e-2], 20), 50)
    for law, closed in ((ELEMENTS, True), (Bristle(1e4), False)):
        _, torque = Numeric(law, COULOMB, 1e-3).follow(np.concatenate([bend, cycle]))
        ends = torque[50 + 39 :: 40]
        drift = abs(ends[-1] - ends[0]) + abs(ends[0] - torque[49])
        assert (drift < 1e-9) == closed


def test_at_rest_bristles_are_a_spring_to_ground() -> None:
    """About v = 0, z = 0: dz'/dv = 1, dtau/dz = sigma_0, dtau/dv = sigma_1, so dtau/d(displacement) = sigma_0."""
    v, z = ca.SX.sym("v"), ca.SX.sym("z")
    slopes = ca.Function("slopes", [v, z], [
        ca.jacobian(LUGRE.rate(v, z, STRIBECK), v), ca.jacobian(LUGRE.rate(v, z, STRIBECK), z),
        ca.jacobian(LUGRE.torque(v, z, STRIBECK), v), ca.jacobian(LUGRE.torque(v, z, STRIBECK), z),
        ca.jacobian(LUGRE.advanced(v, z, STRIBECK, 1e-3), v),
    ])  # fmt: skip
    assert [float(one) for one in slopes(0, 0)] == [1.0, 0.0, LUGRE.sigma_1, LUGRE.sigma_0, 1e-3]
    assert LUGRE.at_rest(F_C, F_S) == (LUGRE.sigma_0, LUGRE.sigma_1)
    # The exact update rounds nothing off at small steps: a displacement far below break-away is kept.
    assert abs(Numeric(LUGRE, STRIBECK, 1e-3).follow(np.full(10, 1e-9))[1][-1] / (1e4 * 1e-11 + 30e-9) - 1) < 1e-5


@given(st.integers(0, 10_000), st.sampled_from([0.02, 0.2, 2.0]))
@settings(deadline=None, max_examples=30)
@pytest.mark.slow
def test_what_passes_the_check_gives_no_energy(seed: int, top: float) -> None:
    """Constant sigma_1 with just enough viscous friction, and a falling one at its bound, only take."""
    v = motion(seed, top)((np.arange(20_000) + 0.5) * 5e-5)
    sigma_1 = 30.0
    viscous = sigma_1 * (F_S - F_C) / F_C
    slip = 2 * np.abs(v).max() * 5e-5 * F_S  # the sum is the integral to first order
    Friction(F_C, F_S, NU_S, lugre=LuGre(1e4, sigma_1)).check_passive(viscous)
    assert taken(Bristle(1e4, sigma_1), STRIBECK, v, viscous, 5e-5) > -slip
    v_d = 4 * math.sqrt(2 * math.e) * F_C / sigma_1
    Friction(F_C, F_S, NU_S, lugre=LuGre(1e4, sigma_1, v_d)).check_passive(0.0)
    assert taken(Bristle(1e4, sigma_1, 1 / v_d), STRIBECK, v, 0.0, 5e-5) > -slip


@pytest.mark.parametrize(("part", "gives"), [(0.5, True), (1.0, False)])
def test_what_fails_the_check_gives_energy(part: float, gives: bool) -> None:
    """Bristles bent by slow sliding, then a jump to 100 rad/s: half the viscous friction needed is not enough."""
    sigma_1, step = 30.0, 1e-8
    viscous = part * sigma_1 * (F_S - F_C) / F_C
    slow = Numeric(Bristle(1e4, sigma_1), STRIBECK, 1e-3).follow(np.full(2000, 1e-3))[0][-1]
    fast = np.full(1000, 100.0)
    states, torque = Numeric(Bristle(1e4, sigma_1), STRIBECK, step).follow(fast, slow)
    assert (np.cumsum((torque + viscous * fast) * fast * step).min() < -1e4 * slow[0] ** 2 / 2) == gives
    assert np.all(np.diff(np.abs(states[:, 0])) <= 0)
