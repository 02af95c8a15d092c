"""One joint of a robot alone, against the mass matrix and springs of the whole model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plants.two_axes import ROBOT

from elastid.friction_study.presliding import OF_FILE, _Model
from elastid.model.formulation import formulate, held_joint
from elastid.study.robots import load_robot


def test_the_motor_sees_the_link_as_in_the_whole_model_with_the_others_held(tmp_path: Path) -> None:
    """At two postures; the whole model with every coordinate struck out but those of motor 1 and joint 1."""
    (tmp_path / "robot.yml").write_text(ROBOT)
    robot = load_robot(tmp_path / "robot.yml")
    model = formulate(robot)
    omega = 2 * np.pi * np.geomspace(1, 50, 7)
    for angles in (np.array([0.0, 0.2]), np.array([0.4, -0.9])):
        joint = held_joint(robot, "1", angles)
        assert joint is not None
        q = np.zeros(model.n_q)
        q[[model.index("joint 1"), model.index("joint 2")]] = angles
        kept = [model.index("motor 1"), model.index("joint 1")]
        M = np.asarray(model.mass(q, model.theta))[np.ix_(kept, kept)]
        K = np.array([[1.0, -1.0], [-1.0, 1.0]]) * 30e3
        D = np.array([[1.0, -1.0], [-1.0, 1.0]]) * 30.0
        Z = -(omega[:, None, None] ** 2) * M + K + 1j * omega[:, None, None] * D
        reaction = _Model((), joint, 0.0).reaction(np.zeros(len(OF_FILE)), omega)
        np.testing.assert_allclose(reaction, 1 / np.linalg.inv(Z)[:, 0, 0], rtol=1e-9)
