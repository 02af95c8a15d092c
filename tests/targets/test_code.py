"""CasADi functions and C code, loaded again, have the response of the linear model."""

import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from plants.fitted_models import close, fitted_model, responses_of, rest_of
from plants.marks import needs_compiler

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.fitted_robot import FittedRobot
from elastid.targets.code import write_c, write_casadi


def read_back(model: FittedRobot, function: Any, B: FloatArray) -> ComplexArray:
    """The response of exported functions at an equilibrium: by the saddle point where constraints are exported."""
    point = rest_of(model)
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


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["casadi", pytest.param("c", marks=needs_compiler)])
def test_exported_functions_have_the_response(model: FittedRobot, kind: str, tmp_path: Path) -> None:
    """Loaded again; in C compiled without dependencies."""
    write_casadi(tmp_path, model)
    write_c(tmp_path, model)
    library = str(tmp_path / "robot.so")
    if kind == "c":
        subprocess.run(["cc", "-O1", "-shared", "-fPIC", tmp_path / "robot.c", "-o", library, "-lm"], check=True)

    def loaded(name: str) -> Any:
        return ca.external(f"robot_{name}", library) if kind == "c" else ca.Function.load(f"{tmp_path}/{name}.casadi")

    G = read_back(model, lambda name, *at: loaded(name)(*at).full(), loaded("input_matrix")()["B"].full())
    assert close(G, responses_of(model), 1e-8 if model.robot.loops else 1e-9)
    assert (tmp_path / "constraint.casadi").exists() == (model.model.n_c > 0)


def test_equilibria_are_at_rest(model: FittedRobot, tmp_path: Path) -> None:
    """Loaded again, f(q, 0) + Phi^T lambda = B u in each posture of the study, whose columns the text names."""
    text = write_casadi(tmp_path, model)[-1].read_text()
    loaded = {path.stem: ca.Function.load(str(path)) for path in tmp_path.glob("*.casadi")}
    rest, B = loaded["equilibria"](), loaded["input_matrix"]()["B"].full()
    for i, linear in enumerate(model.linear):
        assert f"column {i} of equilibria: {linear.configuration.name}\n" in text
        q, u = rest["q"].full()[:, i], rest["u"].full()[:, i]
        force = loaded["force"](q, 0).full()[:, 0]
        if model.model.n_c:
            force = force + loaded["constraint_jacobian"](q).full().T @ rest["lambda_"].full()[:, i]
        np.testing.assert_allclose(force, B @ u, atol=1e-7 * max(1.0, np.abs(force).max()))
        np.testing.assert_allclose(B.T @ q, linear.configuration.angles, atol=1e-12)


@needs_compiler
def test_a_program_in_c_reads_the_equilibria(tmp_path: Path) -> None:
    """A caller in C without CasADi: q of the second posture and the weight that its motors hold."""
    model = fitted_model("arm")
    write_c(tmp_path, model)
    n, n_u = model.model.n_q, model.model.n_u
    (tmp_path / "main.c").write_text(f"""
#include <stdio.h>
#include "robot.h"
int main(void) {{
  double q[{2 * n}], u[{2 * n_u}], *res[2] = {{q, u}};
  if (robot_equilibria(0, res, 0, 0, 0)) return 1;
  for (int i = 0; i < {n}; i++) printf("%.17g\\n", q[{n} + i]);
  for (int i = 0; i < {n_u}; i++) printf("%.17g\\n", u[{n_u} + i]);
  return 0;
}}
""")
    program = tmp_path / "main"
    subprocess.run(["cc", tmp_path / "main.c", tmp_path / "robot.c", "-o", program, "-lm"], check=True)
    numbers = np.array(subprocess.run([program], capture_output=True, text=True, check=True).stdout.split(), float)
    point = rest_of(model, 1)
    np.testing.assert_allclose(numbers, np.concatenate([point.q, point.u]), rtol=1e-13)
