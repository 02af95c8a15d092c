"""Positions and the tool's Jacobian: closed forms, differences, the potential of gravity."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.model.formulation import serial
from elastid.model.kinematics import link_angles, skeleton, tool_jacobian
from elastid.robot import Body, Joint, Motor, Placement, Robot

MOTOR = Motor(1e-3)
PLANAR = Robot(
    "planar",
    (
        Body("upper", joints=(Joint("1", "z", motor=MOTOR),), mass=1.0, inertia=1.0),
        Body("fore", "upper", Placement((0.5, 0, 0)), (Joint("2", "z", motor=MOTOR),), 1.0, (0.3, 0, 0), 1.0),
    ),
)
OBLIQUE = Robot(
    "oblique",
    (
        Body("fixed", placement=Placement((0, 0, 0.2), (0.1, 0.2, 0.3)), mass=2.0),
        Body("a", "fixed", Placement((0.1, 0.2, 0.3), (0.3, 0, 0)), (Joint("1", (1, 2, 3), motor=MOTOR),), 3.0,
             (0.1, 0.2, 0.3), 1.0),
        Body("b", "a", Placement((0, 0.5, 0)), (Joint("2", "x"), Joint("3", "y", motor=MOTOR)), 2.0,
             (0.2, 0, 0.1), 1.0),
        Body("c", "a", Placement((0.3, 0, 0)), (Joint("4", "z", motor=MOTOR),), 2.0, (0.2, 0.1, 0.1), 1.0),
    ),
)  # fmt: skip


def test_planar_arm_stands_where_trigonometry_puts_it() -> None:
    """Elbow and centre of mass of the fore arm."""
    angles = np.random.default_rng(0).uniform(-3, 3, (5, 2))
    found = skeleton(PLANAR, angles, {"fore": [(0.4, 0.1, 0)]})
    a, b = angles[:, 0], angles.sum(axis=1)
    elbow = np.stack([0.5 * np.cos(a), 0.5 * np.sin(a), 0 * a], axis=1)
    np.testing.assert_allclose(found.points[:, found.names.index("joint 2")], elbow, atol=1e-12)
    tip = elbow + np.stack([0.3 * np.cos(b), 0.3 * np.sin(b), 0 * b], axis=1)
    np.testing.assert_allclose(found.points[:, found.tool], tip, atol=1e-12)
    point = elbow + np.stack([0.4 * np.cos(b) - 0.1 * np.sin(b), 0.4 * np.sin(b) + 0.1 * np.cos(b), 0 * b], axis=1)
    np.testing.assert_allclose(found.points[:, found.names.index("point 1 of fore")], point, atol=1e-12)
    assert found.moves[[0, 1]].tolist() == [False, False]


def test_heights_of_the_centres_of_mass_are_the_potential_of_the_model() -> None:
    """V = m g h, an independent way through the dynamics in CasADi, on oblique axes and a branching tree."""
    model = serial(OBLIQUE)
    rng = np.random.default_rng(1)
    masses = [body.mass for body in OBLIQUE.bodies]

    def potential(angles: np.ndarray) -> float:
        found = skeleton(OBLIQUE, angles[None])
        heights = [found.points[0, found.names.index(f"center of mass of {b.name}"), 2] for b in OBLIQUE.bodies]
        return 9.81 * float(np.dot(masses, heights))

    for angles in rng.uniform(-2, 2, (3, 3)):
        gradient = model.potential_gradient(link_angles(OBLIQUE, angles[None])[0], model.theta).full()[:, 0]
        for i, joint in enumerate(OBLIQUE.driven):
            step = 1e-5 * np.eye(3)[i]
            slope = (potential(angles + step) - potential(angles - step)) / 2e-5
            assert slope == pytest.approx(gradient[model.index(f"joint {joint.name}")], abs=1e-6)


@pytest.mark.parametrize("robot", [PLANAR, OBLIQUE], ids=lambda robot: robot.name)
def test_tool_jacobian_is_the_derivative_of_the_tool(robot: Robot) -> None:
    """By differences; a joint on another branch does not move it."""
    n = len(robot.driven)
    angles = np.random.default_rng(2).uniform(-2, 2, (4, n))
    J = tool_jacobian(robot, angles)
    for i in range(n):
        step = 1e-6 * np.eye(n)[i]
        ahead, behind = (skeleton(robot, angles + sign * step) for sign in (1, -1))
        slope = (ahead.points[:, ahead.tool] - behind.points[:, behind.tool]) / 2e-6
        np.testing.assert_allclose(J[:, :3, i], slope, atol=1e-8)
    if robot is OBLIQUE:
        assert not J[:, :, 1].any()
