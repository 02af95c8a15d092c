"""A robot of two axes with two further elastic joints, a study of it, and its responses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elastid.app.console import Console
from elastid.app.run import Run
from elastid.base.arrays import FloatArray
from elastid.robot import Robot
from elastid.store.measured import write_responses
from elastid.study import load
from elastid.study.robots import yaml_text
from plants.dry_friction import robot
from plants.measured_robots import responses_of

ROBOT = yaml_text(robot((0.0, 0.0)))
STUDY = """\
name: two
robot: robot.yml
seed: 2
excitation: {rate_hz: 500, period: 2 s, band_hz: [2, 50], torque_rms: 10}
experiment:
  configurations: {a: [0, 0.2], b: [0.5, 0.9], c: [-0.4, -0.7], d: [1, 1.4]}
  simulated: {}
fit: {starts: 2, start_factor: 1.5, parameters: {"k_*": {}, d_2x: {}, d_1: {fixed: true}}}
"""


FREQ = np.linspace(2, 50, 60)


@pytest.fixture
def study(tmp_path) -> Path:
    """The path of a study whose responses are not there yet."""
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    return tmp_path / "study.yml"


def measured(
    study: Path,
    truth: Robot,
    *overrides: str,
    seed: int = 0,
    folder: str = "run",
    freq_hz: FloatArray = FREQ,
    noise: float = 0.02,
) -> Run:
    """A run whose frf.h5 holds what `truth` does, with 2 % noise."""
    run = Run(load(study, overrides), study.parent / folder, 1, Console(-1))
    postures, rng = run.study.experiment.configurations, np.random.default_rng(seed)
    responses = [
        replace(response, noise=None, total=response.noise)
        for response in responses_of(truth, postures, rng, freq_hz, noise, 1e-3)
    ]
    write_responses(run.path("estimate"), responses, run.stamps["estimate"])
    return run
