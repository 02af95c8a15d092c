"""What is exported is the identified model: its frequency response, read back by another tool, is ours."""

import csv
import importlib.util
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from elastid.app.cli import run_command
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
from elastid.linear.statespace import state_space
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.recorded.responses.reading import link_side_response, read_table
from elastid.robot import Anchor, Body, CoilSpring, Compensator, Joint, Motor, Placement, Robot, Spring
from elastid.study import load_robot

ROOT = Path(__file__).parents[2]
ROBOTS = {
    "manutec": ROOT / "configs" / "robots" / "manutec_r3.yml",
    "arm": ROOT / "elastid" / "app" / "templates" / "serial" / "robot.yml",
    "bench": ROOT / "configs" / "robots" / "two_inertia_bench.yml",
    "table": ROOT / "configs" / "robots" / "kr300_twelve_springs.yml",
}
LINES = np.geomspace(0.5, 100, 40)
DELAY = 4e-4


def result_of(robot: Robot) -> FitResult:
    """As if a fit had ended at stiffnesses a tenth above the robot's and a delay."""
    springs = {"k_*": ParameterSpec(), "delay": ParameterSpec(bounds=(0.0, 0.01))}
    parameters = choose(FitSpec(parameters=springs), robot)
    x = np.array([p.to_x(DELAY if p.name == "delay" else 1.1 * p.value) for p in parameters.free])
    n = len(x)
    return FitResult(
        parameters, x, 1e-4 * np.eye(n), 1.0, 1, 1.0, "converged", "", (), 0, np.zeros(n, bool), np.ones(n), "log"
    )


def scara() -> Robot:
    """Two turning axes, an elastic tilt of the first, and a screw that slides; products of inertia."""
    axes = (
        Joint("1", "z", Spring(2e5, 150.0), Motor(1.2e-3, 100, 1e-3)),
        Joint("1x", "x", Spring(4e5, 100.0)),
        Joint("2", "z", Spring(8e4, 60.0), Motor(8e-4, 80, 8e-4)),
        Joint("3", "z", Spring(3e6, 900.0), Motor(2e-4, 600.0, 1e-4), motion="translation"),
    )
    inertia = (0.2, 0.6, 0.7, 0.02, 0.01, 0.0)
    first = Body("a", "base", Placement((0, 0, 0.5)), axes[:2], 20, (0.2, 0.01, 0.03), inertia)
    second = Body("b", "a", Placement((0.4, 0, 0.05)), axes[2:3], 12, (0.15, 0, 0.06), (0.1, 0.25, 0.3))
    quill = Body("quill", "b", Placement((0.35, 0, 0)), axes[3:], 4, (0.02, 0, -0.1), (0.03, 0.03, 0.005))
    return Robot("scara", (first, second, quill), gravity=(0.0, 0.0, -9.81))


@pytest.fixture(params=[*ROBOTS, "scara"])
def model(request: pytest.FixtureRequest) -> FittedModel:
    robot = load_robot(ROBOTS[request.param]) if request.param in ROBOTS else scara()
    n_u, result = len(robot.driven), result_of(robot)
    responses = []
    for name, angles in (("one", np.linspace(0.3, -0.4, n_u)), ("two", np.linspace(-0.5, 0.6, n_u))):
        model = serial(robot)
        linear = linearise(model, Configuration(name, angles), model.theta, model.inputs, "acceleration")
        responses.append(to_response(linear, linear.theta_ref, LINES))
    return models_by_group(result, robot, responses, name="study")[""]


def ours(model: FittedModel, configuration: int = 0) -> ComplexArray:
    return frequency_response(model.linear[configuration], model.theta, LINES)


def close(G: ComplexArray, expected: ComplexArray, part: float = 1e-9) -> bool:
    """Relative to the largest element on each line: some elements are zero by symmetry."""
    return bool(np.all(np.abs(G - expected) <= part * np.abs(expected).max(axis=(1, 2), keepdims=True)))


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
def test_state_space_has_the_response_of_the_linear_model(model: FittedModel, quantity: Any) -> None:
    linear = replace(model.linear[0], quantity=quantity)
    expected = frequency_response(linear, model.theta, LINES)
    assert close(state_space(linear, model.theta).response(LINES), expected)


def test_python_control_reads_the_response_back(model: FittedModel, tmp_path: Path) -> None:
    pytest.importorskip("control", reason="python-control is not installed (group oracles)")
    _, script = TARGETS["control"](tmp_path, model)
    specification = importlib.util.spec_from_file_location("load_model", script)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    systems, delays = module.load()
    for i, name in enumerate(("one", "two")):
        system = systems[name]
        assert tuple(system.input_labels) == model.linear[i].inputs
        G = system(2j * np.pi * LINES, squeeze=False)
        delayed = np.moveaxis(np.asarray(G), 2, 0) * np.exp(-2j * np.pi * LINES * delays[name])[:, None, None]
        assert delays[name] == pytest.approx(DELAY)
        assert close(delayed, ours(model, i), 1e-7)


def test_matlab_file_holds_state_space_and_idfrd_and_is_read_back(model: FittedModel, tmp_path: Path) -> None:
    from scipy.io import loadmat

    data, script = TARGETS["matlab"](tmp_path, model)
    content = loadmat(data, squeeze_me=False, struct_as_record=True)
    system = content["model"][0, 0]
    A, B, C, D = (np.asarray(system[name], float) for name in "ABCD")
    s = 2j * np.pi * LINES[:, None, None]
    G = (C @ np.linalg.solve(s * np.eye(len(A)) - A, B.astype(complex)) + D) * np.exp(-s * system["InputDelay"].item())
    assert close(G, ours(model))
    fitted = content["fitted"][1, 0]
    assert close(np.moveaxis(fitted["ResponseData"], 2, 0), ours(model, 1), 1e-14)
    assert "idfrd(" in script.read_text()
    assert "ss(" in script.read_text()


def test_csv_responses_are_what_a_study_reads(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["csv"](tmp_path, model)
    channels = [ChannelSpec("u", place, channel=place) for place in model.linear[0].inputs]
    channels += [ChannelSpec("y", place, channel=place, quantity="acceleration") for place in model.linear[0].outputs]
    spec = ResponsesSpec((ResponseFileSpec("one-fitted.csv", "one"),), tuple(channels), relative_std=0.1)
    table = read_table(tmp_path / "one-fitted.csv", spec, "")
    G = link_side_response(table, spec, model.measured[0].configuration, model.robot, "acceleration")
    assert close(G.G, ours(model), 1e-12)


def test_csv_parameters_are_the_fits(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["csv"](tmp_path, model)
    with (tmp_path / "parameters.csv").open() as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    for name, value in model.result.values.items():
        assert float(rows[name]["value"]) == value
    for name, std in model.result.std.items():
        assert float(rows[name]["std"]) == std


def linearised(mass: Any, stiffness: Any, damping: Any, B: FloatArray, q: FloatArray) -> ComplexArray:
    """The response of exported functions at the equilibrium q, motors measured."""
    s = 2j * np.pi * LINES[:, None, None]
    Z = s**2 * mass(q) + s * damping(q) + stiffness(q)
    return np.asarray(s**2 * (B.T @ np.linalg.solve(Z, B.astype(complex))) * np.exp(-s * DELAY))


def resting(model: FittedModel, configuration: int = 0) -> FloatArray:
    return equilibrium(model.model, model.theta[:-1], model.linear[configuration].configuration).q


def test_casadi_functions_have_the_response(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["casadi"](tmp_path, model)
    loaded = {path.stem: ca.Function.load(str(path)) for path in tmp_path.glob("*.casadi")}
    matrix = {name: (lambda q, f=f: f(q).full()) for name, f in loaded.items()}
    B = loaded["input_matrix"]()["B"].full()
    G = linearised(matrix["mass"], matrix["stiffness"], matrix["damping"], B, resting(model))
    assert close(G, ours(model))
    q = resting(model)
    held = loaded["force"](q, 0).full()[:, 0]
    assert np.abs(held - B @ (B.T @ held)).max() <= 1e-9 * max(1.0, np.abs(held).max())


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
def test_c_code_has_the_response(model: FittedModel, tmp_path: Path) -> None:
    TARGETS["c"](tmp_path, model)
    library = tmp_path / "robot.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", tmp_path / "robot.c", "-o", library, "-lm"], check=True)
    compiled = {name: ca.external(name, str(library)) for name in ("mass", "stiffness", "damping", "input_matrix")}
    matrix = {name: (lambda q, f=f: f(q).full()) for name, f in compiled.items() if name != "input_matrix"}
    B = compiled["input_matrix"]()["B"].full()
    G = linearised(matrix["mass"], matrix["stiffness"], matrix["damping"], B, resting(model))
    assert close(G, ours(model))


def test_mujoco_has_the_response(model: FittedModel, tmp_path: Path) -> None:
    """M from the engine, K and D by differences of its forces about the keyframe; rotor angles are measured."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed (group oracles)")
    (path,) = TARGETS["mujoco"](tmp_path, model)
    engine = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(engine)
    for i in range(2):
        mujoco.mj_resetDataKeyframe(engine, data, i)
        q0, v0 = data.qpos.copy(), np.zeros(engine.nv)

        def force(q: FloatArray, v: FloatArray) -> FloatArray:
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_forward(engine, data)
            return np.array(data.qfrc_bias - data.qfrc_passive)

        rest = force(q0, v0)
        M = np.zeros((engine.nv, engine.nv))
        mujoco.mj_fullM(engine, data, M)
        B = np.zeros((engine.nv, engine.nu))
        for u in range(engine.nu):
            B[engine.jnt_dofadr[engine.actuator_trnid[u, 0]], u] = 1
        # The keyframe is an equilibrium: its controls hold it.
        assert rest == pytest.approx(B @ data.ctrl, abs=1e-6 * max(1.0, np.abs(rest).max()))
        step = 1e-4
        K = np.column_stack([(force(q0 + h, v0) - force(q0 - h, v0)) / (2 * step) for h in step * np.eye(engine.nv)])
        D = np.column_stack([(force(q0, h) - force(q0, -h)) / (2 * step) for h in step * np.eye(engine.nv)])
        s = 2j * np.pi * LINES[:, None, None]
        G = s**2 * (B.T @ np.linalg.solve(s**2 * M + s * D + K, B.astype(complex))) * np.exp(-s * DELAY)
        assert close(np.asarray(G), ours(model, i), 1e-5)


def test_the_command_writes_the_same_bytes_twice_and_wants_a_fit(
    tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    assert run_command(["export", str(tiny), "--to", "csv", "--run", str(run)]) == 2
    assert "run `elastid estimate" in capsys.readouterr().err
    assert run_command(["run", str(tiny), "--run", str(run), "-q"]) == 0
    for target in TARGETS:
        contents = []
        for _ in range(2):
            assert run_command(["export", str(tiny), "--to", target, "--run", str(run)]) == 0
            files = sorted((run / "export" / target).iterdir())
            contents.append([(file.name, file.read_bytes()) for file in files])
        assert contents[0] == contents[1]
        assert len(contents[0]) >= 1


def test_the_command_offers_every_target() -> None:
    from elastid.app.cli import _TARGETS

    assert list(TARGETS) == _TARGETS


def test_mujoco_says_which_springs_it_would_lose(tmp_path: Path, model: FittedModel) -> None:
    """A cubic gear or a compensator has no place in MJCF: refused by name."""
    body = next(body for body in model.robot.bodies if any(j.spring is not None for j in body.joints))
    joints = tuple(replace(j, spring=replace(j.spring, cubic=1.0)) if j.spring is not None else j for j in body.joints)
    bodies = tuple(replace(b, joints=joints) if b.name == body.name else b for b in model.robot.bodies)
    ends = (Anchor("base"), Anchor(body.name, (0.0, 0.0, 0.1)))
    bent = replace(model.robot, bodies=bodies, compensators=(Compensator("c", ends, coil=CoilSpring(1.0)),))
    with pytest.raises(StudyError, match=r"linear joint springs only, and the spring of joint .*, compensator c would"):
        TARGETS["mujoco"](tmp_path, replace(model, model=replace(model.model, robot=bent)))
