"""A parallel linkage after a fit: its springs are distinguished, or a note says that they cannot be."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.notes import said
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from elastid.app import cli
from elastid.app.compare import compare
from elastid.app.console import Console
from elastid.app.run import Run
from elastid.design.design import design
from elastid.design.problem import DesignProblem
from elastid.design.spec import CandidateSpec, DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import Robot
from elastid.store.measured import write_responses
from elastid.study import load

CONFIGS = Path(__file__).parents[2] / "configs"
SPREAD = ((0.0, 0.0), (0.5, -0.1), (-0.4, 0.4), (0.2, 0.9), (0.6, -0.2), (-0.3, -0.8))
FREE = ("k_2", "k_3", "k_rod", "d_3", "d_rod")


def planar() -> Robot:
    data = YAML(typ="safe").load((CONFIGS / "robots" / "linkage_arm.yml").read_text(encoding="utf-8"))
    return TypeAdapter(Robot).validate_python(data)


@cache
def exact_responses(angles: tuple[tuple[float, float], ...], highest: float) -> list[FrequencyResponse]:
    """As many lines in all, whatever the number of configurations."""
    model = formulate(planar())
    linearisation, lines, responses = Linearisation.of(model), np.linspace(3, highest, 300 // len(angles)), []
    for i, at in enumerate(angles):
        linear = linearisation.at(Configuration(f"c{i}", np.array(at)), model.theta, model.inputs, "acceleration")
        responses.append(to_response(linear, linear.theta_ref, lines))
    return responses


def fitted(
    angles, seed: int = 0, spec: ModelSpec = EXACT, highest: float = 30.0, free: Sequence[str] = FREE
) -> FitResult:
    """A fit of the planar arm's springs from responses of the exact model with 3 % noise, from a start 40 % off."""
    robot, random, responses = planar(), np.random.default_rng(seed), []
    for exact in exact_responses(angles, highest):
        level = 0.03 * np.abs(exact.G)
        noise = random.standard_normal((2, *level.shape)) / np.sqrt(2)
        total = Covariance(level**2, 100.0)
        responses.append(replace(exact, G=exact.G + level * (noise[0] + 1j * noise[1]), total=total))
    start = robot.with_parameters({name: 1.4 * dict(robot.parameters())[name][0] for name in free})
    parameters = {name: ParameterSpec() for name in free}
    weights = WeightSpec(floor=0.01)  # of noise alone a single posture would know more
    return identify(responses, start, FitSpec(parameters=parameters, starts=1, weights=weights), model=spec)


def relative(result: FitResult, name: str) -> float:
    """Standard deviation of a logarithmic parameter."""
    i = result.parameters.free_names.index(name)
    return float(np.sqrt(result.covariance[i, i]))


@pytest.mark.slow
def test_a_single_posture_is_said_to_confuse_gear_and_rod():
    """Below the third mode k_3 and k_rod are one spring there; with the angle spread they are two."""
    one = fitted(SPREAD[:1])
    assert any("k_3 and k_rod cannot be distinguished" in word for word in said(one.notes))
    names = one.parameters.free_names
    assert one.correlation[names.index("k_3"), names.index("k_rod")] < -0.98
    six = fitted(SPREAD)
    assert not any("k_3 and k_rod" in word for word in said(six.notes))
    for name in ("k_3", "k_rod"):
        assert relative(six, name) < 0.3 * relative(one, name)


@pytest.mark.slow
def test_springs_are_recovered_within_their_intervals():
    """Over eight draws of the noise, four by each formulation: all within 4 standard deviations, the mean square 1."""
    robot = planar()
    off = []
    for seed in range(8):
        result = fitted(SPREAD, seed, ModelSpec(("constrained", "minimal")[seed % 2]), 120.0)
        for name in ("k_2", "k_3", "k_rod"):
            truth = dict(robot.parameters())[name][0]
            off.append(np.log(result.values[name] / truth) / relative(result, name))
            assert abs(result.values[name] / truth - 1) < 0.05
    assert np.abs(off).max() < 4
    assert 0.4 < np.mean(np.square(off)) < 1.9


@pytest.mark.slow
def test_an_approximate_model_is_told_from_the_exact_one():
    """One constant stiffness cannot follow the postures: the fit says that the model lacks something."""
    exact = fitted(SPREAD, 0, ModelSpec("minimal"), 60.0)
    assert exact.status == "converged"
    assert exact.model_error < 1.3
    constant = fitted(SPREAD, 0, ModelSpec("minimal", "constant_stiffness"), 60.0, ("k_2", "k_3", "d_3"))
    assert constant.model_error > 3 * exact.model_error


def forecast(**changes: object) -> tuple[list[float], float]:
    """Of the planar arm's springs: sines of the angle between lever and rod, and how k_3 and k_rod will correlate."""
    noise = NoiseSpec(torque_std=10, angle_std=1e-5)
    problem = DesignProblem(
        robot=planar(),
        excitation=MultisineSpec(500.0, 2.0, (2.0, 40.0), (300.0, 300.0), grid="odd-quasi-log"),
        experiment=ExperimentSpec(realisations=1, simulated=SimulatedSpec(noise=noise, substeps=6)),
        fit=FitSpec(parameters={name: ParameterSpec() for name in FREE}, starts=1),
        quantity="acceleration",
        seed=1,
    )
    found = design(replace(problem, **changes))  # type: ignore[arg-type]
    names, C = found.forecast.parameters, found.forecast.covariance
    i, j = names.index("k_3"), names.index("k_rod")
    sines = [abs(float(np.cos(at.angles[1] - at.angles[0]))) for at in found.plan.configurations]
    return sines, float(C[i, j] / np.sqrt(C[i, i] * C[j, j]))


@pytest.mark.slow
def test_designed_postures_spread_the_angle_between_lever_and_rod():
    """Among random candidates: nearly aligned and nearly square, and gear and rod come apart, as in no one posture."""
    sines, correlation = forecast(design=DesignSpec(count=6, candidates=CandidateSpec(random=60)))
    assert max(sines) - min(sines) > 0.4
    assert abs(correlation) < 0.75
    one = ExperimentSpec(
        configurations={"one": (0.0, 0.0)},
        realisations=6,
        simulated=SimulatedSpec(noise=NoiseSpec(torque_std=10, angle_std=1e-5), substeps=6),
    )
    assert forecast(experiment=one)[1] < -0.97


STUDY = """\
name: linkage
robot: {robot}
excitation: {{rate_hz: 1000, period: 2, band_hz: [2, 70], torque_rms: 300}}
experiment:
  configurations: {{a: [0, 0], b: [0.5, -0.1], c: [-0.4, 0.4], d: [0.2, 0.9], e: [-0.3, -0.8]}}
  simulated: {{}}
model: {{formulation: {formulation}}}
fit: {{starts: 1, parameters: {{"k_*": {{}}, "d_*": {{}}}}}}
compare: {{folds: 5}}
"""


def compared(folder: Path, formulation: str) -> dict[str, Any]:
    """compare.json of the variants that a linkage has by default, on responses of the exact model with 1 % noise."""
    (folder / "study.yml").write_text(
        STUDY.format(robot=CONFIGS / "robots" / "linkage_arm.yml", formulation=formulation)
    )
    going = Run(load(folder / "study.yml"), folder / "run", 1, Console(-1))
    robot, random, responses = going.study.robot, np.random.default_rng(3), []
    model = formulate(robot)
    linearisation, lines = Linearisation.of(model), np.linspace(3, 70, 40)
    for name, angles in going.study.experiment.configurations.items():
        at = Configuration(name, np.array(angles))
        linear = linearisation.at(at, model.theta, model.inputs, "acceleration")
        exact = to_response(linear, linear.theta_ref, lines)
        level = 0.01 * np.abs(exact.G)
        noise = random.standard_normal((2, *level.shape)) / np.sqrt(2)
        total = Covariance(level**2, np.inf)
        responses.append(replace(exact, G=exact.G + level * (noise[0] + 1j * noise[1]), total=total))
    write_responses(going.path("estimate"), responses, going.stamps["estimate"])
    compare(going)
    content: dict[str, Any] = json.loads((going.folder / "compare.json").read_text())
    return content


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_comparing_a_linkage_ranks_the_approximations_behind_the_exact_model(tmp_path: Path):
    """Both exact forms predict alike and best, then what lets the loop bend or the rod keep its mass, then the rest."""
    found = compared(tmp_path, "constrained")
    models = {row["name"]: row for row in found["models"]}
    error = {name: float(np.sqrt(np.mean(row["misfit"]))) for name, row in models.items()}
    stiff = ("rigid loop", "constant stiffness", "series stiffness", "b2 rigid")
    assert set(models) == {"linkage", "exact, minimal", "bending outside", "lumped rod", *stiff}
    assert error["exact, minimal"] == pytest.approx(error["linkage"], rel=1e-3)
    assert error["linkage"] < 1.0
    assert error["bending outside"] > 1.1 * error["linkage"]
    assert all(error[name] > 1.5 * error["linkage"] for name in ("lumped rod", *stiff))
    # A constant spring of the third axis is right in one posture only; with the rod in series it follows the posture.
    assert error["constant stiffness"] > 1.2 * error["series stiffness"] > 5 * error["bending outside"]
    assert error["rigid loop"] == pytest.approx(error["constant stiffness"], rel=0.02)
    assert models["rigid loop"]["n_free"] == models["constant stiffness"]["n_free"] == 4
    assert models["series stiffness"]["n_free"] == 6
    assert models["exact, minimal"]["n_free"] == 8
    assert "cannot be distinguished from it with these data; the others are worse" in found["verdict"]


UP_TO_FIT = ("design", "measure", "estimate", "fit")


def run(study: str, folder: Path, commands: Sequence[str], *options: str) -> tuple[int, dict[str, Any]]:
    """Commands of `elastid`, the last exit code and the summary."""
    for stage in commands:
        code = cli.run_command([stage, str(CONFIGS / study), "--run", str(folder), "-q", *options])
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return code, summary


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("study", "seed", "commands"),
    [
        pytest.param("linkage_arm.yml", 2, ["run"], marks=pytest.mark.slow),
        pytest.param("irb4400_linkage.yml", 1, UP_TO_FIT, marks=pytest.mark.slow),
    ],
)
def test_shipped_linkages_are_identified_from_the_simulated_rig(
    study: str, seed: int, commands: Sequence[str], tmp_path: Path
):
    """Gears, rod and bending within 3 standard deviations and 5 % of the truth, with friction, noise and gravity."""
    code, summary = run(study, tmp_path / "run", commands, "--set", f"seed={seed}")
    assert code == 0
    found = {name: p for name, p in summary["parameters"].items() if name.startswith("k_")}
    assert {"k_2", "k_3", "k_rod", "k_b2"} <= set(found)
    for name, p in found.items():
        assert abs(p["value"] / p["truth"] - 1) < 0.05, name
        assert abs(p["value"] - p["truth"]) < 3 * p["std"], name
