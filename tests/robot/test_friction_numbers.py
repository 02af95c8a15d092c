"""Friction has one name and one value for each number, whichever side of the gear its law stands on."""

from dataclasses import replace

import pytest
from plants.refusals import refused

from elastid.friction.robot_friction import frictions
from elastid.robot import Body, Directions, Friction, Joint, LoadDependence, LuGre, MaxwellSlip, Motor, Robot, Spring
from elastid.robot.friction import MeasuredRange
from elastid.robot.friction_numbers import friction_numbers, through_gear, with_numbers

LAW = Friction(
    coulomb=0.5, stiction=0.7, stribeck_velocity=3.0, quadratic=1e-4, exponent=1.3,
    load=LoadDependence(0.02, 0.05, 8.0), directions=Directions(0.05, 1e-3),
    measured=MeasuredRange((0.1, 90.0), (0.0, 4.0), (20.0, 60.0)),
)  # fmt: skip


def robot(law: Friction) -> Robot:
    motor = Motor(1e-3, -100.0, viscous=2e-3, friction=law)
    return Robot("axis", (Body("arm", joints=(Joint("1", spring=Spring(1e4), motor=motor),), mass=3.0, inertia=1.0),))


def test_friction_on_link_side_equals_motor_side() -> None:
    """The curve of the equations of motion is one, from either."""
    link = through_gear(LAW, -100.0, to_motor=False)
    joint = Joint("1", spring=Spring(1e4), motor=Motor(1e-3, -100.0), viscous=20.0, friction=link)
    other = Robot("axis", (Body("arm", joints=(joint,), mass=3.0, inertia=1.0),))
    (at_motor,), (at_joint,) = frictions(robot(LAW)), frictions(other)
    assert at_joint.curve(load=30.0) == pytest.approx(at_motor.curve(load=30.0))
    assert link.measured.speed == pytest.approx((0.001, 0.9))


@pytest.mark.parametrize(
    "law",
    [
        LAW,
        Friction(0.5, lugre=LuGre(300.0, 0.2, 1.0)),
        Friction(0.5, maxwell_slip=MaxwellSlip((100.0, 20.0), (0.4, 0.6), 50.0, (0.1, 0.2))),
    ],
)
def test_there_and_back_through_the_gear_is_the_same_law(law: Friction) -> None:
    back = through_gear(through_gear(law, -80.0, to_motor=False), -80.0, to_motor=True)
    for name, value in vars(law).items():
        if isinstance(value, float):
            assert getattr(back, name) == pytest.approx(value)
    assert frictions(robot(back))[0].curve(5.0) == pytest.approx(frictions(robot(law))[0].curve(5.0))
    assert frictions(robot(back))[0].at_rest() == pytest.approx(frictions(robot(law))[0].at_rest())


def test_numbers_are_replaced_by_name() -> None:
    """All others stay; a name that no number has is refused."""
    values = {"Fc_m1": 40.0, "f_m1": 30.0, "dFc_m1": 2.0}
    changed = {name: value for name, (value, _) in friction_numbers(with_numbers(robot(LAW), values)).items()}
    before = {name: value for name, (value, _) in friction_numbers(robot(LAW)).items()}
    assert changed == pytest.approx(before | values)
    with refused("robot/unknown-name", holds="Fc_m2"):
        with_numbers(robot(LAW), {"Fc_m2": 1.0})
    only = robot(LAW).bodies[0].joints[0].motor
    assert only is not None
    plain = replace(only, coulomb=0.4, friction=None)
    body = replace(robot(LAW).bodies[0], joints=(replace(robot(LAW).bodies[0].joints[0], motor=plain),))
    assert friction_numbers(replace(robot(LAW), bodies=(body,)))["Fc_m1"] == (pytest.approx(40.0), "N*m")
