"""The friction in viscous numbers of a study, their truth, and friction on the terminal."""

from dataclasses import replace

import numpy as np
import pytest
from plants.taken_friction import taken_friction
from plants.two_mass_gear import RATIO, Gear, robot

from elastid.app.identified_robot import with_findings
from elastid.app.parameter_truth import NOT_SIGNIFICANT, SLOPE, contents, truth
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.nonlinear.basis_functions import GearEffect, along_period
from elastid.nonlinear.gear_result import GearResult, with_effects, with_linear_springs
from elastid.parameters import Parameter, Parameters
from elastid.report.content import WITH_COULOMB
from elastid.robot import Body, Friction, Hysteresis, Joint, Motor, Robot, Spring
from elastid.robot.simplified import with_joints

ROUGH, SMOOTH = Motor(1e-3, 50, 1e-3, coulomb=0.1), Motor(1e-3, 50, 1e-3)
ROBOT = Robot(
    "an elastic axis and two rigid ones",
    (
        Body("a", joints=(Joint("1", "z", Spring(1e4, 10.0), ROUGH, 1.0),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, ROUGH, 1.0),), inertia=1.0),
        Body("c", "b", joints=(Joint("3", "y", None, SMOOTH, 1.0),), inertia=1.0),
    ),
)
NAMES = ("k_1", "fm_1", "fm_1@warm", "f_1", "fm_2", "f_2", "fm_3")
PARAMETERS = Parameters(tuple(Parameter(name, 1e-3) for name in NAMES))


def test_recorded_robot_has_motors_of_unknown_friction() -> None:
    marked = contents(ROBOT, False, taken_friction(), PARAMETERS)
    assert (marked["fm_1"], marked["fm_2"], marked["fm_3"]) == (SLOPE, NOT_SIGNIFICANT, WITH_COULOMB)
    assert "f_1" not in marked
    assert truth(ROBOT, None, ()) is None


def test_viscous_friction_with_coulomb_part_has_no_truth() -> None:
    """The motor's own, and that of a joint which turns rigidly with a motor: a fit is right not to meet them."""
    known = truth(ROBOT, SimulatedSpec(), ())
    assert known is not None
    assert {"k_1", "d_1", "f_1", "fm_3", "f_3"} <= set(known)
    assert not {"fm_1", "fm_2", "f_2"} & set(known)


def test_compensated_coulomb_torque_keeps_viscous_friction_of_motor() -> None:
    """No other dry friction of the file is left."""
    first, second, _ = with_findings(ROBOT, taken_friction(), None).driven
    assert first.motor.friction.coulomb == pytest.approx(4.5 / 50)
    assert first.motor.viscous == pytest.approx(ROUGH.viscous)
    assert second.motor == replace(ROUGH, coulomb=0.0)


FOUND = {
    GearEffect("friction", "1", 1e-3): 20.0,
    GearEffect("behind", "1", 1e-3): 12.0,
    GearEffect("load", "1"): 0.02,
    GearEffect("cubic", "1"): 3e9,
    GearEffect("error sine", "1", 2.0): 3e-5,
    GearEffect("error cosine", "1", 2.0): -4e-5,
    GearEffect("ripple cosine", "1", 6.0): 2.0,
    GearEffect("stop", "1", 1e-4): 5.0,
    GearEffect("bristle", "1", 3e-4): 2.0,
}


def result(found: dict[GearEffect, float]) -> GearResult:
    covariance = np.eye(len(found))
    return GearResult(np.zeros(0), covariance, tuple(found), np.array([*found.values()]))


def test_every_effect_has_its_place() -> None:
    """Friction of the motor on the motor's side, all else on the link's; a sine and a cosine are one error."""
    joint = with_effects(robot(Gear()), result(FOUND)).driven[0]
    assert joint.motor.friction.coulomb == pytest.approx(20.0 / RATIO)
    assert joint.friction == Friction(12.0)
    assert joint.spring.cubic == 3e9
    assert joint.gear.load == 0.02
    (error,), (ripple,) = joint.gear.transmission_error, joint.gear.ripple
    assert (error.amplitude, error.order) == (pytest.approx(5e-5), 2.0)
    assert error.phase == pytest.approx(np.arctan2(-4.0, 3.0))
    assert (ripple.amplitude, ripple.phase) == (2.0, pytest.approx(np.pi / 2))
    assert joint.gear.hysteresis == (Hysteresis(5.0, 1e-4), Hysteresis(2.0, 3e-4, "smooth"))


def test_friction_model_of_file_is_removed_if_not_identified() -> None:
    """The effects add to straight springs: a gap of the file beside the one that was found would count twice."""
    worn = with_joints(
        robot(Gear()), lambda joint: replace(joint, spring=replace(joint.spring, backlash=2e-4, cubic=1e9))
    )
    assert with_effects(worn, result({})).driven[0].spring == robot(Gear()).driven[0].spring


def test_softening_spring_keeps_stiffness_at_zero_torque() -> None:
    """A softening of the records' torques has no place in a robot's file, which holds at every torque."""
    joint = with_effects(robot(Gear()), result({GearEffect("cubic", "1"): -1e9})).driven[0]
    assert joint.spring.is_linear
    hard = with_effects(robot(Gear()), result({GearEffect("progressive", "1"): 1e7}))
    assert hard.driven[0].spring.symmetric_quadratic == 1e7
    assert with_linear_springs(hard).driven[0].spring.is_linear


@pytest.mark.parametrize(("kind", "level"), [("gap", 1.5e5), ("gap", 2e5), ("range", 6e4)])
def test_identified_backlash_and_range_give_piecewise_linear_spring(kind: str, level: float) -> None:
    """k x less f clip(x), or more f beyond b, but for the rounded ends."""
    k, b = 2e5, 3e-4
    stiff = with_joints(robot(Gear()), lambda joint: replace(joint, spring=Spring(k, 60.0)))
    found = result({GearEffect(kind, "1", b): level})
    spring = with_effects(stiff, found).driven[0].spring
    x = np.array([0.2, 0.6, 1.6, 4.0]) * b
    effect = GearEffect(kind, "1", b)
    torque = k * x + level * along_period(effect, x)[0]
    e = spring.rounding * b
    beyond = (np.sqrt((x - b) ** 2 + e**2) - np.sqrt((x + b) ** 2 + e**2)) / 2 + x  # a dead zone of half width b
    ours = spring.stiffness * beyond + spring.inner_stiffness * (x - beyond)
    np.testing.assert_allclose(ours, torque, atol=0.02 * k * b)
    within = spring.inner_stiffness or spring.stiffness
    assert with_linear_springs(with_effects(stiff, found)).driven[0].spring == Spring(within, 60.0)
