"""A URDF that is exported has the rigid robot's mass matrix in another library."""

from pathlib import Path

import numpy as np
import pytest
from plants.fitted_models import fitted_model
from plants.refusals import refused

from elastid.fit.fitted_robot import FittedRobot
from elastid.targets.urdf import write_urdf

pinocchio = pytest.importorskip("pinocchio", reason="pinocchio is not installed (group oracles)")


def test_pinocchio_has_the_same_mass_matrix_and_gravity(serial_model: FittedRobot, tmp_path: Path) -> None:
    """Of the driven joints, in any posture, without rotors; elastic joints are rigid."""
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
