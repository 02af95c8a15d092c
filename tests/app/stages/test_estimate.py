"""Friction is found before the responses are estimated, from records that are read one configuration at a time."""

import json
from pathlib import Path

import pytest
from plants.artefacts import same
from plants.dry_friction import measured

from elastid.app.console import Console
from elastid.app.identified_robot import SLOPE, WITH_COULOMB
from elastid.app.inspection import described
from elastid.app.run import Run, run_stage
from elastid.app.stages.estimate import estimate_configuration, find_friction_of_run
from elastid.app.stages.fit import conclude
from elastid.base.display import digits, number
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.find import find_friction
from elastid.robot.friction_numbers import friction_numbers
from elastid.store.measured import read_friction, read_responses, write_records
from elastid.store.results import read_validation
from elastid.study import load, load_robot


@pytest.mark.slow
def test_records_in_a_file_show_the_same_friction(tmp_path: Path) -> None:
    """As those in memory; the responses then scatter less, and a study that asks for none gets none."""
    configurations, lines = measured()
    path, spec = tmp_path / "records.h5", EstimatorSpec(friction="auto")
    write_records(path, (record for records in configurations for record in records))
    friction = find_friction_of_run(path, spec, lines)
    assert same(friction, find_friction(configurations, spec, lines))
    raw, net = (estimate_configuration(path, "a", spec, lines, each)[0].total for each in (None, friction))
    assert raw is not None
    assert net is not None
    assert net.variance.mean() < 0.1 * raw.variance.mean()
    assert find_friction_of_run(path, EstimatorSpec(friction="none"), lines) is None


def run_of(tiny: Path, friction: str) -> Run:
    """All stages of the tiny study with dry friction at its motor."""
    coulomb = ["robot.bodies[0].joints[0].motor.coulomb=0.01", "experiment.simulated.substeps=20", "fit.starts=1"]
    options = [*coulomb, "fit.parameters={k_1: {}, fm_1: {}}", f"estimator.friction={friction}", "report.formats=[png]"]
    run = Run(load(tiny, options), tiny.parent / f"run-{friction}", 1, Console(0))
    for stage in run.stages:
        run_stage(run, stage)
    conclude(run)
    return run


@pytest.mark.slow
def test_a_study_without_friction_to_take_out_has_responses_alone(tiny: Path) -> None:
    """And says that its viscous number contains some."""
    run = run_of(tiny, "none")
    assert len(read_responses(run.path("estimate"))) == 2
    assert read_friction(run.path("estimate")) is None
    summary = json.loads(run.summary("fit").read_text())
    assert summary["friction"] is None
    assert summary["parameters"]["fm_1"]["contains"] == WITH_COULOMB
    assert "truth" not in summary["parameters"]["fm_1"]
    assert 'id="friction"' not in (run.folder / "report.html").read_text("utf-8")


@pytest.mark.slow
def test_what_was_taken_out_is_in_every_result(tiny: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """frf.h5, summary, page, figures, robot.yml, terminal and `inspect` show the same; the model explains more."""
    run = run_of(tiny, "coulomb")
    friction = read_friction(run.path("estimate"))
    assert friction is not None
    level, std = friction.sliding_level("motor 1")
    assert abs(level - 0.01) < 0.002, (level, std)
    summary = json.loads(run.summary("fit").read_text())
    assert [(each["motor"], each["F_c"], each["std"]) for each in summary["friction"]] == [("motor 1", level, std)]
    viscous = summary["parameters"]["fm_1"]
    assert viscous["contains"] == SLOPE
    assert abs(viscous["value"] - viscous["truth"]) < 0.2 * viscous["truth"]
    numbers = friction_numbers(load_robot(run.folder / "identified_robot.yml"))
    assert numbers["Fc_m1"][0] == pytest.approx(level, rel=1e-9)
    assert numbers["f_m1"][0] == pytest.approx(viscous["value"], rel=1e-9)
    shown = number(level, digits(level, std))
    page = (run.folder / "report.html").read_text("utf-8")
    assert f"<td>{shown}</td>" in page[page.index('id="friction"') :]
    assert (run.folder / "figures" / "friction.png").exists()
    said = capsys.readouterr().out
    assert said.count(f"friction taken out of the torque: motor 1 {shown} ") == 1
    assert f"fm_1: {SLOPE}" in said
    assert f"motor 1: F_c = {level:.6g} N*m" in described(run.path("estimate"))
    explained = [replay.fit_percent.mean(axis=0).min() for replay in read_validation(run.path("validate")).replays]
    assert min(explained) > 99
