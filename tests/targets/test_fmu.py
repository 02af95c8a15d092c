"""Functional mock-up units: accepted by a validator, and equal to the simulation of the same robot."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from plants.fitted_models import fitted_model, rest_of
from plants.marks import needs_compiler
from scipy.linalg import expm

from elastid.base.arrays import FloatArray
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import equilibrium
from elastid.record import JointLoop
from elastid.simulation.closed_loop import Commands, Trajectory, closed_loop, simulate
from elastid.simulation.contacts import contacts
from elastid.simulation.controller import tune
from elastid.simulation.drives import Drives
from elastid.targets.fmu import write_fmu

fmpy = pytest.importorskip("fmpy", reason="fmpy is in the group oracles")
pytestmark = pytest.mark.oracle

RATE_HZ = 1000.0
SUBSTEPS = 8
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("manutec", "arm", "linkage_arm constrained")]
ROBOTS = ["bench", *SLOW, "linkage_arm minimal"]


def gains_of(model: FittedRobot) -> JointLoop:
    """Feedback with a bandwidth of 3 Hz in the first configuration."""
    return tune(model.model, rest_of(model).q, 3.0, 0.7)


def starts_of(model: FittedRobot) -> dict[str, float]:
    """The same feedback as start values of a unit."""
    gains = gains_of(model)
    return {
        f"{name} of {motor}": float(value)
        for name in ("kp", "kd")
        for motor, value in zip(model.model.inputs, getattr(gains, name), strict=True)
    }


def simulated(model: FittedRobot, torque: FloatArray) -> Trajectory:
    """Our own simulation from the first configuration, feedback about its posture; torque (n, n_u) beside holding."""
    equations = model.model
    point = equilibrium(equations, model.theta[:-1], model.linear[0].configuration)
    n, n_u = torque.shape
    ideal = Drives(np.zeros(n_u), np.full(n_u, np.inf))
    limits = np.tile([-1e3, 1e3], (n_u, 1))
    loop = closed_loop(equations, contacts(equations, frictions(model.robot)), limits, RATE_HZ, SUBSTEPS, ideal)
    zero, at = np.zeros((n, n_u)), np.tile(equations.B.T @ point.q, (n, 1))
    return simulate(loop, gains_of(model), Commands(at, zero, point.u + torque, zero, zero), point.q)


@pytest.fixture(scope="module", params=ROBOTS)
def unit(request, tmp_path_factory) -> tuple[FittedRobot, Path]:
    """A fitted robot and the folder of its units."""
    model = fitted_model(request.param)
    folder = tmp_path_factory.mktemp("fmu")
    write_fmu(folder, model)
    return model, folder


def run(model: FittedRobot, path: Path, torque: FloatArray, starts: dict[str, float]) -> FloatArray:
    """Angles of the motors (n, n_u) that a unit gives, torque (n, n_u) beside what holds the posture."""
    inputs = model.model.inputs
    point = rest_of(model)
    t = np.arange(len(torque)) / RATE_HZ
    signals = np.zeros(len(t), [("time", float), *((f"torque of {motor}", float) for motor in inputs)])
    signals["time"] = t
    for i, motor in enumerate(inputs):
        signals[f"torque of {motor}"] = torque[:, i] + point.u[i]
    out = fmpy.simulate_fmu(
        str(path), stop_time=t[-1], step_size=1 / RATE_HZ, output_interval=1 / RATE_HZ, input=signals,
        start_values={"largest_step": 1 / RATE_HZ / SUBSTEPS, **starts},
        output=[f"angle of {motor}" for motor in inputs],
    )  # fmt: skip
    return np.stack([out[f"angle of {motor}"] for motor in inputs], axis=1)


def shaken(model: FittedRobot, n: int) -> FloatArray:
    """Torques (n, n_u) that change from sample to sample, of a size that moves every motor by some 0.01 rad."""
    n_u, t = model.model.n_u, np.arange(n)[:, None] / RATE_HZ
    return 0.01 * gains_of(model).kp * np.sin(2 * np.pi * (3 + 2 * np.arange(n_u)) * t) * (1 - np.cos(2 * np.pi * t))


@needs_compiler
@pytest.mark.parametrize("version", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_unit_moves_as_our_simulation(unit: tuple[FittedRobot, Path], version: int) -> None:
    """To 1e-6 of the motion over a second, under feedback and driven torque, friction included."""
    model, folder = unit
    torque = shaken(model, 1001)
    found = run(model, folder / f"robot_fmi{version}.fmu", torque, starts_of(model))
    expected = simulated(model, torque).q @ model.model.B
    moved = np.abs(expected - expected[0]).max()
    assert moved > 1e-4
    assert np.abs(found - expected[: len(found)]).max() < 1e-6 * moved


def test_a_validator_has_no_complaint(unit: tuple[FittedRobot, Path]) -> None:
    """About description and archive of both versions, each of which has the sources that it names and no others."""
    from fmpy import validation

    for version, description in ((2, "modelDescription.xml"), (3, "sources/buildDescription.xml")):
        path = unit[1] / f"robot_fmi{version}.fmu"
        assert validation.validate_fmu(str(path)) == []
        with zipfile.ZipFile(path) as archive:
            named = {each.get("name") for each in ET.fromstring(archive.read(description)).iter() if "File" in each.tag}
            inside = {name for name in archive.namelist() if name.endswith((".c", "buildDescription.xml"))}
        build = {description} if version == 3 else set()
        assert inside == {f"sources/{name}" for name in named if name} | build


@needs_compiler
def test_a_number_is_tunable_by_its_name(unit: tuple[FittedRobot, Path]) -> None:
    """A softer first spring moves the motors otherwise."""
    model, folder = unit
    spring = next(name for name in model.model.parameters if name.startswith("k_"))
    stiff = float(model.model.theta[model.model.parameters.index(spring)])
    gains, torque = starts_of(model), shaken(model, 201)
    plain, soft = (run(model, folder / "robot_fmi2.fmu", torque, gains | {spring: k}) for k in (stiff, stiff / 2))
    assert np.abs(plain - soft).max() > 1e-9
    np.testing.assert_array_equal(plain, run(model, folder / "robot_fmi2.fmu", torque, gains))


@pytest.mark.slow
@needs_compiler
def test_force_at_frame_moves_it_as_linear_model(tmp_path: Path) -> None:
    """A step of 3 N on the tool of a robot without dry friction: its path over 80 ms, by the matrix exponential."""
    model = fitted_model("scara")
    write_fmu(tmp_path, model)
    point = rest_of(model)
    ports = [f"frame tool {axis}" for axis in "xyz"]
    free = model.result.at(
        model.linear[0].configuration, ["force tool x", "force tool y"], ports, motors="free", axes="world"
    ).state_space()  # fmt: skip
    force, h, n = np.array([2.0, -1.0]), 1e-3, 80
    A = np.block([[free.A, free.B @ force[:, None]], [np.zeros((1, len(free.A) + 1))]])
    x = [expm(A * h * k)[:-1, -1] for k in range(n + 1)]
    starts = {f"torque of {motor}": float(u) for motor, u in zip(model.model.inputs, point.u, strict=True)}
    starts |= {"force x of frame tool": 2.0, "force y of frame tool": -1.0, "largest_step": h / SUBSTEPS}
    for version in (2, 3):
        out = fmpy.simulate_fmu(
            str(tmp_path / f"robot_fmi{version}.fmu"), stop_time=n * h, step_size=h, output_interval=h,
            start_values=starts, output=[f"position {axis} of frame tool" for axis in "xyz"],
        )  # fmt: skip
        found = np.stack([out[f"position {axis} of frame tool"] for axis in "xyz"], axis=1)
        expected = np.array(x) @ free.C.T
        moved = np.abs(expected).max()
        assert moved > 1e-5
        np.testing.assert_allclose(found - found[0], expected[: len(found)], atol=5e-3 * moved)
