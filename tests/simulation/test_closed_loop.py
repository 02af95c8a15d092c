"""The loop is that of its sampled controller, and a motor that leaves it is named."""

import logging
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from plants.arm import resting
from plants.integration import acceleration, runge_kutta
from plants.marks import needs_compiler
from plants.two_links import FREE, arm, loop, motor, quiet, rough

from elastid.friction.dynamic import Bristle
from elastid.friction.robot_friction import PlacedLaw
from elastid.model.formulation import serial
from elastid.record import JointLoop
from elastid.robot import Friction
from elastid.simulation.closed_loop import (
    CHUNK_SAMPLES,
    MIN_CALLS,
    Commands,
    Trajectory,
    closed_loop,
    compile_function,
    simulate,
)
from elastid.simulation.contacts import contacts
from elastid.simulation.controller import tune
from elastid.simulation.drives import Drives
from elastid.simulation.runge_kutta import FIFTH_ORDER


def test_the_loop_is_that_of_a_plain_python_loop() -> None:
    """Sample by sample with the controller written out, across the border of two chunks."""
    model, n = serial(arm(damping=20.0)), CHUNK_SAMPLES + 50
    point = resting(model, 0.3, -0.8)
    random = np.random.default_rng(2)
    torque, disturbance, noise = random.normal(0, [50, 5, 1e-5], (n, 2, 3)).transpose(2, 0, 1)
    commands = replace(quiet(model, point.q, n, torque), disturbance=disturbance, reading_noise=noise)
    gains = tune(model, point.q, 1.5, 0.8)
    run = simulate(loop(model, coulomb=4.0, count=2e-6), gains, commands, point.q)

    advance = runge_kutta(acceleration(model, np.full(2, 4.0)), 5e-4, 2, FIFTH_ORDER)
    q, v, last = point.q, np.zeros(4), point.q[2:]
    for k in range(n):
        reading = 2e-6 * np.round((q[2:] + noise[k]) / 2e-6)
        u = commands.torque[k] + gains.kp * (point.q[2:] - reading) - gains.kd * (reading - last) * 1000
        np.testing.assert_allclose(run.q[k], q, atol=1e-9)
        np.testing.assert_allclose(run.u[k], u, atol=1e-3)
        q, v = (part.full()[:, 0] for part in advance(q, v, u + disturbance[k]))
        last = reading


def test_the_integral_acts_and_stops_where_a_drive_clips() -> None:
    """A motor against a constant load: u = clip(e + k_i I), and I grows by e / rate where u is not clipped."""
    model, limit, n = serial(motor()), 15.0, 400
    gains, z = tune(model, np.zeros(1), 3.0, 0.8, integral_time=0.1), np.zeros((n, 1))
    drives = Drives(np.zeros(1), np.array([limit]))
    clipped = closed_loop(model, rough(model, 0.0), FREE[:1], 1000.0, 1, drives)
    run = simulate(clipped, gains, Commands(z + 3e-3, z, z, z - 8.0, z), np.zeros(1))
    q = v = last = integral = 0.0
    for k in range(n):
        e = gains.kp[0] * (3e-3 - q) - gains.kd[0] * (q - last) * 1000
        asked = e + gains.ki[0] * integral
        u = float(np.clip(asked, -limit, limit))
        np.testing.assert_allclose([run.q[k, 0], run.u[k, 0]], [q, u], rtol=1e-8, atol=1e-10)
        integral += e / 1000 if u == asked else 0.0
        last, a = q, (u - 8.0) / 20.0
        q, v = q + v / 1000 + a / 2e6, v + a / 1000
    assert run.u.max() == limit
    assert run.u[-1, 0] == pytest.approx(8.0, rel=0.1)


def test_a_motion_begins_as_it_goes_on() -> None:
    """A motor at constant speed under the torque of its bent bristles keeps its speed from the first sample on."""
    model, n, speed = serial(motor()), 300, 0.4
    bristles = contacts(model, [PlacedLaw("motor 1", Bristle(1e5, 20.0), Friction(coulomb=30.0), 1.0)])
    drives = Drives(np.zeros(1), np.array([np.inf]))
    sliding = closed_loop(model, bristles, FREE[:1], 1000.0, 1, drives)
    z = np.zeros((n, 1))
    free = JointLoop(np.zeros(1), np.zeros(1))
    run = simulate(sliding, free, Commands(z, z, z + 30.0, z, z), np.zeros(1), v0=np.full(1, speed))
    np.testing.assert_allclose(run.q[:, 0], speed * np.arange(n) / 1000, rtol=1e-6, atol=1e-9)


@pytest.fixture(autouse=True)
def temporary(monkeypatch, tmp_path) -> Iterator[Path]:
    """A folder of temporary files and a choice of compilers of the test's own; nothing is left in the folder."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.delenv("CC", raising=False)
    yield folder
    assert not list(folder.iterdir())


def wave(divisor: float = 3.0) -> ca.Function:
    """A function with the arithmetic that compilers like to rearrange."""
    x = ca.SX.sym("x", 2)
    return ca.Function("wave", [x], [ca.sin(x[0]) * ca.cos(x[0]) + x[1] * x[0] ** 3 + ca.exp(-x[1]) / divisor])


def is_machine_code(function: ca.Function) -> bool:
    """True if it comes from a library."""
    return bool(function.class_name() != wave().class_name())


def compiler_script(folder: Path, body: str) -> str:
    path = folder / "compiler"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return str(path)


@needs_compiler
def test_motion_is_equal_without_compiler() -> None:
    """Two links with friction, counts and noise in closed loop."""
    model, n, random = serial(arm(damping=20.0)), 1500, np.random.default_rng(2)
    point = resting(model, 0.3, -0.8)
    commands = quiet(model, point.q, n, random.normal(0, 50, (n, 2)))
    drives, gains = Drives(np.full(2, 2e-6), np.full(2, np.inf)), tune(model, point.q, 1.5, 0.8)

    def moved(samples: int) -> Trajectory:
        loop = closed_loop(model, rough(model, 4.0), FREE[:2], 1000.0, 2, drives, samples=samples)
        return simulate(loop, gains, commands, point.q)

    virtual, machine = moved(0), moved(MIN_CALLS)
    assert machine.q.tobytes() == virtual.q.tobytes()
    assert machine.u.tobytes() == virtual.u.tobytes()


@needs_compiler
def test_machine_code_outlives_its_file(caplog: pytest.LogCaptureFixture) -> None:
    """Two functions of the same name with other numbers, evaluated after their libraries are gone."""
    first, second = (compile_function(function, MIN_CALLS) for function in (wave(), wave(7.0)))
    x = np.array([0.7, -1.3])
    assert is_machine_code(first)
    assert is_machine_code(second)
    assert float(first(x)) == float(wave()(x))
    assert float(second(x)) == float(wave(7.0)(x))
    assert not caplog.messages


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("echo no licence >&2; exit 1", "status 1 no licence"),
        ("sleep 9", "timed out"),
        ("exit 0", "function.so"),
        ("touch function.so", "function.so"),
        (None, "no C compiler"),
    ],
)
def test_where_the_compiler_fails_a_warning_gives_the_reason(
    body: str | None, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It ends with an error, hangs with a child of its own, writes nothing or no library, or is missing."""
    monkeypatch.setenv("CC", str(tmp_path / "none") if body is None else compiler_script(tmp_path, body))
    monkeypatch.setattr("elastid.simulation.closed_loop.MAX_COMPILE_S", 0.2)
    assert not is_machine_code(compile_function(wave(), MIN_CALLS))
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert reason in record.message
    assert "experiment.simulated.compiled" in record.message
