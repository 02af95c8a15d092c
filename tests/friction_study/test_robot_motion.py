"""Friction of joints that move together, beside a rigid body whose numbers are not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.friction_study.joint_levels import check_torques
from elastid.friction_study.motion_signals import Motion
from elastid.friction_study.robot_motion import RobotLog, regress_robot_motion, torques_in_file
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import Body, Joint, Motor, Placement, Robot

RATE = 250.0
COULOMB, VISCOUS = (9.0, 5.0), (14.0, 6.0)


def two_axes() -> Robot:
    """Two axes under gravity; the second is at the end of an arm of the first."""
    motor = Motor(inertia=1e-3, ratio=100.0)
    arm = {"mass": 12.0, "center_of_mass": (0.3, 0.05, 0.0), "inertia": (0.1, 0.5, 0.5)}
    upper = Body("upper", joints=(Joint("1", "y", motor=motor),), **arm)  # type: ignore[arg-type]
    lower = Body(
        "lower", "upper", Placement((0.6, 0.0, 0.0)), joints=(Joint("2", "y", motor=motor),), **arm  # type: ignore[arg-type]
    )  # fmt: skip
    return Robot(name="two axes", bodies=(upper, lower))


def motion(seed: int, noise: float = 0.5, missing: float = 0.0) -> dict[str, Motion]:
    """20 s of both axes, torque noise correlated over 0.1 s; missing: Nm of a spring that no rigid body has."""
    rng, robot = np.random.default_rng(seed), two_axes()
    t = np.arange(round(20 * RATE)) / RATE
    w = 2 * np.pi * np.array([0.15, 0.4, 0.7])
    phase, size = rng.uniform(0, 6, (2, 3, 1)), np.array([0.5, 0.25, 0.1])[:, None]
    q, v, a = (
        np.sum(factor * np.sin(w[:, None] * t + phase + shift), axis=1)
        for factor, shift in ((size, 0.0), (size * w[:, None], np.pi / 2), (-size * w[:, None] ** 2, 0.0))
    )
    theta = np.array([value for value, _ in robot.parameters().values()])
    rigid = inverse_dynamics(robot)(q, v, a, np.tile(theta[:, None], len(t))).full()
    rubbing = np.array(COULOMB)[:, None] * np.sign(v) + np.array(VISCOUS)[:, None] * v
    slow = np.array(
        [np.convolve(row, np.exp(-np.arange(100) / 25), "same") / 4 for row in rng.standard_normal(q.shape)]
    )
    torque: FloatArray = rigid + rubbing + noise * slow + missing * np.sin(5 * q)
    return {name: Motion(f"joint {name}", RATE, q[i], torque[i]) for i, name in enumerate(("1", "2"))}


def test_friction_is_found_beside_a_rigid_body_that_is_not_known() -> None:
    """Ten logs: unbiased, and most of the 95 % intervals hold the truth."""
    robot, errors, held = two_axes(), [], []
    for seed in range(10):
        found = regress_robot_motion(robot, [RobotLog(motion(seed), {})]).friction
        for i, joint in enumerate(("1", "2")):
            fit = found[joint].alike
            for name, truth in (("coulomb", COULOMB[i]), ("viscous", VISCOUS[i])):
                errors.append((fit[name] - truth) / fit.std(name))
                held.append(abs(errors[-1]) < 1.96)
            assert found[joint].notes[0].severity == "information"
    assert np.mean(held) >= 0.85
    assert abs(np.mean(errors)) < 0.7


def test_two_logs_know_more_than_one_and_the_rest_is_free_of_the_rigid_body() -> None:
    robot, logs = two_axes(), [RobotLog(motion(seed), {}) for seed in (1, 2)]
    one, both = regress_robot_motion(robot, logs[:1]), regress_robot_motion(robot, logs)
    assert both.friction["1"].alike.std("viscous") < one.friction["1"].alike.std("viscous")
    alone = both.alone[1]["2"]
    v = np.gradient(alone.position, 1 / RATE)
    left = alone.torque - COULOMB[1] * np.sign(v) - VISCOUS[1] * v
    assert np.std(left[200:-200]) < 0.1 * np.std(logs[1].motions["2"].torque)


def test_what_the_rigid_body_lacks_is_said() -> None:
    found = regress_robot_motion(two_axes(), [RobotLog(motion(3, missing=20.0), {})]).friction["1"]
    (note,) = found.notes
    assert (note.code, note.severity) == ("rigid-body-error", "warning")
    assert "hold only together with it" in note.text
    assert "of what friction takes" in note.text
    assert "directions.coulomb" in [held.part for held in found.held]


def test_torque_of_the_wrong_sign_is_refused() -> None:
    turned = {name: replace(each, torque=-each.torque) for name, each in motion(4).items()}
    with pytest.raises(DataError, match=r"friction drives .* turn one channel"):
        regress_robot_motion(two_axes(), [RobotLog(turned, {})])


def test_torques_of_the_motors_are_not_taken_for_those_of_the_joints() -> None:
    """Whatever friction takes beside the rigid body, right torques are not refused."""
    robot, log = two_axes(), motion(5)
    expected = torques_in_file(robot, RobotLog(log, {}))
    torques = {name: each.torque for name, each in log.items()}
    check_torques(robot, torques, expected, "log.csv")
    check_torques(robot, {name: 0.3 * torque for name, torque in torques.items()}, expected, "log.csv")
    for factor, word in ((1 / 100, "of the motors: give their channels side: motor"), (100.0, "leave side: motor out")):
        with pytest.raises(DataError, match=word):
            check_torques(robot, {name: factor * torque for name, torque in torques.items()}, expected, "log.csv")
