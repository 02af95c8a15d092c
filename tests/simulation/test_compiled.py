"""Machine code gives the bytes of CasADi's virtual machine; without it, or where it is not safe, everything runs."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from plants.two_links import FREE, arm, quiet, rough

from elastid.base import compiled as module
from elastid.linear.equilibrium import equilibrium
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.simulation.closed_loop import Trajectory, closed_loop, simulate
from elastid.simulation.compiled import MIN_CALLS, compiled
from elastid.simulation.controller import tune
from elastid.simulation.drives import Drives

with_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")


@pytest.fixture(autouse=True)
def _cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A cache folder and a choice of compilers of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)


def wave() -> ca.Function:
    """A function with the arithmetic that compilers like to rearrange."""
    x = ca.SX.sym("x", 2)
    return ca.Function("wave", [x], [ca.sin(x[0]) * ca.cos(x[0]) + x[1] * x[0] ** 3 + ca.exp(-x[1]) / 3])


def is_machine_code(function: ca.Function) -> bool:
    """Whether it comes from a library."""
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
    assert len(list(module.cache_folder().glob("sample-*.so"))) == 1
    assert machine.q.tobytes() == virtual.q.tobytes()
    assert machine.u.tobytes() == virtual.u.tobytes()


@with_compiler
def test_a_function_is_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time its library is loaded; other numbers in it are another library."""
    first = compiled(wave(), MIN_CALLS)
    monkeypatch.setattr(module, "_compile", lambda *_: pytest.fail("compiled again"))
    second = compiled(wave(), MIN_CALLS)
    x = np.array([0.7, -1.3])
    assert is_machine_code(second)
    assert float(first(x)) == float(second(x)) == float(wave()(x))


def test_a_function_that_is_seldom_called_is_not_compiled() -> None:
    assert not is_machine_code(compiled(wave(), MIN_CALLS - 1))


@pytest.mark.parametrize(("body", "said"), [("exit 1", "exit status 1"), ("exec sleep 9", "timed out")])
def test_a_compiler_that_fails_or_takes_too_long_is_done_without(
    body: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """One line for the log, and nothing is left behind."""
    monkeypatch.setenv("CC", compiler_script(tmp_path, body))
    monkeypatch.setattr(module, "MAX_COMPILE_S", 0.2)
    with caplog.at_level(logging.DEBUG):
        assert not is_machine_code(compiled(wave(), MIN_CALLS))
    assert len(caplog.messages) == 1
    assert said in caplog.text
    assert not list(module.cache_folder().iterdir())


def test_without_a_compiler_functions_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "COMPILERS", ())
    assert not is_machine_code(compiled(wave(), MIN_CALLS))


@with_compiler
@pytest.mark.parametrize("is_folder", [True, False])
def test_a_library_that_another_user_could_have_written_is_not_loaded(is_folder: bool) -> None:
    """Neither from a folder that others can write nor from such a file."""
    compiled(wave(), MIN_CALLS)
    folder = module.cache_folder()
    (library,) = folder.iterdir()
    (folder if is_folder else library).chmod(0o777)
    assert not is_machine_code(compiled(wave(), MIN_CALLS))


@with_compiler
def test_a_link_to_a_library_is_not_loaded(tmp_path: Path) -> None:
    """It may lead into the folder of another user."""
    compiled(wave(), MIN_CALLS)
    (library,) = module.cache_folder().iterdir()
    library.symlink_to(library.rename(tmp_path / "elsewhere.so"))
    assert not is_machine_code(compiled(wave(), MIN_CALLS))


@with_compiler
def test_a_broken_library_is_done_without() -> None:
    """As after a crash of the machine."""
    compiled(wave(), MIN_CALLS)
    (library,) = module.cache_folder().iterdir()
    library.write_bytes(b"")
    library.chmod(0o600)
    assert not is_machine_code(compiled(wave(), MIN_CALLS))
