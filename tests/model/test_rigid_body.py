"""Rigid-body dynamics of random trees and shipped robots against an independent implementation, and invariants."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.paths import ROBOTS
from plants.pinocchio_robot import (
    append,
    assert_mass,
    assert_pose,
    mass_of,
    pin,
    pinocchio_model,
    placed,
    point_inertia,
    six,
)
from plants.refusals import refused

from elastid.model.formulation import serial
from elastid.model.kinematics import frame_jacobians, frame_poses
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import BASE, Body, Frame, Joint, Motor, Payload, Placement, Robot
from elastid.robot.simplified import with_joints
from elastid.study import load_robot

seeds = st.integers(0, 2**31)
SHIPPED = sorted(ROBOTS.glob("*.yml"))


def random_body(rng: np.random.Generator, index: int, parents: list[str], n_joints: int) -> Body:
    """A body of random shape, somewhere on one of the parents; joints turn about or slide along any axis."""

    def joint(number: int) -> Joint:
        axis = rng.choice(["x", "y", "z", "oblique", "backwards"])
        directions = {"oblique": tuple(rng.normal(size=3)), "backwards": (0.0, -1.0, 0.0)}
        motor = Motor(inertia=1e-12) if index == 0 and number == 0 else None
        motion = rng.choice(["rotation", "rotation", "translation"])
        return Joint(f"{index}{'abc'[number]}", directions.get(axis, axis), motor=motor, motion=str(motion))

    points = rng.normal(size=(4, 3)) * 0.3  # four point masses: any of their inertias is physical
    masses = rng.uniform(1, 10, size=4)
    center = masses @ points / masses.sum()
    return Body(
        name=f"b{index}",
        parent=parents[rng.integers(len(parents))],
        placement=Placement(tuple(rng.normal(size=3)), tuple(rng.choice([0, np.pi / 2, 0.7], size=3))),
        joints=tuple(joint(number) for number in range(n_joints)),
        mass=float(masses.sum()),
        center_of_mass=tuple(center),
        inertia=six(point_inertia(points - center, masses)),
        mounting=Placement(tuple(rng.normal(size=3)), (0.0, 0.0, 0.4)) if rng.random() < 0.5 else Placement(),
    )


def random_robot(seed: int) -> Robot:
    """Five bodies, branching, with several joints or none; two frames, one with a payload."""
    rng = np.random.default_rng(seed)
    bodies = []
    for index in range(5):
        n_joints = 1 + int(rng.integers(3)) if index == 0 else int(rng.integers(4))
        bodies.append(random_body(rng, index, [BASE, *(body.name for body in bodies)], n_joints))
    frames = tuple(
        Frame(name, bodies[i].name, Placement(tuple(rng.normal(size=3)), tuple(rng.normal(size=3))))
        for name, i in (("tool", -1), ("flange", rng.integers(5)))
    )
    payload = Payload(5.0, (0.1, 0.2, -0.1), (1.0, 1.2, 0.9, 0.1, -0.2, 0.05))
    return Robot("random", tuple(bodies), tuple(rng.normal(size=3) * 6), frames=frames, payload=payload)


def in_pinocchio(robot: Robot):
    """The same robot in pinocchio with its frames and its payload, and the order of its joints in ours."""
    model, seats = pinocchio_model(robot)
    for body in robot.bodies:
        model.addFrame(pin.Frame(body.name, *seats[body.name], pin.FrameType.BODY))
    for frame in robot.frames:
        parent, placement = seats[frame.body]
        model.addFrame(pin.Frame(frame.name, parent, placement * placed(frame.placement), pin.FrameType.OP_FRAME))
        seats[frame.name] = parent, placement * placed(frame.placement)
    if robot.payload is not None:
        load = robot.payload.body("", Placement())
        append(model, seats[robot.payload.at], load.mass, load.center_of_mass, load.inertia_matrix)
    return model, [model.joints[model.getJointId(joint.name)].idx_q for joint in robot.joints]


@given(seed=seeds)
@settings(deadline=None, max_examples=12)
@pytest.mark.oracle("pinocchio")
def test_mass_coriolis_and_gravity_equal_pinocchio(seed):
    """M, c + g and g of random trees (branches, oblique axes, fixed bodies) equal pinocchio's to 1e-10."""
    assert_equal_to_pinocchio(random_robot(seed), seed)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
@pytest.mark.oracle("pinocchio")
def test_shipped_robots_equal_pinocchio(path):
    """M, c + g, g, frames and their Jacobians of every robot in configs."""
    assert_equal_to_pinocchio(load_robot(path), 0)


def assert_equal_to_pinocchio(robot: Robot, seed: int) -> None:
    """Link-side rigid body terms without drivetrain, poses and Jacobians, to 1e-10."""
    robot = rigid(robot)
    model = serial(robot)
    n = len(robot.joints)
    reference, order = in_pinocchio(robot)
    data = reference.createData()
    rng = np.random.default_rng(seed)
    q, v, a = rng.normal(size=(3, n))
    q_pin, v_pin, a_pin = np.empty((3, n))
    q_pin[order], v_pin[order], a_pin[order] = q, v, a

    assert_mass(model, q, mass_of(reference, data, q_pin)[np.ix_(order, order)])
    h = pin.nonLinearEffects(reference, data, q_pin, v_pin)[order]
    np.testing.assert_allclose(model.force(q, v, model.theta).full()[:, 0], h, rtol=0, atol=1e-10 * np.abs(h).max())
    g = pin.computeGeneralizedGravity(reference, data, q_pin)[order]
    np.testing.assert_allclose(
        model.potential_gradient(q, model.theta).full()[:, 0], g, rtol=0, atol=1e-10 * max(np.abs(g).max(), 1)
    )
    tau = pin.rnea(reference, data, q_pin, v_pin, a_pin)[order]
    mine = inverse_dynamics(robot)(q, v, a, model.theta).full()[:, 0]
    np.testing.assert_allclose(mine, tau, rtol=0, atol=1e-10 * max(np.abs(tau).max(), 1))

    pin.computeJointJacobians(reference, data, q_pin)
    pin.updateFramePlacements(reference, data)
    local = model.frame_velocity(q, model.theta).full().reshape(-1, 6, n)
    gravity = model.frame_gravity(q, model.theta).full().reshape(-1, 3)
    for i, frame in enumerate(robot.frames):
        index = reference.getFrameId(frame.name)
        assert_pose(robot, q, frame.name, data.oMf[index])
        np.testing.assert_allclose(gravity[i], data.oMf[index].rotation.T @ robot.gravity, atol=1e-10)
        for axes, J in (
            (pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, frame_jacobians(robot, q[None], frame.name)[0]),
            (pin.ReferenceFrame.LOCAL, local[i]),
        ):
            expected = pin.getFrameJacobian(reference, data, index, axes).reshape(6, -1)[:, order]  # (6,) of one joint
            np.testing.assert_allclose(J, expected, atol=1e-10)


def rigid(robot: Robot) -> Robot:
    """The same bodies on joints without springs, friction and rotors; one motor is left that hardly counts."""
    motor = Motor(inertia=1e-300)
    return with_joints(robot, lambda joint: replace(joint, spring=None, gear=None, motor=motor, viscous=0.0))


def test_a_frame_that_is_not_there_is_refused():
    """With the names of those that are."""
    with refused("robot/unknown-name"):
        frame_poses(random_robot(0), np.zeros((1, len(random_robot(0).joints))), "nose")
