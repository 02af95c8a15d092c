"""Closed postures of linkages: on the branch of the start, or refused with what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.linkages import LEVER, LOWER, linkage

from elastid.base.errors import StudyError
from elastid.linear.equilibrium import equilibrium
from elastid.model.closed_posture import assembled, followed, rates
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Joint, Motor, Robot, Rod, Spring

PARALLELOGRAM = linkage(Rod(LOWER, 6.2, 0.52, 0.64))
FOUR_BAR = linkage(Rod(0.86, 6.2, 0.4, 0.5), crank=0.33)


def test_the_start_decides_how_a_loop_is_put_together_and_it_stays_so() -> None:
    """The other branch of a four-bar is another mechanism, followed to the same configuration."""
    robot, at = FOUR_BAR, Configuration("c", (0.5, 0.3))
    *others, upper = robot.bodies
    flipped = replace(robot, bodies=(*others, replace(upper, joints=(Joint("elbow", "y", start=2.6),))))
    elbows = []
    for one in (robot, flipped):
        model = formulate(one)
        point = equilibrium(model, model.theta, at)
        assert np.abs(model.constraint(point.q, model.theta).full()).max() < 1e-10
        elbows.append(point.q[model.index("joint elbow")])
    assert abs(elbows[1] - elbows[0]) > 1.0


def wrong(robot: Robot, angles: tuple[float, ...] = (0.0, 0.0)) -> str:
    model = formulate(robot)
    with pytest.raises(StudyError) as caught:
        equilibrium(model, model.theta, Configuration("pose", angles))
    return str(caught.value)


def test_what_is_wrong_with_a_loop_is_said() -> None:
    """How much stays open and where; what is locked, left free, folded up."""
    said = wrong(linkage(Rod(2.0)))
    assert "pose: loop rod does not close at the start posture" in said
    assert "the rod is 2000 mm" in said
    assert "joint elbow may fold over" in wrong(PARALLELOGRAM, (0.0, -1.57))
    geared = Joint("elbow", "y", Spring(1e5), Motor(1e-3, 50))
    robot = PARALLELOGRAM
    locked = replace(robot, bodies=(*robot.bodies[:-1], replace(robot.bodies[-1], joints=(geared,))))
    assert "lock 2, 3, elbow" in wrong(locked, (0.0, 0.0, 0.0))
    loose = (Joint("elbow", "y"), Joint("twist", (-LEVER, 0.0, 0.0)))
    free = replace(robot, bodies=(*robot.bodies[:-1], replace(robot.bodies[-1], joints=loose)))
    assert "leave joint twist undetermined" in wrong(free)
    far_off = linkage(Rod(0.75), crank=0.45)
    assert "does not close: its ends are" in wrong(far_off, (0.0, -1.2))


def test_many_postures_are_followed_at_once_also_by_way_of_one_amid_them() -> None:
    """Each as if alone; the rates are the slopes of the way."""
    angles = np.array([(0.5, 0.3), (0.4, 0.2), (0.45, 0.35)])
    alone = np.array([assembled(FOUR_BAR, each) for each in angles])
    np.testing.assert_allclose(followed(FOUR_BAR, angles), alone, atol=1e-9)
    np.testing.assert_allclose(followed(FOUR_BAR, angles, near=angles.mean(axis=0)), alone, atol=1e-9)
    T, step = rates(FOUR_BAR, alone[:1])[0], 1e-6
    for i, e in enumerate(np.eye(2)):
        ahead, behind = (assembled(FOUR_BAR, angles[0] + sign * step * e) for sign in (1, -1))
        np.testing.assert_allclose(T[:, i], (ahead - behind) / (2 * step), atol=1e-6)
