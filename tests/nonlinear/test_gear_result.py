"""Effects of gears as a robot's file has them, and the fit of a robot whose springs have ends."""

from dataclasses import replace

import numpy as np
import pytest
from nonlinear.test_gear_characteristics import PARAMETERS, plain_fit
from plants.two_mass_gear import RATIO, Gear, robot

from elastid.nonlinear.basis_functions import GearEffect, Kind, along_period
from elastid.nonlinear.gear_result import GearResult
from elastid.nonlinear.robot_with_gears import with_effects, with_linear_springs, with_terms_of
from elastid.parameters import Parameter, Parameters
from elastid.robot import Robot, Spring
from elastid.robot.simplified import with_joints

K, D = 2e5, 60.0


def with_magnitudes(*effects: tuple[Kind, float, float], joint: str = "1") -> Robot:
    """The robot with kinds, scales and magnitudes of effects at a joint."""
    every = tuple(GearEffect(kind, joint, scale) for kind, scale, _ in effects)
    magnitudes = np.array([f for *_, f in effects])
    return with_effects(robot(Gear()), GearResult(PARAMETERS.x, np.eye(2 + len(every)), every, magnitudes))


def test_every_effect_has_its_place_in_the_robot() -> None:
    """Friction before the gear on the motor's side, all others on the link side; sine and cosine as one wave."""
    (joint,) = with_magnitudes(
        ("friction", 1e-3, 0.5), ("behind", 0.0, 0.8), ("load", 1e-3, 0.1), ("stop", 1e-4, 3.0), ("bristle", 2e-4, 0.4),
        ("error sine", 2.0, 3e-5), ("error cosine", 2.0, 4e-5), ("ripple cosine", 1.0, 0.7), ("cubic", 0.0, 4e9),
    ).driven  # fmt: skip
    assert joint.motor.dry_friction.coulomb == pytest.approx(0.5 / RATIO)
    assert joint.friction.coulomb == 0.8
    assert (joint.spring.stiffness, joint.spring.damping, joint.spring.cubic) == (K, D, 4e9)
    assert joint.gear.load == 0.1
    assert [(one.torque, one.deflection, one.edge) for one in joint.gear.hysteresis] == [
        (3.0, 1e-4, "sharp"), (0.4, 2e-4, "smooth")
    ]  # fmt: skip
    (error,), (ripple,) = joint.gear.transmission_error, joint.gear.ripple
    assert (error.amplitude, error.order, error.phase) == pytest.approx((5e-5, 2.0, np.arctan2(4, 3)))
    assert (ripple.amplitude, ripple.order, ripple.phase) == pytest.approx((0.7, 1.0, np.pi / 2))


def test_active_magnitudes_and_foreign_effects_are_excluded() -> None:
    """Negative friction and hysteresis, waves of size 0, and any effect at a joint that the robot lacks."""
    driving = [("friction", 1e-3, -1.0), ("behind", 0.0, -1.0), ("load", 1e-3, -0.1), ("stop", 1e-4, -3.0)]
    (joint,) = with_magnitudes(*driving, ("error sine", 1.0, 0.0)).driven
    assert (joint.motor.dry_friction, joint.friction, joint.gear, joint.spring) == (None, None, None, Spring(K, D))
    assert with_magnitudes(("friction", 1e-3, 2.0), ("cubic", 0.0, 4e9), joint="2") == with_magnitudes()


@pytest.mark.parametrize(
    ("effects", "spring"),
    [
        ([("gap", 1e-4, 0.5)], Spring(K, D, backlash=1e-4, inner_stiffness=K - 0.5, rounding=0.02)),
        ([("gap", 1e-4, 2 * K)], Spring(K, D, backlash=1e-4, inner_stiffness=0.0, rounding=0.02)),
        ([("range", 2e-4, 1e5)], Spring(3e5, D, backlash=2e-4, inner_stiffness=K, rounding=0.02)),
        ([("range", 2e-4, 1e5), ("range", 4e-4, 1e5)], Spring(K, D)),
        ([("progressive", 0.0, 3e7)], Spring(K, D, symmetric_quadratic=3e7)),
        ([("progressive", 0.0, -3e9), ("cubic", 0.0, 1.0)], Spring(K, D)),
        ([("cubic", 0.0, -1e9)], Spring(K, D)),
    ],
)
def test_springs_have_the_ends_that_a_file_can_state(effects: list[tuple[Kind, float, float]], spring: Spring) -> None:
    """Softer within a gap and stiffer beyond a range; straight with two ranges, or where it softens or would pull."""
    assert with_magnitudes(*effects).driven[0].spring == spring


def test_fit_keeps_end_stiffness_and_robot_terms() -> None:
    """Of a range 1.5 k; a cubic term that the robot lacks is gone, and numbers that were not fitted are fixed."""
    cubic = Parameter("k3_1", 1e9, "N*m/rad^3", free=False)
    ranged = with_magnitudes(("range", 2e-4, 1e5))
    fit = replace(plain_fit(PARAMETERS.x), parameters=Parameters((*PARAMETERS, cubic)))
    restricted = with_terms_of(fit, ranged)
    numbers = restricted.values
    assert (numbers["k_1"], numbers["d_1"]) == (pytest.approx(1.5 * K), pytest.approx(D))
    assert "k3_1" not in numbers
    assert numbers["ki_1"] == pytest.approx(K)
    assert set(restricted.parameters.free_names) == {"k_1", "d_1"}
    assert with_linear_springs(ranged).driven[0].spring == Spring(K, D)


def test_spring_terms_of_the_file_are_replaced() -> None:
    """The effects add to straight springs: a gap of the file beside an identified gap would count twice."""
    worn = with_joints(
        robot(Gear()), lambda joint: replace(joint, spring=replace(joint.spring, backlash=2e-4, cubic=1e9))
    )
    nothing = GearResult(PARAMETERS.x, np.eye(2), (), np.zeros(0))
    assert with_effects(worn, nothing).driven[0].spring == Spring(K, D)


@pytest.mark.parametrize(("kind", "level"), [("gap", 1.5e5), ("gap", 2e5), ("range", 6e4)])
def test_spring_with_ends_has_the_torque_of_its_effect(kind: Kind, level: float) -> None:
    """k x less f clip(x), or more f beyond b, but for the rounded ends."""
    b = 3e-4
    spring = with_magnitudes((kind, b, level)).driven[0].spring
    x = np.array([0.2, 0.6, 1.6, 4.0]) * b
    torque = K * x + level * along_period(GearEffect(kind, "1", b), x)[0]
    e = spring.rounding * b
    beyond = (np.sqrt((x - b) ** 2 + e**2) - np.sqrt((x + b) ** 2 + e**2)) / 2 + x  # a dead zone of half width b
    ours = spring.stiffness * beyond + spring.inner_stiffness * (x - beyond)
    np.testing.assert_allclose(ours, torque, atol=0.02 * K * b)
