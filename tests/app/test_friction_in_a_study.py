"""Friction is found before the responses are estimated, from records that are read one configuration at a time."""

from pathlib import Path

import pytest
from plants.artefacts import same
from plants.dry_friction import measured

from elastid.app.console import Console
from elastid.app.run import Run, run_stage
from elastid.app.stages.estimate import estimate_configuration, find_friction_of_run
from elastid.frf.friction.find import find_friction
from elastid.frf.spec import EstimatorSpec
from elastid.store import read_friction, read_responses, write_records
from elastid.study import load


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
    assert find_friction_of_run(path, EstimatorSpec(), lines) is None


@pytest.mark.parametrize("friction", ["none", "coulomb"])
def test_the_file_of_responses_keeps_what_was_taken_out(tiny: Path, friction: str) -> None:
    """frf.h5 holds both; the study without friction has responses alone."""
    coulomb = ["robot.bodies[0].joints[0].motor.coulomb=0.01", "experiment.simulated.substeps=20"]
    run = Run(load(tiny, [*coulomb, f"estimator.friction={friction}"]), tiny.parent / "run", 1, Console(-1))
    for stage in ("design", "measure", "estimate"):
        run_stage(run, stage)
    assert len(read_responses(run.path("estimate"))) == 2
    found = read_friction(run.path("estimate"))
    assert (found is None) == (friction == "none")
    if found is not None:
        level, std = found.sliding_level("motor 1")
        assert abs(level - 0.01) < 0.002, (level, std)
