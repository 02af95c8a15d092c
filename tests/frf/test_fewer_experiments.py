"""Fewer experiments in a realisation than motors: the local methods distinguish inputs by neighbouring lines."""

from pathlib import Path

import numpy as np
import pytest
from plants.planar_arm import TWO_FILE

from elastid.app.console import Console
from elastid.app.overview import overview
from elastid.app.run import Run, run_all
from elastid.store.measured import read_forecast, read_plan, read_responses
from elastid.store.results import read_fit
from elastid.study import load

STUDY = """\
name: one of two
robot: robot.yml
excitation:
  rate_hz: 500
  period: 4 s
  band_hz: [2, 60]
  torque_rms: [10, 5]
experiment:
  configurations:
    bent: [0, 60 deg]
  realisations: 1
  experiments: 1
  simulated:
    truth: {k_1: 2400 N*m/rad, k_2: 700 N*m/rad}
    noise: {torque_std: 0.1, angle_std: 1e-6}
estimator: {method: local_rational}
fit:
  starts: 2
  weights: {floor: 1e-6}
  parameters:
    k_*: {}
    d_*: {}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """The path of the study."""
    (tmp_path / "robot.yml").write_text(TWO_FILE)
    (tmp_path / "study.yml").write_text(STUDY)
    return tmp_path / "study.yml"


@pytest.mark.slow
def test_one_experiment_of_two_motors_finds_both_springs(study: Path, tmp_path: Path) -> None:
    """From study to report: both true stiffnesses to 1 %, in one run of the robot."""
    run = Run(load(study), tmp_path / "run", 1, Console(-1))
    run_all(run)
    plan, forecast, result = read_plan(run.path("design")), read_forecast(run.path("design")), read_fit(run.path("fit"))
    assert [experiment.name for experiment in plan.experiments] == ["bent-r0-e0"]
    assert plan.robot_time_s == 3 * 4 + 2 * 0.5
    assert read_responses(run.path("estimate"))[0].G.shape[1:] == (2, 2)
    assert result.values["k_1"] == pytest.approx(2400, rel=0.01)
    assert result.values["k_2"] == pytest.approx(700, rel=0.01)
    whole = Run(load(study, ["experiment.experiments=2"]), tmp_path / "whole", 1, Console(-1))
    run_all(whole, ["design"])
    two = read_forecast(whole.path("design"))
    np.testing.assert_allclose(forecast.relative, np.sqrt(2) * two.relative, rtol=0.02)


def test_a_design_fits_more_configurations_into_the_time_where_each_has_fewer_experiments(
    study: Path, tmp_path: Path
) -> None:
    """A run takes 13 s: 39 s hold two more configurations than the one given, and `check` counts experiments."""
    assert "1 experiment: 1 configuration (bent) x 1 realisation x 1 experiment" in overview(load(study).study)
    run = Run(load(study, ["design={robot_time: 39, candidates: {random: 20}}"]), tmp_path / "run", 1, Console(-1))
    run_all(run, ["design"])
    plan = read_plan(run.path("design"))
    assert len(plan.experiments) == 3
    assert plan.robot_time_s == 39


@pytest.mark.parametrize("overrides", [["estimator.method=auto"], ["estimator.method=h1", "experiment.realisations=2"]])
def test_enough_experiments_for_the_method_are_not_refused(study: Path, overrides: list[str]) -> None:
    """auto takes a local method; one that pools has two experiments from two realisations."""
    assert load(study, overrides).study.experiment.runs(2) == 1
