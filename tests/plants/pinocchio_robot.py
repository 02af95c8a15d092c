"""A robot of elastid in Pinocchio, an independent implementation, for tests with the mark `oracle`."""

from collections.abc import Callable
from typing import Any

import numpy as np

from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import frame_poses
from elastid.robot import BASE, Placement, Robot, unit_axis

try:
    import pinocchio as pin
except ImportError:
    pin = None


def point_inertia(points: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) of point masses at points (n, 3) about the origin."""
    return sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points, strict=True))


def six(inertia: np.ndarray) -> tuple[float, ...]:
    """xx, yy, zz, xy, xz and yz."""
    return tuple(inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist())


def assert_pose(robot: Robot, q: np.ndarray, name: str, expected: Any) -> None:
    """A frame is where Pinocchio has it."""
    pose = frame_poses(robot, q[None], name)
    np.testing.assert_allclose(pose.position[0], expected.translation, atol=1e-10)
    np.testing.assert_allclose(pose.rotation[0], expected.rotation, atol=1e-10)


def assert_mass(model: ElasticModel, q: np.ndarray, M: np.ndarray) -> None:
    """To 1e-10 of the largest element."""
    np.testing.assert_allclose(model.mass(q, model.theta).full(), M, rtol=0, atol=1e-10 * np.abs(M).max())


def placed(placement: Placement) -> Any:
    return pin.SE3(placement.rotation, np.array(placement.xyz))


def append(model: Any, at: tuple[int, Any], mass: float, center: Any, inertia: np.ndarray) -> None:
    """A mass with its centre and inertia at a joint and a placement behind it."""
    model.appendBodyToJoint(at[0], pin.Inertia(mass, np.array(center), inertia), at[1])


def pinocchio_model(
    robot: Robot, riding: Callable[[Any, str, tuple[int, Any]], None] = lambda model, body, at: None
) -> tuple[Any, dict[str, tuple[int, Any]]]:
    """The model, and joint and placement of each body.

    riding: adds what rides on the base or on a body.  Children come before siblings: Pinocchio's crba takes every
    branch's joints to be numbered in one run.
    """
    model, seats = pin.Model(), {}
    model.gravity.linear = np.array(robot.gravity)

    def add(name: str, at: tuple[int, Any]) -> None:
        seats[name] = at
        riding(model, name, at)
        for body in robot.bodies:
            if body.parent == name:
                seat, placement = at[0], at[1] * placed(body.placement)
                for joint in body.joints:
                    kind = pin.JointModelPrismaticUnaligned if joint.slides else pin.JointModelRevoluteUnaligned
                    seat = model.addJoint(seat, kind(unit_axis(joint.axis)), placement, joint.name)
                    placement = pin.SE3.Identity()
                place = seat, placement * placed(body.mounting)
                append(model, place, body.mass, body.center_of_mass, body.inertia_matrix)
                add(body.name, place)

    add(BASE, (0, pin.SE3.Identity()))
    return model, seats


def mass_of(model: Any, data: Any, q: np.ndarray) -> np.ndarray:
    """Pinocchio's mass matrix, of which crba writes the upper half."""
    M = np.triu(pin.crba(model, data, q))
    return M + np.triu(M, 1).T
