"""The controller has its bandwidth, its feed-forward the inverse dynamics of the rigid robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plants.linkages import linkage
from plants.two_links import (
    arm,
    loop,
    motor,
)

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import minimal, serial
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Rod
from elastid.simulation.baumgarte import energy
from elastid.simulation.closed_loop import Commands, simulate
from elastid.simulation.controller import feed_forward, rigid_motion, rigid_path, tune


def test_the_controller_has_its_bandwidth_and_damping() -> None:
    """A step of the reference overshoots by exp(-pi zeta / sqrt(1 - zeta^2)), after half a damped period."""
    model, zeta, bandwidth = serial(motor()), 0.5, 1.5
    gains = tune(model, np.zeros(1), bandwidth, zeta)
    z = np.zeros((1500, 1))
    run = simulate(loop(model), gains, Commands(z + 0.1, z, z, z, z), np.zeros(1))
    damped = math.sqrt(1 - zeta**2)
    np.testing.assert_allclose(run.q.max() / 0.1 - 1, math.exp(-math.pi * zeta / damped), rtol=0.03)
    np.testing.assert_allclose(run.q.argmax() / 1000, 1 / (2 * bandwidth * damped), rtol=0.01)


def test_feed_forward_is_the_rigid_robots_inverse_dynamics() -> None:
    """Accelerating both motors from rest needs T^T M T q_a'' beyond the holding torque, springs out of it."""
    model = serial(arm(damping=20.0))
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    T, z, a = rigid_motion(model, point.q), np.zeros((1, 2)), np.array([[2.0, -1.0]])
    inertia = T.T @ model.mass(point.q, model.theta).full() @ T
    np.testing.assert_allclose(feed_forward(model, point.q, z, z, a)[0], point.u + inertia @ a[0], rtol=1e-9)
    turned = equilibrium(model, model.theta, Configuration("d", np.array([0.5, -0.7])))
    there = feed_forward(model, point.q, np.array([[0.2, 0.1]]), z, z)[0]
    np.testing.assert_allclose(there, turned.u, rtol=2e-3)


@pytest.mark.parametrize("crank", [0.3, 0.24])
def test_feed_forward_does_the_work_where_the_linkage_is_no_parallelogram(crank: float) -> None:
    """T changes along the path, and T' q_a' with it: the power of the torque is the change of T^T M T's energy."""
    robot = linkage(Rod(0.89, 6.2, 0.52, 0.64), crank)
    lossless = {name: 0.0 for name in robot.parameters() if name.startswith(("d_", "f_", "fm_"))}
    model = minimal(robot.with_parameters(lossless), ModelSpec())
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.1, 0.1])))
    t = np.linspace(0, 0.5, 2001)[:, None]
    omega = 2 * np.pi * np.array([1.0, 1.7])
    position, velocity, accelerating = (
        0.2 * part for part in (np.sin(omega * t), omega * np.cos(omega * t), -(omega**2) * np.sin(omega * t))
    )
    u = feed_forward(model, point.q, position, velocity, accelerating)
    path = rigid_path(model, point.q, point.q[-2:], point.q[-2:] + position)
    E = energy(model, path, (rigid_motion(model, path) @ velocity[:, :, None])[:, :, 0])
    power = np.sum(u * velocity, axis=1)
    work = np.concatenate([[0.0], np.cumsum(power[1:] + power[:-1]) / 2 * t[1, 0]])
    np.testing.assert_allclose(E - E[0], work, rtol=0, atol=2e-4 * np.ptp(work))


def test_the_integral_gain_is_the_rate_of_the_velocity_loop() -> None:
    """1 / T_i, and none without an integral time."""
    model = serial(motor())
    assert tune(model, np.zeros(1), 2.0, 0.7, 0.25).ki.tolist() == [4.0]
    assert tune(model, np.zeros(1), 2.0, 0.7).ki.tolist() == [0.0]
