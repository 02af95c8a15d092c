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
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Robot

CONFIGS = Path(__file__).parents[2] / "configs"
SPREAD = ((0.0, 0.0), (0.5, -0.1), (-0.4, 0.4), (0.2, 0.9), (0.6, -0.2), (-0.3, -0.8))
FREE = ("k_2", "k_3", "k_rod", "d_3", "d_rod")


def planar() -> Robot:
    data = YAML(typ="safe").load((CONFIGS / "robots" / "linkage_arm.yml").read_text(encoding="utf-8"))
    return TypeAdapter(Robot).validate_python(data)


@cache
def exact_responses(angles: tuple[tuple[float, float], ...], highest: float) -> list[Response]:
    """As many lines in all, whatever the number of configurations."""
    model = formulate(planar())
    linearisation, lines, responses = Linearisation.of(model), np.linspace(3, highest, 300 // len(angles)), []
    for i, at in enumerate(angles):
        linear = linearisation.at(Configuration(f"c{i}", np.array(at)), model.theta, model.inputs, "acceleration")
        responses.append(to_response(linear, linear.theta_ref, lines))
    return responses


def fitted(angles, seed: int = 0, spec: ModelSpec = EXACT, highest: float = 30.0, free: Sequence[str] = FREE) -> Result:
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


def relative(result: Result, name: str) -> float:
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


UP_TO_FIT = ("design", "measure", "estimate", "fit")


def run(study: str, folder: Path, commands: Sequence[str], *options: str) -> tuple[int, dict[str, Any]]:
    """Commands of `elastid`, the last exit code and the summary."""
    code = cli.run_command(["run", str(CONFIGS / study), *commands, "--run", str(folder), "-q", *options])
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return code, summary


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("study", "seed", "commands"),
    [
        pytest.param("linkage_arm.yml", 2, [], marks=pytest.mark.slow),
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
