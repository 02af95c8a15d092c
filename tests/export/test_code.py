"""CasADi functions and C code, loaded again, have the response of the linear model."""

import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from plants.fitted_models import close, responses_of

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.export.code import write_c, write_casadi
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.equilibrium import equilibrium


def read_back(model: FittedRobot, function: Any, B: FloatArray) -> ComplexArray:
    """The response of exported functions at an equilibrium: by the saddle point where constraints are exported."""
    point = equilibrium(model.model, model.theta[:-1], model.linear[0].configuration)
    n, q = len(point.q), point.q
    multipliers = (point.lambda_,) if model.model.n_c else ()
    M, D, K = function("mass", q), function("damping", q), function("stiffness", q, *multipliers)
    Phi = function("constraint_jacobian", q) if model.model.n_c else np.zeros((0, n))
    if model.model.n_c:
        assert np.abs(function("constraint", q)).max() < 1e-10
    c, m = np.abs(K).max(), len(Phi)
    G = []
    for s in 2j * np.pi * model.measured[0].freq_hz:
        A = np.block([[s**2 * M + s * D + K, c * Phi.T], [c * Phi, np.zeros((m, m))]])
        X = np.linalg.solve(A, np.vstack([B, np.zeros((m, B.shape[1]))]).astype(complex))
        G.append(s**2 * B.T @ X[:n] * np.exp(-s * model.theta[-1]))
    return np.array(G)


def accuracy(model: FittedRobot) -> float:
    return 1e-8 if model.robot.loops else 1e-9


def test_casadi_functions_have_the_response(model: FittedRobot, tmp_path: Path) -> None:
    """And without loops the force at rest is one that the motors hold."""
    write_casadi(tmp_path, model)
    loaded = {path.stem: ca.Function.load(str(path)) for path in tmp_path.glob("*.casadi")}
    assert ("constraint" in loaded) == (model.model.n_c > 0)
    B = loaded["input_matrix"]()["B"].full()
    G = read_back(model, lambda name, *at: loaded[name](*at).full(), B)
    assert close(G, responses_of(model), accuracy(model))
    if not model.robot.loops:
        q = equilibrium(model.model, model.theta[:-1], model.linear[0].configuration).q
        force = loaded["force"](q, 0).full()[:, 0]
        assert np.abs(force - B @ (B.T @ force)).max() <= 1e-9 * max(1.0, np.abs(force).max())


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
def test_c_code_has_the_response(model: FittedRobot, tmp_path: Path) -> None:
    """Compiled without dependencies."""
    write_c(tmp_path, model)
    library = tmp_path / "robot.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", tmp_path / "robot.c", "-o", library, "-lm"], check=True)
    B = ca.external("robot_input_matrix", str(library))()["B"].full()
    G = read_back(model, lambda name, *at: ca.external(f"robot_{name}", str(library))(*at).full(), B)
    assert close(G, responses_of(model), accuracy(model))


def test_coordinates_are_named(model: FittedRobot, tmp_path: Path) -> None:
    """Every entry of q and u, and the equation that the functions are parts of."""
    text = write_casadi(tmp_path, model)[-1].read_text()
    assert ("phi(q) = 0" in text) == (model.model.n_c > 0)
    for letter, names in (("q", model.model.coordinates), ("u", model.model.inputs)):
        assert all(f"{letter}[{i}]  {name}\n" in text for i, name in enumerate(names))


def test_the_header_says_what_the_functions_take(model: FittedRobot, tmp_path: Path) -> None:
    """Sizes, coordinates and units stand above the declarations."""
    header = write_c(tmp_path, model)[1].read_text()
    n = model.model.n_q
    assert f"robot_mass: arg[0] q ({n}) -> res[0] M ({n} x {n})" in header
    assert f"q[0]  {model.model.coordinates[0]} (rad" in header
    assert header.count("/*") == header.count("*/")
