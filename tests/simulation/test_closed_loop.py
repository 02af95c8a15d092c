"""The loop is that of its sampled controller, and a motor that leaves it is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.integration import acceleration, runge_kutta
from plants.two_links import (
    arm,
    loop,
    quiet,
)

from elastid.base.errors import DataError
from elastid.linear.equilibrium import equilibrium
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.simulation.closed_loop import CHUNK_SAMPLES, simulate
from elastid.simulation.controller import Gains, tune


def test_gravity_is_held_from_the_start() -> None:
    """Started in its equilibrium with its holding torque the arm does not move, second after second."""
    model = serial(arm(damping=20.0))
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    commands = quiet(model, point.q, 2500)
    np.testing.assert_allclose(commands.torque[0], point.u, rtol=1e-9)
    run = simulate(loop(model), tune(model, point.q, 1.5, 0.8), commands, point.q)
    np.testing.assert_allclose(run.q, np.tile(point.q, (2500, 1)), atol=1e-10)


def test_the_loop_is_that_of_a_plain_python_loop() -> None:
    """Sample by sample with the controller written out, across the border of two chunks."""
    model, n = serial(arm(damping=20.0)), CHUNK_SAMPLES + 50
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    random = np.random.default_rng(2)
    torque, disturbance, noise = random.normal(0, [50, 5, 1e-5], (n, 2, 3)).transpose(2, 0, 1)
    commands = replace(quiet(model, point.q, n, torque), disturbance=disturbance, reading_noise=noise)
    gains = tune(model, point.q, 1.5, 0.8)
    run = simulate(loop(model, coulomb=4.0, count=2e-6), gains, commands, point.q)

    advance = runge_kutta(acceleration(model, np.full(2, 4.0)), 5e-4, 2)
    q, v, last = point.q, np.zeros(4), point.q[2:]
    for k in range(n):
        reading = 2e-6 * np.round((q[2:] + noise[k]) / 2e-6)
        u = commands.torque[k] + gains.kp * (point.q[2:] - reading) - gains.kd * (reading - last) * 1000
        np.testing.assert_allclose(run.q[k], q, atol=1e-9)
        np.testing.assert_allclose(run.u[k], u, atol=1e-3)
        q, v = (part.full()[:, 0] for part in advance(q, v, u + disturbance[k]))
        last = reading


def test_a_lost_motor_is_named_with_the_time() -> None:
    """Gains that make the sampled loop unstable end in words, not in NaN."""
    model = serial(arm(damping=20.0))
    commands = quiet(model, np.zeros(4), 3000, np.ones((3000, 2)))
    with pytest.raises(DataError, match=r"motor [12] is lost 0\.\d+ s after the start"):
        simulate(loop(model), tune(model, np.zeros(4), 400.0, 0.8), commands, np.zeros(4))
    limited = replace(loop(model), limits=np.array([[-0.01, 0.01], [-9, 9]]))
    with pytest.raises(DataError, match=r"motor 1 is lost .* within \[-0.01, 0.01\] rad"):
        simulate(limited, Gains(np.zeros(2), np.zeros(2)), commands, np.zeros(4))
