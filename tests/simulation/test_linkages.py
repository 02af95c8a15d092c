"""The motion of robots with loops in time: against an independent library, the linear model and conserved energy."""

from dataclasses import replace

import numpy as np
import pytest
from plants.integration import acceleration, energy, runge_kutta
from plants.marks import slow
from plants.paths import ROBOTS
from plants.pinocchio_robot import append, pin, pinocchio_model
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from elastid.linear.equilibrium import equilibrium
from elastid.model.closed_posture import assembled
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward, rigid_motion, rigid_path
from elastid.simulation.dynamics import free_acceleration, projection

CONSTRAINED, MINIMAL = ModelSpec("constrained"), ModelSpec("minimal")
# How the planar arm and the spatial one stand in these tests.
POSE = {"linkage_arm": (0.4, 0.1), "irb4400_linkage": (0.3, 0.4, 0.1)}


def shipped(name: str) -> Robot:
    data = YAML(typ="safe").load((ROBOTS / f"{name}.yml").read_text(encoding="utf-8"))
    return TypeAdapter(Robot).validate_python(data)


def stiff(robot: Robot) -> Robot:
    """The same with a rod that does not stretch."""
    (loop,) = robot.loops
    assert loop.rod is not None
    return replace(robot, loops=(replace(loop, rod=replace(loop.rod, stiffness=None, damping=0.0)),))


def without(model: ElasticModel, *letters: str) -> ElasticModel:
    """The same model with all parameters of these letters at zero."""
    theta = np.array(model.theta)
    theta[[name.split("_")[0] in letters for name in model.parameters]] = 0.0
    return replace(model, theta=theta)


def on_the_loops(model: ElasticModel, q, v):
    close = projection(model)
    for _ in range(6):
        q, v = (value.full()[:, 0] for value in close(q, v))
    return q, v


def pinocchio_with_bar(pin, robot: Robot):
    """The robot in pinocchio, its rod a body on a universal joint; with frames at its tip and at the lever."""

    def add_bar(model, body: str, at) -> None:
        loop = robot.loops[0]
        if body == loop.ends[0].body:
            rod, foot = loop.rod, at[1] * pin.SE3(np.eye(3), np.array(loop.ends[0].point))
            about_y = model.addJoint(at[0], pin.JointModelRY(), foot, "bar y")
            about_x = model.addJoint(about_y, pin.JointModelRX(), pin.SE3.Identity(), "bar x"), pin.SE3.Identity()
            center = np.array([0.0, 0.0, rod.center * rod.length])
            append(model, about_x, rod.mass, center, np.diag([rod.inertia, rod.inertia, 0.0]))

    model, seats = pinocchio_model(robot, add_bar)
    loop, bar = robot.loops[0], model.getJointId("bar x")
    arm, placement = seats[loop.ends[1].body]
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, loop.rod.length]))
    model.addFrame(pin.Frame("tip of the bar", bar, tip, pin.FrameType.OP_FRAME))
    end = placement * pin.SE3(np.eye(3), np.array(loop.ends[1].point))
    model.addFrame(pin.Frame("lever", arm, end, pin.FrameType.OP_FRAME))
    return model


@pytest.mark.parametrize("name", POSE)
@pytest.mark.oracle("pinocchio")
def test_accelerations_equal_pinocchio_with_the_rod_as_a_body(name: str):
    """Random states and torques, the arm bent out of its plane: to 1e-8 of the largest acceleration.

    There the rod is a body on a universal joint, its tip held in three coordinates; here it is one row and an energy.
    """
    robot = stiff(shipped(name))
    model = without(formulate(robot), "k", "d", "f", "fm")
    reference = pinocchio_with_bar(pin, robot)
    data = reference.createData()
    n_l, random = len(robot.joints), np.random.default_rng(4)
    order = [reference.joints[reference.getJointId(joint.name)].idx_q for joint in robot.joints]
    bar = [reference.joints[reference.getJointId(name)].idx_q for name in ("bar y", "bar x")]
    start = np.zeros(model.n_q)
    start[:n_l] = assembled(robot, np.array(POSE[name]))
    accelerate = free_acceleration(model)
    for _ in range(5):
        q, v = on_the_loops(model, start + random.normal(0, 0.05, model.n_q), random.normal(0, 1, model.n_q))
        torque = np.r_[random.normal(0, 500, n_l), np.zeros(model.n_q - n_l)]
        a = accelerate(q, v, torque).full()[:n_l, 0]
        q_pin, v_pin, tau = (np.zeros(reference.nq) for _ in range(3))
        q_pin[order], v_pin[order], tau[order] = q[:n_l], v[:n_l], torque[:n_l]
        q_pin[bar] = _bar_angles(pin, reference, q_pin)
        J = _between(pin, reference, data, q_pin, v_pin)[0]
        v_pin[bar] = np.linalg.lstsq(J[:, bar], -J[:, order] @ v_pin[order], rcond=None)[0]
        assert np.abs(J @ v_pin).max() < 1e-9
        # M a + h = tau + J^T lambda, J a = -dJ/dt v, with M, h, J and the drift all of pinocchio.
        J, drift = _between(pin, reference, data, q_pin, v_pin)
        M, h = pin.crba(reference, data, q_pin), pin.nonLinearEffects(reference, data, q_pin, v_pin)
        M = np.triu(M) + np.triu(M, 1).T
        saddle = np.block([[M, J.T], [J, np.zeros((3, 3))]])
        expected = np.linalg.solve(saddle, np.r_[tau - h, -drift])[: reference.nv]
        np.testing.assert_allclose(a, expected[order], rtol=0, atol=1e-8 * np.abs(a).max())


def _bar_angles(pin, reference, q):
    """The universal joint's angles that point the bar at the lever."""
    data = reference.createData()
    pin.framesForwardKinematics(reference, data, q)
    foot, lever = data.oMi[reference.getJointId("bar y")], data.oMf[reference.getFrameId("lever")]
    x, y, z = foot.rotation.T @ (lever.translation - foot.translation)
    return np.array([np.arctan2(x, z), -np.arcsin(y / np.linalg.norm([x, y, z]))])


def _between(pin, reference, data, q, v):
    """Jacobian (3, n_v) of the velocity between tip and lever, and its acceleration for q'' = 0, in the base frame."""
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    pin.computeJointJacobians(reference, data, q)
    pin.forwardKinematics(reference, data, q, v, np.zeros(reference.nv))
    pin.updateFramePlacements(reference, data)
    both = [reference.getFrameId(name) for name in ("tip of the bar", "lever")]
    J = [pin.getFrameJacobian(reference, data, frame, aligned)[:3] for frame in both]
    a = [pin.getFrameClassicalAcceleration(reference, data, frame, aligned).linear for frame in both]
    return J[0] - J[1], a[0] - a[1]


@pytest.mark.parametrize("name", POSE)
def test_constrained_and_cut_rod_accelerate_alike(name: str):
    """The same torques give the same motion with the elongation as a coordinate and with the rod cut."""
    robot, random = shipped(name), np.random.default_rng(1)
    model, cut = formulate(robot, CONSTRAINED), formulate(robot, MINIMAL)
    assert cut.n_c == 0
    point = equilibrium(model, model.theta, Configuration("c", POSE[name]))
    q, v = on_the_loops(model, point.q + random.normal(0, 1e-3, model.n_q), random.normal(0, 0.5, model.n_q))
    u, coulomb = random.normal(0, 300, model.n_u), np.full(model.n_u, 20.0)
    a = acceleration(model, coulomb)(q, v, u).full()[:, 0]
    shared = [model.coordinates.index(name) for name in cut.coordinates]
    same = acceleration(cut, coulomb)(q[shared], v[shared], u).full()[:, 0]
    np.testing.assert_allclose(a[shared], same, rtol=0, atol=1e-9 * np.abs(same).max())


@pytest.mark.parametrize("name", POSE)
def test_energy_is_conserved_and_loops_stay_closed(name: str):
    """Over 0.5 s without damping and torque, swinging freely: energy to 1e-6 of what moves, loops to rounding."""
    model = without(formulate(shipped(name)), "d", "f", "fm")
    point = equilibrium(model, model.theta, Configuration("c", POSE[name]))
    step, close = runge_kutta(acceleration(model, np.zeros(model.n_u)), 1e-4, 10), projection(model)
    q, v = on_the_loops(model, point.q, 0.3 * rigid_motion(model, point.q) @ np.ones(model.n_u))
    path = [(q, v)]
    for _ in range(500):
        q, v = (value.full()[:, 0] for value in close(*step(q, v, np.zeros(model.n_u))))
        path.append((q, v))
    q, v = (np.array(part) for part in zip(*path, strict=True))
    E = energy(model, q, v)
    V = energy(model, q, np.zeros_like(v))
    assert np.abs(model.constraint.map(len(q))(q.T, model.theta).full()).max() < 1e-14
    assert np.abs(E - E[0]).max() < 1e-6 * np.ptp(V)


@pytest.mark.parametrize("name", POSE)
@pytest.mark.parametrize("spec", [slow(CONSTRAINED), MINIMAL])
def test_linkage_feedforward_balances_and_does_work(name: str, spec: ModelSpec):
    """At rest the holding torque; in motion its power is the change of the rigid robot's energy."""
    model = without(formulate(shipped(name), spec), "d", "f", "fm")
    at = Configuration("c", POSE[name])
    point = equilibrium(model, model.theta, at)
    still = np.zeros((1, model.n_u))
    np.testing.assert_allclose(feed_forward(model, point.q, still, still, still)[0], point.u, rtol=1e-7, atol=1e-5)
    t = np.linspace(0, 0.5, 2001)[:, None]
    omega = 2 * np.pi * np.linspace(1.0, 1.7, model.n_u)
    position, velocity, accelerating = (
        0.2 * part for part in (np.sin(omega * t), omega * np.cos(omega * t), -(omega**2) * np.sin(omega * t))
    )
    u = feed_forward(model, point.q, position, velocity, accelerating)
    path = rigid_path(model, point.q, at.angles, at.angles + position)
    v = (rigid_motion(model, path) @ velocity[:, :, None])[:, :, 0]
    E = energy(model, path, v)
    work = np.concatenate([[0.0], np.cumsum(np.sum((u * velocity)[1:] + (u * velocity)[:-1], axis=1) / 2 * t[1, 0])])
    # The springs keep the deflection of the first posture, which is none of the work.
    np.testing.assert_allclose(E - E[0], work, rtol=0, atol=2e-4 * np.ptp(work))
