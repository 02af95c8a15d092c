"""Friction is found before the responses are estimated, from records that are read one configuration at a time."""

from pathlib import Path

import pytest
from plants.runs import run_of, summary_of
from plants.taken_friction import LEFT, taken_friction

from elastid.app.console import Console
from elastid.app.parameter_truth import SLOPE
from elastid.app.run import run_all
from elastid.app.stages.estimate import _artefacts
from elastid.robot.friction_numbers import friction_numbers
from elastid.store.measured import read_friction
from elastid.study import load_robot


@pytest.mark.slow
def test_what_was_taken_out_is_in_every_result(tiny: Path) -> None:
    """frf.h5, summary and robot.yml have the same; the model explains more."""
    options = ["robot.bodies[0].joints[0].motor.coulomb=0.01", "experiment.simulated.substeps=20", "fit.starts=1"]
    options += ["fit.parameters={k_1: {}, fm_1: {}}", "estimator.friction=coulomb", "report.formats=[png]"]
    run = run_of(tiny, tiny.parent / "run", *options)
    run_all(run)
    level, std = read_friction(run.path("estimate")).coulomb_friction("motor 1")
    assert abs(level - 0.01) < 0.002, (level, std)
    summary = summary_of(run.folder)
    assert [(each["motor"], each["F_c"], each["std"]) for each in summary["friction"]] == [("motor 1", level, std)]
    viscous = summary["parameters"]["fm_1"]
    assert viscous["contains"] == SLOPE
    assert abs(viscous["value"] - viscous["truth"]) < 0.2 * viscous["truth"]
    numbers = friction_numbers(load_robot(run.folder / "identified_robot.yml"))
    assert numbers["Fc_m1"][0] == pytest.approx(level, rel=1e-9)
    assert numbers["f_m1"][0] == pytest.approx(viscous["value"], rel=1e-9)


def test_estimate_prints_why_friction_was_not_compensated(capsys: pytest.CaptureFixture[str]) -> None:
    """One line per motor, also of one whose friction stays."""
    _artefacts([], [], taken_friction()).report(Console(0))
    assert LEFT in capsys.readouterr().out
