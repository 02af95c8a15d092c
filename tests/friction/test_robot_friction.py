"""The friction of a robot on the link side, under load and temperature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plants.friction_laws import Numeric

from elastid.friction.dynamic import Bristle, MaxwellElements, SwitchedMaxwellSlip
from elastid.friction.law import Curve
from elastid.friction.robot_friction import coulomb_levels, frictions
from elastid.friction.static import Tustin
from elastid.robot import (
    Body,
    Friction,
    Joint,
    LoadDependence,
    LuGre,
    MaxwellSlip,
    Motor,
    Robot,
    Spring,
    TemperatureDependence,
)


def test_friction_of_a_robot_is_seen_from_the_link() -> None:
    """Torques times |ratio|, stiffness and damping times its square, velocities divided by it; joints as they are."""
    n = 50.0
    lugre = Friction(0.5, 0.7, 2.0, 1e-4, lugre=LuGre(30.0, 0.01, 5.0))
    slip = Friction(9.0, maxwell_slip=MaxwellSlip((1e4, 2e4), (0.4, 0.6), 100.0, switching="events"))
    robot = Robot("r", (
        Body("a", joints=(Joint("1", "z", Spring(1e5), Motor(1e-3, -n, friction=lugre), friction=slip),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, Motor(1e-3, n, 0, 0.3), friction=Friction(4.0)),), inertia=1.0),
    ))  # fmt: skip
    first, second, third, fourth = frictions(robot)
    assert [one.place for one in (first, second, third, fourth)] == ["motor 1", "motor 2", "joint 1", "joint 2"]
    np.testing.assert_allclose(first.curve(), [25, 35, n / 2, 1e-4 * n**3, 0])
    assert first.law == Bristle(30 * n**2, 0.01 * n**2, n / 5)
    assert second.law == Tustin()
    assert third.law == SwitchedMaxwellSlip(MaxwellElements((1e4, 2e4), (0.4, 0.6), (0.0, 0.0), 100.0))
    np.testing.assert_allclose(coulomb_levels(robot), [25, 15 + 4])
    # Power is the same on both sides.
    v, z = 0.02, 1e-5
    motor = Numeric(Bristle(30.0, 0.01, 1 / 5), Curve(0.5, 0.7, 1 / 2, 1e-4)).torque(n * v, n * z)
    link = Numeric(first.law, Curve(*first.curve().tolist())).torque(v, z)
    np.testing.assert_allclose(float(link), n * float(motor), rtol=1e-12)


def test_load_and_temperature_change_the_curve() -> None:
    """Affine in |load|; stiction and Stribeck velocity affine, viscous friction exponential in temperature."""
    n = 100.0
    warm = TemperatureDependence(25.0, stiction=0.01, stribeck_velocity=0.1, viscous=0.02, decay=20.0)
    spec = Friction(0.5, 0.8, 2.0, load=LoadDependence(0.01, 0.03), temperature=warm)
    robot = Robot("r", (Body("a", joints=(Joint("1", "z", motor=Motor(1e-3, n, 0.03, friction=spec)),), inertia=1.0),))
    (one,) = frictions(robot)
    np.testing.assert_allclose(one.curve(-300.0)[:2], [50 + 3, 80 + 9])
    np.testing.assert_allclose(
        one.curve(0, 45.0), [50, 80 + 0.2 * n, n / 4.0, 0, n**2 * 0.02 * (math.exp(-1) - 1)], rtol=1e-12
    )
    np.testing.assert_allclose(one.curve(0, 25.0, level=1.2)[[0, 1, 4]], [60, 96, 0])
    with pytest.raises(ValueError, match=r"friction of motor 1 .* at -20 degC: stiction falls to 0.35 N"):
        one.curve(0, -20.0)
