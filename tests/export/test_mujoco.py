"""MuJoCo, given what is exported to it, has the response of the linear model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.fitted_models import close, responses_of

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.export.mujoco import write_mujoco
from elastid.fit.fitted_model import FittedModel
from elastid.robot import Anchor, CoilSpring, Compensator


def test_mujoco_has_the_response(serial_model: FittedModel, tmp_path: Path) -> None:
    """M from the engine, K and D by differences of its forces about the keyframe; rotor angles are measured."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed (group oracles)")
    (path,) = write_mujoco(tmp_path, serial_model)
    engine = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(engine)
    for i in range(2):
        mujoco.mj_resetDataKeyframe(engine, data, i)
        q0, v0 = data.qpos.copy(), np.zeros(engine.nv)

        def force(q: FloatArray, v: FloatArray) -> FloatArray:
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_forward(engine, data)
            return np.array(data.qfrc_bias - data.qfrc_passive)

        rest = force(q0, v0)
        M = np.zeros((engine.nv, engine.nv))
        mujoco.mj_fullM(engine, data, M)
        B = np.zeros((engine.nv, engine.nu))
        for u in range(engine.nu):
            B[engine.jnt_dofadr[engine.actuator_trnid[u, 0]], u] = 1
        # The keyframe is an equilibrium: its controls hold it.
        assert rest == pytest.approx(B @ data.ctrl, abs=1e-6 * max(1.0, np.abs(rest).max()))
        step = 1e-4
        K = np.column_stack([(force(q0 + h, v0) - force(q0 - h, v0)) / (2 * step) for h in step * np.eye(engine.nv)])
        D = np.column_stack([(force(q0, h) - force(q0, -h)) / (2 * step) for h in step * np.eye(engine.nv)])
        s = 2j * np.pi * serial_model.measured[i].freq_hz[:, None, None]
        delay = np.exp(-s * serial_model.theta[-1])
        G = s**2 * (B.T @ np.linalg.solve(s**2 * M + s * D + K, B.astype(complex))) * delay
        assert close(np.asarray(G), responses_of(serial_model, i), 1e-5)


def test_mujoco_says_which_springs_it_would_lose(tmp_path: Path, serial_model: FittedModel) -> None:
    """A cubic gear or a compensator has no place in MJCF: refused by name."""
    body = next(body for body in serial_model.robot.bodies if any(j.spring is not None for j in body.joints))
    joints = tuple(replace(j, spring=replace(j.spring, cubic=1.0)) if j.spring is not None else j for j in body.joints)
    bodies = tuple(replace(b, joints=joints) if b.name == body.name else b for b in serial_model.robot.bodies)
    ends = (Anchor("base"), Anchor(body.name, (0.0, 0.0, 0.1)))
    bent = replace(serial_model.robot, bodies=bodies, compensators=(Compensator("c", ends, coil=CoilSpring(1.0)),))
    with pytest.raises(StudyError, match=r"linear joint springs only, and the spring of joint .*, compensator c would"):
        write_mujoco(tmp_path, replace(serial_model, model=replace(serial_model.model, robot=bent)))


def test_mujoco_is_refused_with_what_holds_loops(looped_model: FittedModel, tmp_path: Path) -> None:
    """The message names the loops and the targets that hold them."""
    with pytest.raises(StudyError, match=r"has loops \(rod\).*export to casadi, c, control or matlab"):
        write_mujoco(tmp_path, looped_model)
