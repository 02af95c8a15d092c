"""Rigid-body dynamics of random trees against an independent implementation, and their invariants."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.model.serial import serial
from elastid.robot import BASE, Body, Joint, Motor, Placement, Robot, unit_axis

seeds = st.integers(0, 2**31)


def random_body(rng: np.random.Generator, index: int, parents: list[str], n_joints: int) -> Body:
    """A body of random shape, somewhere on one of the parents, with joints about coordinate and oblique axes."""

    def joint(number: int) -> Joint:
        axis = rng.choice(["x", "y", "z", "oblique", "backwards"])
        directions = {"oblique": tuple(rng.normal(size=3)), "backwards": (0.0, -1.0, 0.0)}
        motor = Motor(inertia=1e-12) if index == 0 and number == 0 else None
        return Joint(f"{index}{'abc'[number]}", directions.get(axis, axis), motor=motor)

    points = rng.normal(size=(4, 3)) * 0.3  # four point masses: any of their inertias is physical
    masses = rng.uniform(1, 10, size=4)
    center = masses @ points / masses.sum()
    I = sum(m * ((r @ r) * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points - center, strict=True))  # noqa: E741
    return Body(
        name=f"b{index}",
        parent=parents[rng.integers(len(parents))],
        placement=Placement(tuple(rng.normal(size=3)), tuple(rng.choice([0, np.pi / 2, 0.7], size=3))),
        joints=tuple(joint(number) for number in range(n_joints)),
        mass=float(masses.sum()),
        center_of_mass=tuple(center),
        inertia=(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]),
    )


def random_robot(seed: int) -> Robot:
    """A tree of five bodies: branches, bodies with several joints and bodies fixed to their parent or to the base."""
    rng = np.random.default_rng(seed)
    bodies: list[Body] = []
    for index in range(5):
        n_joints = 1 + int(rng.integers(3)) if index == 0 else int(rng.integers(4))
        bodies.append(random_body(rng, index, [BASE, *(body.name for body in bodies)], n_joints))
    return Robot("random", tuple(bodies), gravity=tuple(rng.normal(size=3) * 6))


def depth_first(robot: Robot, parent: str) -> list[Body]:
    """Children before siblings: pinocchio's crba takes every branch's joints to be numbered in one run."""
    return [each for body in robot.bodies if body.parent == parent for each in (body, *depth_first(robot, body.name))]


def pinocchio_model(pin, robot: Robot):
    """The same robot in pinocchio, built body by body; returns the model and the order of its joints in ours."""
    model = pin.Model()
    model.gravity.linear = np.array(robot.gravity)
    seats = {BASE: (0, pin.SE3.Identity())}
    for body in depth_first(robot, BASE):
        parent, placement = seats[body.parent]
        placement = placement * pin.SE3(body.placement.rotation, np.array(body.placement.xyz))
        for joint in body.joints:
            revolute = pin.JointModelRevoluteUnaligned(unit_axis(joint.axis))
            parent, placement = model.addJoint(parent, revolute, placement, joint.name), pin.SE3.Identity()
        inertia = pin.Inertia(body.mass, np.array(body.center_of_mass), body.inertia_matrix)
        model.appendBodyToJoint(parent, inertia, placement)
        model.addFrame(pin.Frame(body.name, parent, placement, pin.FrameType.BODY))
        seats[body.name] = (parent, placement)
    order = [model.joints[model.getJointId(joint.name)].idx_q for joint in robot.joints]
    return model, order


@pytest.fixture(scope="module")
def pin():
    return pytest.importorskip("pinocchio", reason="the independent implementation is in the group 'oracles'")


@given(seed=seeds)
@settings(deadline=None, max_examples=25)
def test_mass_coriolis_and_gravity_equal_pinocchio(pin, seed):
    """M, c + g and g of random trees (branches, oblique axes, fixed bodies) equal pinocchio's to 1e-10."""
    robot = random_robot(seed)
    model = serial(robot)
    reference, order = pinocchio_model(pin, robot)
    data = reference.createData()
    rng = np.random.default_rng(seed)
    q, v = rng.normal(size=(2, model.n_q))
    q_pin, v_pin = np.empty_like(q), np.empty_like(v)
    q_pin[order], v_pin[order] = q, v

    M = pin.crba(reference, data, q_pin)
    M = np.triu(M) + np.triu(M, 1).T
    scale = np.abs(M).max()
    np.testing.assert_allclose(model.mass(q, model.theta).full(), M[np.ix_(order, order)], rtol=0, atol=1e-10 * scale)
    h = pin.nonLinearEffects(reference, data, q_pin, v_pin)[order]
    np.testing.assert_allclose(model.force(q, v, model.theta).full()[:, 0], h, rtol=0, atol=1e-10 * np.abs(h).max())
    g = pin.computeGeneralizedGravity(reference, data, q_pin)[order]
    np.testing.assert_allclose(
        model.potential_gradient(q, model.theta).full()[:, 0], g, rtol=0, atol=1e-10 * max(np.abs(g).max(), 1)
    )


@given(seed=seeds)
@settings(deadline=None, max_examples=10)
def test_angular_velocities_equal_pinocchio(pin, seed):
    """The rates of `body <name> <axis>` equal the body-frame angular velocities of pinocchio."""
    robot = random_robot(seed)
    model = serial(robot)
    reference, order = pinocchio_model(pin, robot)
    data = reference.createData()
    rng = np.random.default_rng(seed)
    q, v = rng.normal(size=(2, model.n_q))
    q_pin, v_pin = np.empty_like(q), np.empty_like(v)
    q_pin[order], v_pin[order] = q, v
    pin.forwardKinematics(reference, data, q_pin, v_pin)
    for body in robot.bodies:
        twist = pin.getFrameVelocity(reference, data, reference.getFrameId(body.name), pin.ReferenceFrame.LOCAL)
        C = model.output_jacobian(q, [f"body {body.name} {axis}" for axis in "xyz"])
        np.testing.assert_allclose(C @ v, twist.angular, atol=1e-10)


@given(seed=seeds)
@settings(deadline=None, max_examples=15)
def test_mass_is_symmetric_positive_and_linear_in_masses_and_inertias(seed):
    """M = M^T > 0, and scaling all masses and inertias (centres of mass kept) scales M."""
    model = serial(random_robot(seed))
    q = np.random.default_rng(seed).normal(size=model.n_q)
    M = model.mass(q, model.theta).full()
    np.testing.assert_array_equal(M, M.T)
    assert np.linalg.eigvalsh(M)[0] > -1e-12 * np.abs(M).max()
    scaled = [3 * t if name[0] in "mIJ" else t for name, t in zip(model.parameters, model.theta, strict=True)]
    np.testing.assert_allclose(model.mass(q, scaled).full(), 3 * M, atol=1e-12 * np.abs(M).max())


@given(seed=seeds)
@settings(deadline=None, max_examples=15)
def test_coriolis_forces_do_no_work_beyond_the_change_of_kinetic_energy(seed):
    """v^T (c - M' v / 2) = 0: the energy identity that sign errors in c break."""
    model = serial(random_robot(seed))
    rng = np.random.default_rng(seed)
    q, v = rng.normal(size=(2, model.n_q))
    c = model.force(q, v, model.theta).full()[:, 0] - model.potential_gradient(q, model.theta).full()[:, 0]
    t = ca.SX.sym("t")
    kinetic = ca.DM(v).T @ model.mass(ca.DM(q) + t * ca.DM(v), model.theta) @ ca.DM(v) / 2
    rate = float(ca.Function("rate", [t], [ca.jacobian(kinetic, t)])(0))
    assert v @ c == pytest.approx(rate, rel=1e-9, abs=1e-9)
