"""The friction of a robot on the link side, under load and temperature."""

import math
from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from plants import published_friction as p
from plants.friction_laws import Numeric, placed

from elastid.friction.dynamic import Bristle, MaxwellElements
from elastid.friction.robot_friction import PlacedLaw, coulomb_torques, frictions
from elastid.friction.static import Curve, Tustin
from elastid.robot import (
    Body,
    Directions,
    Friction,
    Joint,
    LoadDependence,
    LuGre,
    MaxwellSlip,
    MeasuredRange,
    Motor,
    Robot,
    Spring,
    TemperatureDependence,
)


def test_friction_of_a_robot_is_seen_from_the_link() -> None:
    """Torques times |ratio|, stiffness and damping times its square, velocities divided by it; joints as they are."""
    n = 50.0
    lugre = Friction(0.5, 0.7, 2.0, 1e-4, lugre=LuGre(30.0, 0.01, 5.0))
    slip = Friction(9.0, maxwell_slip=MaxwellSlip((1e4, 2e4), (0.4, 0.6), 100.0))
    robot = Robot("r", (
        Body("a", joints=(Joint("1", "z", Spring(1e5), Motor(1e-3, -n, friction=lugre), friction=slip),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, Motor(1e-3, n, 0, 0.3), friction=Friction(4.0)),), inertia=1.0),
    ))  # fmt: skip
    first, second, third, fourth = frictions(robot)
    assert [one.place for one in (first, second, third, fourth)] == ["motor 1", "motor 2", "joint 1", "joint 2"]
    np.testing.assert_allclose(first.curve(), [25, 35, n / 2, 1e-4 * n**3, 0, 0, 0, 0, 0])
    assert first.law == Bristle(30 * n**2, 0.01 * n**2, n / 5)
    assert second.law == Tustin()
    assert third.law == MaxwellElements((1e4, 2e4), (0.4, 0.6), (0.0, 0.0), 100.0)
    np.testing.assert_allclose(coulomb_torques(robot), [25, 15 + 4])
    # Power is the same on both sides.
    v, z = 0.02, 1e-5
    motor = Numeric(Bristle(30.0, 0.01, 1 / 5), Curve(0.5, 0.7, 1 / 2, 1e-4)).torque(n * v, n * z)
    link = Numeric(first.law, Curve(*first.curve().tolist())).torque(v, z)
    np.testing.assert_allclose(float(link), n * float(motor), rtol=1e-12)


def test_load_and_temperature_change_the_curve() -> None:
    """Affine in |load|; dry friction and Stribeck velocity affine, viscous friction exponential in temperature."""
    n = 100.0
    warm = TemperatureDependence(25.0, stiction=0.01, stribeck_velocity=0.1, viscous=0.02, decay=20.0, coulomb=0.002)
    spec = Friction(0.5, 0.8, 2.0, load=LoadDependence(0.01, 0.03), temperature=warm)
    robot = Robot("r", (Body("a", joints=(Joint("1", "z", motor=Motor(1e-3, n, 0.03, friction=spec)),), inertia=1.0),))
    (one,) = frictions(robot)
    np.testing.assert_allclose(one.curve(-300.0)[:2], [50 + 3, 80 + 9])
    np.testing.assert_allclose(
        one.curve(0, 45.0)[:5], [54, 80 + 0.24 * n, n / 4.0, 0, n**2 * 0.02 * (math.exp(-1) - 1)], rtol=1e-12
    )
    with pytest.raises(ValueError, match=r"friction of motor 1 .* at -20 degC: stiction falls to 0.26 N"):
        one.curve(0, -20.0)
    thawed = replace(spec, temperature=replace(warm, stiction=0.0, coulomb=-0.03))
    with pytest.raises(ValueError, match=r"at 45 degC: Coulomb friction falls to -0.1 N"):
        placed(thawed).curve(0, 45.0)


def sliding(one: PlacedLaw, v: float, load: float = 0.0, temperature: float | None = None) -> float:
    """Torque of steady sliding at v rad/s of the link."""
    curve = one.symbols(list(ca.vertsplit(ca.SX(one.curve(load, temperature)))))
    return float(ca.DM(curve.torque(v))) * np.sign(v) + float(ca.DM(curve.growing(v)))


def test_the_published_law_of_a_large_robot_is_held_exactly() -> None:
    """tau_f of a joint both ways at speeds, loads and temperatures, in parts of 26 Nm on the motor's side."""
    T_0 = 40.0
    fading = p.ALPHA_T * math.exp(-T_0 / p.T_V)
    load = LoadDependence(p.F_CL, p.F_CL + p.F_SL, p.NU_L)
    warm = TemperatureDependence(T_0, p.D_ST, p.NU_T, fading, p.T_V)
    law = Friction(
        p.F_C, p.F_C + p.D_S + p.D_ST * T_0, p.NU_0 + p.NU_T * T_0, 0.0, p.EXPONENT, load=load, temperature=warm
    )
    one, levels = placed(law), p.published_levels((0.5, 12.0, 250.0), (0.0, 0.35, 1.0), (33.0, 52.0, 80.0))
    for v, L, T, torque in zip(levels.speed, levels.load, levels.temperature, levels.torque, strict=True):
        for s in (1.0, -1.0):
            assert sliding(one, s * v, L, T) + (p.ALPHA + fading) * s * v == pytest.approx(s * torque, rel=1e-10)


@pytest.mark.parametrize("n", [1.0, 40.0, -40.0])
def test_two_directions_have_levels_and_slopes_of_their_own(n: float) -> None:
    """F_c + c and F_c - c, viscous d more and d less; a gear that reverses exchanges them for the link."""
    one = placed(Friction(2.0, directions=Directions(0.3, 0.5)), n)
    for v_motor in (7.0, -7.0):
        s = np.sign(v_motor)
        on_motor = (2.0 + 0.3 * s) * s + 0.5 * abs(v_motor)
        np.testing.assert_allclose(sliding(one, v_motor / n), n * on_motor, rtol=1e-12)


def test_bristles_slide_at_the_level_of_their_direction() -> None:
    """A LuGre law pulled steadily either way ends at the level of that way."""
    one = placed(Friction(2.0, directions=Directions(0.3), lugre=LuGre(1e3)))
    curve = one.symbols(list(ca.vertsplit(ca.SX(one.curve()))))
    for v, level in ((1.0, 2.3), (-1.0, -1.7)):
        _, torque = Numeric(one.law, curve).follow(np.full(2000, v))
        np.testing.assert_allclose(torque[-1], level, rtol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "numbers"),
    [
        (lambda: Friction(1.0, exponent=0.1), "0.1"),
        (lambda: Friction(1.0, directions=Directions(1.0)), "1 .* 1,"),
        (lambda: placed(Friction(1.0, directions=Directions(viscous=11.0))), "11 .* 10,"),
        (lambda: LoadDependence(0.1, 0.1, 2.0), "0.1 .* 0.1"),
        (lambda: MeasuredRange(speed=(2.0, 1.0)), r"\[2, 1\]"),
    ],
)
def test_laws_that_cannot_be_are_refused(wrong: Callable[[], object], numbers: str) -> None:
    with pytest.raises(ValueError, match=numbers):
        wrong()
