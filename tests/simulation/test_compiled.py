"""Machine code gives the bytes of CasADi's virtual machine; where it cannot be made, a warning says so."""

from __future__ import annotations

import logging
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from plants.two_links import FREE, arm, quiet, rough

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.simulation import compiled as module
from elastid.simulation.closed_loop import Trajectory, closed_loop, simulate
from elastid.simulation.compiled import MIN_CALLS, compiled
from elastid.simulation.controller import tune
from elastid.simulation.drives import Drives

with_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")


@pytest.fixture(autouse=True)
def temporary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
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
    """A stand-in for a compiler."""
    path = folder / "compiler"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return str(path)


@with_compiler
def test_a_motion_has_the_same_bytes_with_and_without_a_compiler() -> None:
    """Two links with friction, counts and noise in closed loop."""
    model, n, random = serial(arm(damping=20.0)), 1500, np.random.default_rng(2)
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    commands = quiet(model, point.q, n, random.normal(0, 50, (n, 2)))
    drives, gains = Drives(np.full(2, 2e-6), np.full(2, np.inf)), tune(model, point.q, 1.5, 0.8)

    def moved(samples: int) -> Trajectory:
        loop = closed_loop(model, rough(model, 4.0), FREE[:2], 1000.0, 2, drives, samples=samples)
        return simulate(loop, gains, commands, point.q)

    machine, virtual = moved(MIN_CALLS), moved(0)
    assert machine.q.tobytes() == virtual.q.tobytes()
    assert machine.u.tobytes() == virtual.u.tobytes()


@with_compiler
def test_machine_code_outlives_its_file(caplog: pytest.LogCaptureFixture) -> None:
    """Two functions of the same name with other numbers, evaluated after their libraries are gone."""
    first, second = (compiled(function, MIN_CALLS) for function in (wave(), wave(7.0)))
    x = np.array([0.7, -1.3])
    assert is_machine_code(first)
    assert is_machine_code(second)
    assert float(first(x)) == float(wave()(x))
    assert float(second(x)) == float(wave(7.0)(x))
    assert not caplog.messages


def test_a_function_that_is_seldom_called_is_not_compiled() -> None:
    assert not is_machine_code(compiled(wave(), MIN_CALLS - 1))


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
    monkeypatch.setattr(module, "MAX_COMPILE_S", 0.2)
    assert not is_machine_code(compiled(wave(), MIN_CALLS))
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert reason in record.message
    assert "experiment.simulated.compiled" in record.message


def test_a_compiler_with_an_unclosed_quote_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The words of CC are split as a shell splits them, which fails without a traceback."""
    monkeypatch.setenv("CC", 'gcc "')
    with pytest.raises(OSError, match=r'CC=gcc " is no command: No closing quotation'):
        module.compiler()
