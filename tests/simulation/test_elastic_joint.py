"""One joint of a robot alone, against the mass matrix and springs of the whole model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plants.lugre_joint import JOINT, RATE, TRUTH
from plants.two_axes import ROBOT
from scipy.integrate import solve_ivp

from elastid.base.arrays import FloatArray
from elastid.friction_study.at_rest import reaction
from elastid.model.formulation import formulate
from elastid.simulation.elastic_joint import FRICTION, held_joint
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
        np.testing.assert_allclose(reaction(omega, joint), 1 / np.linalg.inv(Z)[:, 0, 0], rtol=1e-9)


def test_the_step_is_that_of_the_differential_equation() -> None:
    """A tenth of a second from rest under a torque, against an integrator of the equations as they stand."""
    p, u = [TRUTH[name] for name in FRICTION], 1.3
    sigma_0, sigma_1, F_c, F_s, nu_s, viscous = p

    def rates(_: float, s: FloatArray) -> list[float]:
        q_m, v_m, q_l, v_l, z = s
        g = F_c + (F_s - F_c) * np.exp(-((v_m / nu_s) ** 2))
        dz = v_m - sigma_0 * abs(v_m) / g * z
        spring = JOINT.stiffness * (q_m - q_l) + JOINT.damping * (v_m - v_l)
        friction = sigma_0 * z + sigma_1 * dz + viscous * v_m
        return [v_m, (u - friction - spring) / JOINT.motor_inertia, v_l, spring / JOINT.link_inertia, dz]

    exact = solve_ivp(rates, (0, 0.1), np.zeros(5), rtol=1e-10, atol=1e-12).y[:, -1]
    walk = JOINT.step(RATE).mapaccum("walk", 100)
    found = walk(np.zeros(5), np.tile(np.array(p)[:, None], 100), np.full((1, 100), u)).full()[:, -1]
    np.testing.assert_allclose(found, exact, rtol=2e-3, atol=1e-9)
