"""What is exported of a robot with loops, in either formulation, has the response of the linear model."""

import importlib.util
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import StudyError
from elastid.experiment.specs.recorded import ChannelSpec
from elastid.experiment.specs.responses import ResponseFileSpec, ResponsesSpec
from elastid.export.targets import TARGETS
from elastid.fit.fitted_model import FittedModel, models_by_group
from elastid.fit.result import FitResult
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response, to_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.recorded.responses.reading import link_side_response, read_table
from elastid.study import load_robot

ROBOTS = Path(__file__).parents[2] / "configs" / "robots"
LINES = np.geomspace(0.5, 120, 40)
SPECS = {"constrained": ModelSpec("constrained"), "minimal": ModelSpec("minimal")}


@pytest.fixture(params=["linkage_arm", "irb4400_linkage"])
def robot_file(request: pytest.FixtureRequest) -> Path:
    return ROBOTS / f"{request.param}.yml"


@pytest.fixture(params=SPECS)
def model(request: pytest.FixtureRequest, robot_file: Path) -> FittedModel:
    """As if a fit had ended at stiffnesses a tenth above the robot's."""
    robot, spec = load_robot(robot_file), SPECS[request.param]
    parameters = choose(FitSpec(parameters={"k_*": ParameterSpec()}), robot)
    x = np.array([p.to_x(1.1 * p.value) for p in parameters.free])
    n = len(x)
    result = FitResult(
        parameters, x, 1e-4 * np.eye(n), 1.0, 1, 1.0, "converged", "", (), 0, np.zeros(n, bool), np.ones(n), "log"
    )
    equations, responses = formulate(robot, spec), []
    for name, angles in (("one", (0.1, 0.3, -0.1)), ("two", (0.4, -0.4, 0.2))):
        at = Configuration(name, np.array(angles[-len(robot.driven) :]))
        linear = linearise(equations, at, equations.theta, equations.inputs, "acceleration")
        responses.append(to_response(linear, linear.theta_ref, LINES))
    return models_by_group(result, robot, responses, spec, "linkage")[""]


def ours(model: FittedModel, configuration: int = 0) -> ComplexArray:
    return frequency_response(model.linear[configuration], model.theta, LINES)


def close(G: ComplexArray, expected: ComplexArray, part: float = 1e-8) -> bool:
    """Relative to the largest element on each line."""
    return bool(np.all(np.abs(G - expected) <= part * np.abs(expected).max(axis=(1, 2), keepdims=True)))


def read_back(model: FittedModel, function: Any, B: FloatArray) -> ComplexArray:
    """The response of exported functions at an equilibrium: by the saddle point where constraints are exported."""
    point = equilibrium(model.model, model.theta[:-1], model.linear[0].configuration)
    n, q = len(point.q), point.q
    held = (point.lambda_,) if model.model.n_c else ()
    M, D, K = function("mass", q), function("damping", q), function("stiffness", q, *held)
    Phi = function("constraint_jacobian", q) if model.model.n_c else np.zeros((0, n))
    if model.model.n_c:
        assert np.abs(function("constraint", q)).max() < 1e-10
    c, m = np.abs(K).max(), len(Phi)
    G = []
    for s in 2j * np.pi * LINES:
        A = np.block([[s**2 * M + s * D + K, c * Phi.T], [c * Phi, np.zeros((m, m))]])
        X = np.linalg.solve(A, np.vstack([B, np.zeros((m, B.shape[1]))]).astype(complex))
        G.append(s**2 * B.T @ X[:n])
    return np.array(G)


def test_casadi_functions_have_the_response(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["casadi"](tmp_path, model)
    loaded = {path.stem: ca.Function.load(str(path)) for path in tmp_path.glob("*.casadi")}
    assert ("constraint" in loaded) == (model.model.n_c > 0)
    B = loaded["input_matrix"]()["B"].full()
    assert close(read_back(model, lambda name, *at: loaded[name](*at).full(), B), ours(model))


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
def test_c_code_has_the_response(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["c"](tmp_path, model)
    library = tmp_path / "robot.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", tmp_path / "robot.c", "-o", library, "-lm"], check=True)
    B = ca.external("input_matrix", str(library))()["B"].full()
    G = read_back(model, lambda name, *at: ca.external(name, str(library))(*at).full(), B)
    assert close(G, ours(model))


def test_python_control_reads_the_response_back(model: FittedModel, tmp_path: Path) -> None:
    pytest.importorskip("control", reason="python-control is not installed (group oracles)")
    _, script = TARGETS["control"](tmp_path, model)
    specification = importlib.util.spec_from_file_location("load_linkage", script)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    systems, _ = module.load()
    for i, name in enumerate(("one", "two")):
        G = np.moveaxis(np.asarray(systems[name](2j * np.pi * LINES, squeeze=False)), 2, 0)
        assert close(G, ours(model, i), 1e-6)


def test_matlab_state_space_has_the_response(model: FittedModel, tmp_path: Path) -> None:
    from scipy.io import loadmat

    data, _ = TARGETS["matlab"](tmp_path, model)
    content = loadmat(data, squeeze_me=False, struct_as_record=True)
    for i in range(2):
        system = content["model"][i, 0]
        A, B, C, D = (np.asarray(system[name], float) for name in "ABCD")
        s = 2j * np.pi * LINES[:, None, None]
        assert close(C @ np.linalg.solve(s * np.eye(len(A)) - A, B.astype(complex)) + D, ours(model, i))


def test_csv_responses_are_what_a_study_reads(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["csv"](tmp_path, model)
    channels = [ChannelSpec("u", place, channel=place) for place in model.linear[0].inputs]
    channels += [ChannelSpec("y", place, channel=place, quantity="acceleration") for place in model.linear[0].outputs]
    spec = ResponsesSpec((ResponseFileSpec("one-fitted.csv", "one"),), tuple(channels), relative_std=0.1)
    table = read_table(tmp_path / "one-fitted.csv", spec, "")
    G = link_side_response(table, spec, model.measured[0].configuration, model.robot, "acceleration")
    assert close(G.G, ours(model), 1e-12)


def test_mujoco_is_refused_with_what_holds_loops(model: FittedModel, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"has loops \(rod\).*export to casadi, c, control or matlab"):
        TARGETS["mujoco"](tmp_path, model)
