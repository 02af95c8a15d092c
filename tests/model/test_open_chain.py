"""Gravity compensators in statics and linear model; joints that slide: closed forms, units."""

import math

import numpy as np
import pytest
from plants.refusals import refused

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Anchor, Body, CoilSpring, Compensator, GasSpring, Joint, Motor, Robot, Spring

MASS, LENGTH, G = 100.0, 0.8155, 9.81
WEIGHT = MASS * LENGTH * G  # 800 Nm
A, B = 0.5, 0.4


def arm(*compensators: Compensator, gravity: float = G) -> Robot:
    """An upright arm at angle 0, turning about y, rigidly driven: m g l = 800 Nm."""
    joint = Joint("1", "y", motor=Motor(1e-3, 100))
    body = Body("arm", joints=(joint,), mass=MASS, center_of_mass=(0, 0, LENGTH), inertia=5.0)
    return Robot("arm", (body,), (0.0, 0.0, -gravity), compensators=compensators)


def balancer(rest_length: float, a: float = A, b: float = B) -> Compensator:
    """From a point a above the axis to a point b up the arm, k a b = m g l."""
    ends = Anchor("base", (0, 0, a)), Anchor("arm", (0, 0, b))
    return Compensator("c", ends, coil=CoilSpring(WEIGHT / (a * b), rest_length))


def holding(robot: Robot, angles: np.ndarray) -> np.ndarray:
    """Torque of the motor that holds each angle."""
    model = serial(robot)
    return np.array([equilibrium(model, model.theta, Configuration("c", (angle,))).u[0] for angle in angles])


ANGLES = np.linspace(-3.1, 3.1, 63)


@pytest.mark.parametrize(("a", "b"), [(0.5, 0.4), (0.4, 0.4)])
def test_a_spring_without_rest_length_cancels_gravity_at_every_angle(a: float, b: float) -> None:
    """L0 = 0 and k a b = m g l: nothing is left to hold, nor to stiffen, even where the two ends meet."""
    robot = arm(balancer(0.0, a, b))
    assert np.abs(holding(arm(), ANGLES)).max() == pytest.approx(WEIGHT, rel=2e-3)
    angles = np.append(ANGLES, 0.0)
    np.testing.assert_allclose(holding(robot, angles), 0.0, atol=1e-6)
    model = serial(robot)
    for angle in angles:
        assert abs(float(model.stiffness([angle], [], model.theta))) < 1e-6 * WEIGHT


def test_compensator_forces_are_energy_derivatives() -> None:
    """dV/dq written out against CasADi's gradient of V, and K against differences, for all kinds in a tree."""
    gas = {"force": 800.0, "length": 0.5, "column": 0.8}
    robots = [
        arm(Compensator("c", (Anchor("base", (-0.2, 0.1, 0.3)), Anchor("arm", (0.3, 0, 0.1))), **kind))
        for kind in (
            {"coil": CoilSpring(3e4, 0.2)},
            {"gas": GasSpring(**gas)},
            {"gas": GasSpring(**gas, kappa=1.4)},
            {"gas": GasSpring(**gas, kappa=1.0 + 1e-9, action="draw")},
            {"gas": GasSpring(**gas, kappa=1.3, action="draw")},
        )
    ]
    for robot in robots:
        model = serial(robot)
        for angle in (-2.0, -0.3, 0.9, 2.5):
            f = float(model.force([angle], [0.0], model.theta))
            assert f == pytest.approx(float(model.potential_gradient([angle], model.theta)), rel=1e-11)
            h = 1e-5
            up, down = (float(model.force([angle + side * h], [0.0], model.theta)) for side in (1, -1))
            assert float(model.stiffness([angle], [], model.theta)) == pytest.approx((up - down) / (2 * h), rel=1e-6)


def test_the_counterbalance_of_a_kuka_kr300_equals_its_formula() -> None:
    """Isothermal nitrogen in a cylinder that axis 2 draws (Weigand et al. 2021), at -140 to -20 degrees."""
    D, k = 0.8, 0.2
    area = math.pi * (0.055**2 - 0.030**2) / 4
    pressure_volume = 1.01 * 296.8 * 328 * 2 * 0.0795
    v_max = 2 * 0.00048
    angles = np.radians(np.arange(-140.0, -19.0, 10.0))
    delta = angles + math.radians(95)
    L = np.sqrt(D**2 + k**2 - 2 * D * k * np.cos(delta))
    p = pressure_volume / (v_max - (L - (D - k)) * area)
    expected = D * k * np.sin(delta) / L * p * area
    gas = GasSpring(pressure_volume / v_max * area, D - k, v_max / area, 1.0, "draw")
    # About y a point at -z' of the arm: the arm's end turns by delta from the line between axis and anchor.
    turned = (k * math.sin(math.radians(95)), 0.0, k * math.cos(math.radians(95)))
    robot = arm(Compensator("c", (Anchor("base", (0, 0, D)), Anchor("arm", turned)), gas=gas), gravity=0.0)
    np.testing.assert_allclose(holding(robot, angles), expected, rtol=1e-10, atol=1e-6)
    measured_bar = np.array([170, 167, 164, 162, 164, 170, 180, 190, 200])
    np.testing.assert_allclose(p[2:11] / 1e5, measured_bar, rtol=0.05)


def test_wrong_compensators_are_refused() -> None:
    ends = Anchor("base"), Anchor("arm", (0, 0, 0.3))
    coil, gas = CoilSpring(1e4), GasSpring(1e3, 0.5, 0.4)
    with pytest.raises(ValueError, match="compensator c: give one of coil and gas"):
        Compensator("c", ends)
    with pytest.raises(ValueError, match="compensator c: give one of coil and gas"):
        Compensator("c", ends, coil, gas)
    with pytest.raises(ValueError, match=r"compensator c: .* arm"):
        Compensator("c", (ends[1], ends[1]), coil)
    with pytest.raises(ValueError, match="compensator c: no body is called fore; there are base, arm"):
        arm(Compensator("c", (ends[0], Anchor("fore")), coil))
    with pytest.raises(ValueError, match="compensator c is given twice"):
        arm(Compensator("c", ends, coil), Compensator("c", ends, gas=gas))


def test_a_gas_spring_beyond_its_end_is_refused() -> None:
    """Drawn further than its gas column is long, the pressure is not a number: the message says what to look at."""
    gas = GasSpring(1e3, 0.2, 0.1, 1.2, "draw")
    robot = arm(Compensator("c", (Anchor("base", (0, 0, 0.5)), Anchor("arm", (0, 0, 0.4))), gas=gas))
    model = serial(robot)
    with refused("robot/no-equilibrium", place="configuration down"):
        equilibrium(model, model.theta, Configuration("down", (3.0,)))


def slide(**changes: object) -> Robot:
    """A carriage of 40 kg on a screw of 5 mm pitch, a load of 25 kg behind an elastic translation."""
    screw = 2 * np.pi / 0.005  # rad of the motor per m
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, screw, 1e-4), 20.0, motion="translation")
    elastic = Joint("e", (1, 0, 0), Spring(8e5, 100.0), motion="translation")
    bodies = (Body("carriage", joints=(joint,), mass=40), Body("load", "carriage", joints=(elastic,), mass=25))
    return Robot("slide", bodies, **changes)
