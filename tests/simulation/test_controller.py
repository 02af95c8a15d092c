"""The controller has its bandwidth, its feed-forward the inverse dynamics of the rigid robot."""

from __future__ import annotations

import math

import numpy as np
from plants.two_links import (
    arm,
    loop,
    motor,
)

from elastid.linear.equilibrium import equilibrium
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.simulation.closed_loop import Commands, simulate
from elastid.simulation.controller import feed_forward, rigid_motion, tune


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
