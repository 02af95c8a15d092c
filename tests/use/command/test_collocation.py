"""A planned move is the closed form of an elastic axis, keeps limits, and is exact where joints bend by themselves."""

from dataclasses import replace

import numpy as np
import pytest
from plants.commanded_arm import arm, move, rigid_gears

from elastid.robot import Body, Frame, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.robot.simplified import with_joints
from elastid.use.commanded_robot import CommandedRobot
from elastid.use.moves import MotionLimits, point_to_point
from elastid.use.trajectory_optimisation import (
    best_plan,
    first_duration,
    plan,
    planned_error,
    rigid_references,
    sample_plan,
)
from elastid.use.tune import MoveRobots, tune_move

J_l, J_m, k, f_m = 2.0, 1.0, 2e3, 5.0
TOOL = Frame("tool", "arm", Placement((1.0, 0, 0)))
AXIS = Joint("1", "z", Spring(k, 0.0), Motor(J_m / 100, 10.0, f_m / 100))
ELASTIC = Robot("axis", (Body("arm", joints=(AXIS,), inertia=J_l),), frames=(TOOL,))


@pytest.mark.parametrize(("kind", "order", "load"), [
    ("velocity", 1, 1.0), ("acceleration", 2, 1.0), ("jerk", 3, 1.0), ("torque", 2, J_l + J_m),
])  # fmt: skip
def test_first_duration_exceeds_rigid_need_by_tenth(kind: str, order: int, load: float) -> None:
    own = point_to_point(np.array([0.0]), np.array([0.6]), 1.0)
    limits = replace(MotionLimits.of(ELASTIC), **{kind: np.array([2.0])})
    T = first_duration(CommandedRobot.of(ELASTIC, "tool", own.ends[0]), own, limits) / 1.1
    assert load * np.abs(own.in_time(T).at(np.linspace(0, T, 201), order)).max() == pytest.approx(2.0, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("k", "end"), [(2e4, 0.6), (2e2, 0.2)])
def test_shortest_time_just_keeps_error(k: float, end: float) -> None:
    """3 % less time exceed it; shorter and longer than that of the rigid axis."""
    robot = with_joints(ELASTIC, lambda joint: replace(joint, spring=Spring(k, 0.0), limits=Limits(velocity=2.0)))
    own = point_to_point(np.array([0.0]), np.array([end]), 0.0)
    asked = MoveRobots(robot, robot, robot, "truth", (), "tool", 500.0, 4.0, 1e-3)
    tuned = tune_move(asked, own, "axis")
    assert (
        tuned.predicted_error.max()
        <= 1e-3
        < tune_move(asked, own.in_time(0.97 * tuned.duration), "axis").predicted_error.max()
    )
    first_s = first_duration(CommandedRobot.of(robot, "tool", own.ends[0]), own, MotionLimits.of(robot))
    assert (tuned.duration > first_s) == (k < 1e3)


def test_an_elastic_axis_is_commanded_by_its_closed_form() -> None:
    """u = J_m q_m'' + f_m q_m' + J_l q_l'', q_m = q_l + J_l q_l'' / k of a flat output without damping.

    Of rigid feedforward, held from sample to sample, in the middle of each.
    """
    own = point_to_point(np.array([0.0]), np.array([0.6]), 1.0)
    commanded = CommandedRobot.of(ELASTIC, "tool", own.ends[0])
    planned = plan(commanded, own, MotionLimits.of(ELASTIC), 0.05)
    t = np.linspace(0.0, 1.0, 101)
    link, rate, a, snap = (own.at(t, order)[:, 0] for order in (0, 1, 2, 4))
    motor_v, motor_a = rate + J_l * own.at(t, 3)[:, 0] / k, a + J_l * snap / k
    q = planned.q(t)
    np.testing.assert_allclose(q[:, 1], link + J_l * a / k, atol=2e-5)
    torque = commanded.torque(q, planned.q(t, 1), planned.q(t, 2))[:, 0]
    expected = J_m * motor_a + f_m * motor_v + J_l * a
    assert np.abs(torque - expected).max() < 0.01 * np.abs(expected).max()
    rigid, middle = rigid_references(ELASTIC, commanded, own, t).torque, t + 0.005
    np.testing.assert_allclose(rigid, (J_l + J_m) * own.at(middle, 2) + f_m * own.at(middle, 1), atol=1e-9)


@pytest.mark.parametrize("robot", [arm(), rigid_gears(arm())])
def test_tool_behind_passive_spring_stays_on_path(robot: Robot) -> None:
    """Under gravity, with gears elastic or rigid: to a micrometre, where the rigid command leaves it by millimetres."""
    own = move(0.8)
    commanded = CommandedRobot.of(robot, "tool", own.ends[0])
    planned = best_plan(commanded, own, MotionLimits.of(replace_limits(robot, Limits())), 0.1)
    assert planned.has_converged
    assert planned_error(commanded, own, planned).max() < 2e-6
    t = np.linspace(-0.1, 0.9, 400)
    force = commanded.balance.map(400)(planned.q(t).T, planned.q(t, 1).T, planned.q(t, 2).T, np.zeros((0, 400)))[0]
    free = force.full()[~commanded.model.B.any(axis=1)]
    assert np.abs(free).max() < 2e-3 * np.abs(force.full()).max()  # the equations hold between the knots, too


@pytest.mark.slow
def test_limits_hold_where_they_keep_the_tool_off_its_path() -> None:
    """Of torque and velocity: with less of both the error grows, and they are never exceeded by half a per cent."""
    own, errors = move(0.4), []
    for torque, velocity in ((700.0, 3.0), (480.0, 2.5)):
        limits = Limits(torque=torque, velocity=velocity, jerk=3e3, acceleration=60.0)
        robot = replace_limits(arm(), limits)
        commanded = CommandedRobot.of(robot, "tool", own.ends[0])
        bounds = MotionLimits.of(robot)
        planned = best_plan(commanded, own, bounds, 0.1)
        assert planned.has_converged, planned.status
        used = sample_plan(commanded, planned, 500.0, 0.0).use(bounds)
        # Friction turns around within a sample where the plan lets it do so gradually.
        assert all(float(part.max()) <= 1.02 for part in used.values()), {k: v.max() for k, v in used.items()}
        errors.append(float(planned_error(commanded, own, planned).max()))
    assert errors[1] > errors[0]


def replace_limits(robot: Robot, limits: Limits) -> Robot:
    """The robot with these limits of its driven joints."""
    return with_joints(robot, lambda joint: joint if joint.motor is None else replace(joint, limits=limits))
