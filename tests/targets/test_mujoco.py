"""MuJoCo, and another library by URDF, given what is exported to them, have the linear model."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.fitted_models import close, fitted_model, responses_of
from plants.refusals import refused
from scipy.linalg import null_space

from elastid.base.arrays import FloatArray
from elastid.fit.fitted_robot import FittedRobot
from elastid.robot import Anchor, CoilSpring, Compensator, Friction, Joint, Spring
from elastid.robot.simplified import with_joints
from elastid.targets.mujoco import write_mujoco
from elastid.targets.urdf import write_urdf


def slopes(f: Callable[[FloatArray], FloatArray], n: int) -> FloatArray:
    """The Jacobian (n, n) at 0, by central differences of sixth order."""
    weights = (0.75, -0.15, 1 / 60)
    odd = [[w * (f(i * h) - f(-i * h)) for i, w in enumerate(weights, 1)] for h in 1e-3 * np.eye(n)]
    return np.sum(odd, axis=1).T / 1e-3


def test_mujoco_says_which_springs_it_would_lose(tmp_path: Path, serial_model: FittedRobot) -> None:
    """A cubic gear, a compensator or a shaft that gives way has no place in MJCF: refused by name."""
    body = next(body for body in serial_model.robot.bodies if any(j.spring is not None for j in body.joints))
    joints = tuple(replace(j, spring=replace(j.spring, cubic=1.0)) if j.spring is not None else j for j in body.joints)
    bodies = tuple(replace(b, joints=joints) if b.name == body.name else b for b in serial_model.robot.bodies)
    ends = (Anchor("base"), Anchor(body.name, (0.0, 0.0, 0.1)))
    bent = replace(serial_model.robot, bodies=bodies, compensators=(Compensator("c", ends, coil=CoilSpring(1.0)),))
    shafts = with_joints(
        serial_model.robot, lambda joint: replace(joint, motor=joint.motor and replace(joint.motor, spring=Spring(1e3)))
    )
    for robot in (bent, shafts):
        with refused("export/not-representable"):
            write_mujoco(tmp_path, replace(serial_model, model=replace(serial_model.model, robot=robot)))


class Linearised:
    """The engine about one of its keyframes: forces and constraint rows at displaced postures."""

    def __init__(self, mujoco: Any, engine: Any, key: int) -> None:
        self.mujoco, self.engine, self.data = mujoco, engine, mujoco.MjData(engine)
        mujoco.mj_resetDataKeyframe(engine, self.data, key)
        self.q0, self.held, self.n = self.data.qpos.copy(), self.data.ctrl.copy(), engine.nv

    def force(self, dq: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """f (n,) and the rows J of the constraints."""
        self.data.qpos[:], self.data.qvel[:] = self.q0, v
        self.mujoco.mj_integratePos(self.engine, self.data.qpos, dq, 1.0)
        self.mujoco.mj_forward(self.engine, self.data)
        rows = np.array(self.data.efc_J).reshape(-1, self.n)[: self.data.nefc]
        return np.array(self.data.qfrc_bias - self.data.qfrc_passive), rows


@pytest.mark.oracle("mujoco")
@pytest.mark.parametrize("key", [0, 1])
@pytest.mark.parametrize("accuracy", [2e-4, 1e-6], ids=["as written", "without the gram"])
def test_mujoco_has_the_response(model: FittedRobot, tmp_path: Path, key: int, accuracy: float) -> None:
    """M from the engine, K and D by differences of its forces along the motions that its constraints leave.

    About keyframes, which are equilibria. Within 1e-9 without loops; with them within 1e-6 but for 1 g and 1e-4 kg m^2
    at the end of a rod, which the engine's time steps need.
    """
    import mujoco

    (path,) = write_mujoco(tmp_path, model)
    engine = mujoco.MjModel.from_xml_path(str(path))
    if accuracy == 1e-6:
        rods = [i for i in range(engine.nbody) if engine.body(i).name.startswith("rod ")]
        engine.body_inertia[rods] *= 1e-4
        engine.body_mass[[i for i in rods if engine.body(i).name.endswith(" end")]] *= 1e-4
        mujoco.mj_setConst(engine, mujoco.MjData(engine))
    at = Linearised(mujoco, engine, key)
    zero = np.zeros(at.n)
    rest, J = at.force(zero, zero)
    assert np.abs(at.data.efc_pos).max(initial=0.0) < 1e-8
    M, B = np.zeros((at.n, at.n)), np.zeros((at.n, engine.nu))
    mujoco.mj_fullM(engine, at.data, M)
    for u in range(engine.nu):
        B[engine.jnt_dofadr[engine.actuator_trnid[u, 0]], u] = 1
    multipliers = np.linalg.lstsq(J.T, B @ at.held - rest, rcond=None)[0]
    moved = np.abs(rest + J.T @ multipliers - B @ at.held).max()
    assert moved < (1e-4 if model.robot.loops else 1e-6) * max(1.0, np.abs(at.held).max())

    def pulled(dq: FloatArray) -> FloatArray:
        f, J = at.force(dq, zero)
        return f + J.T @ multipliers

    K, D = slopes(pulled, at.n), slopes(lambda v: at.force(zero, v)[0], at.n)
    Z = null_space(J, rcond=1e-9) if model.robot.loops else np.eye(at.n)
    M, D, K, B = Z.T @ M @ Z, Z.T @ D @ Z, Z.T @ K @ Z, Z.T @ B
    s = 2j * np.pi * model.measured[key].freq_hz[:, None, None]
    G = s**2 * (B.T @ np.linalg.solve(s**2 * M + s * D + K, B.astype(complex))) * np.exp(-s * model.theta[-1])
    assert close(np.asarray(G), responses_of(model, key), accuracy if model.robot.loops else 1e-9)


@pytest.mark.oracle("mujoco")
def test_mujoco_stays_where_its_controls_hold_a_linkage(looped_model: FittedRobot, tmp_path: Path) -> None:
    """Half a second of the engine's own time steps moves no joint by more than a tenth of a millirad."""
    import mujoco

    engine = mujoco.MjModel.from_xml_path(str(write_mujoco(tmp_path, looped_model)[0]))
    data = mujoco.MjData(engine)
    mujoco.mj_resetDataKeyframe(engine, data, 0)
    start = data.qpos.copy()
    for _ in range(1000):
        mujoco.mj_step(engine, data)
    hinges = engine.jnt_qposadr[engine.jnt_type == mujoco.mjtJoint.mjJNT_HINGE]
    assert np.abs(data.qpos - start)[hinges].max() < 1e-4


@pytest.mark.oracle("mujoco")
def test_coulomb_friction_that_was_found_is_frictionloss(serial_model: FittedRobot, tmp_path: Path) -> None:
    """At the motor on the link side; behind the gear, where motor angle and twist turn together, in a tendon."""
    import mujoco

    def rubbed(joint: Joint) -> Joint:
        if joint.motor is None:
            return joint
        return replace(joint, motor=replace(joint.motor, coulomb=0.1, friction=None), friction=Friction(7.0))

    found = with_joints(serial_model.robot, rubbed)
    (path,) = write_mujoco(tmp_path, serial_model, found)
    engine = mujoco.MjModel.from_xml_path(str(path))
    first = found.flexible[0]
    hinge = engine.joint(f"motor {first.name}")
    assert engine.dof_frictionloss[hinge.dofadr[0]] == pytest.approx(0.1 * abs(first.motor.ratio))
    assert engine.tendon_frictionloss == pytest.approx(np.full(len(found.flexible), 7.0))


@pytest.mark.oracle("mujoco")
@pytest.mark.parametrize("inner", [0.0, 2e3])
def test_lost_motion_of_a_gear_is_a_slack_tendon(tmp_path: Path, serial_model: FittedRobot, inner: float) -> None:
    """The torque of the spring at twists within and beyond the gap, whatever else the robot has."""
    import mujoco

    gap = 1e-3
    worn = serial_model.robot.flexible[0]
    spring = Spring(worn.spring.stiffness, worn.spring.damping, backlash=gap, inner_stiffness=inner)
    robot = with_joints(serial_model.robot, lambda j: replace(j, spring=spring) if j.name == worn.name else j)
    (path,) = write_mujoco(tmp_path, serial_model, robot)
    engine = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(engine)
    twist = engine.joint(f"twist {worn.name}")
    for angle in (-3 * gap, -0.5 * gap, 0.9 * gap, 2 * gap):
        torques = []
        for value in (0.0, angle):
            data.qpos[:] = 0
            data.qpos[twist.qposadr[0]] = value
            mujoco.mj_forward(engine, data)
            torques.append(data.qfrc_passive[twist.dofadr[0]])
        beyond = angle - np.clip(angle, -gap, gap)
        expected = -(inner * angle + (spring.stiffness - inner) * beyond)
        assert torques[1] - torques[0] == pytest.approx(expected, abs=1e-9 * spring.stiffness)


@pytest.mark.oracle("pinocchio")
def test_pinocchio_has_the_same_mass_matrix_and_gravity(serial_model: FittedRobot, tmp_path: Path) -> None:
    """Of the driven joints, in any posture, without rotors; elastic joints are rigid."""
    import pinocchio

    (path,) = write_urdf(tmp_path, serial_model)
    loaded = pinocchio.buildModelFromUrdf(str(path))
    model, robot = serial_model.model, serial_model.robot
    moving = [joint for joint in robot.joints if joint.motor is not None or joint.is_passive]
    of = [loaded.joints[loaded.getJointId(joint.name)].idx_v for joint in moving]
    rows = [model.index(f"joint {joint.name}") for joint in moving]
    loaded.gravity.linear = np.array(robot.gravity)
    data = loaded.createData()
    theta = np.array(model.theta)
    theta[[i for i, name in enumerate(model.parameters) if name.startswith("k_")]] = 0.0
    for seed in range(3):
        angles = np.random.default_rng(seed).uniform(-1, 1, len(moving))
        q = np.zeros(model.n_q)
        q[rows] = angles
        there = pinocchio.neutral(loaded)
        for joint, angle in zip(moving, angles, strict=True):
            of_joint = loaded.joints[loaded.getJointId(joint.name)]
            turn = [np.cos(angle), np.sin(angle)] if of_joint.nq == 2 else [angle]
            there[of_joint.idx_q : of_joint.idx_q + of_joint.nq] = turn
        M = pinocchio.crba(loaded, data, there)
        M = np.triu(M) + np.triu(M, 1).T
        g = pinocchio.computeGeneralizedGravity(loaded, data, there)
        ours = model.mass(q, theta).full()[np.ix_(rows, rows)]
        rotors = np.array(
            [
                0.0 if joint.is_flexible or joint.motor is None else joint.motor.ratio**2 * joint.motor.inertia
                for joint in moving
            ]
        )
        assert np.abs(M[np.ix_(of, of)] + np.diag(rotors) - ours).max() < 1e-9 * np.abs(ours).max()
        gravity = model.potential_gradient(q, theta).full()[rows, 0]
        assert np.abs(g[of] - gravity).max() < 1e-9 * max(1.0, np.abs(gravity).max())


def test_what_a_urdf_cannot_carry_is_said(tmp_path: Path) -> None:
    """Springs in the head of the file; loops are refused."""
    (path,) = write_urdf(tmp_path, fitted_model("arm"))
    assert "Left out: springs of the joints" in path.read_text()
    with refused("export/not-representable"):
        write_urdf(tmp_path, fitted_model("linkage_arm minimal"))
