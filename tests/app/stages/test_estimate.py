"""Friction is found before the responses are estimated, from records that are read one configuration at a time."""

import json
from pathlib import Path

import numpy as np
import pytest

from elastid.app.console import Console
from elastid.app.identified_robot import SLOPE
from elastid.app.inspection import described
from elastid.app.run import Run, run_all
from elastid.app.stages.estimate import (
    NET_RECORDS,
    net_records_of,
)
from elastid.base.display import digits, number
from elastid.robot.friction_numbers import friction_numbers
from elastid.store.measured import read_friction, read_records
from elastid.store.results import read_validation
from elastid.study import load, load_robot


def run_of(tiny: Path, friction: str) -> Run:
    """All stages of the tiny study with dry friction at its motor."""
    coulomb = ["robot.bodies[0].joints[0].motor.coulomb=0.01", "experiment.simulated.substeps=20", "fit.starts=1"]
    options = [*coulomb, "fit.parameters={k_1: {}, fm_1: {}}", f"estimator.friction={friction}", "report.formats=[png]"]
    run = Run(load(tiny, options), tiny.parent / f"run-{friction}", 1, Console(0))
    run_all(run)
    return run


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
    assert said.count("estimate: motor 1: friction of ") == 1
    assert f"fm_1: {SLOPE}" in said
    assert f"motor 1  {level:.4g}" in described(run.path("estimate"))
    explained = [replay.fit_percent.mean(axis=0).min() for replay in read_validation(run.path("validate")).replays]
    assert min(explained) > 99
    validated_from_kept_records(run)


def validated_from_kept_records(run: Run) -> None:
    """Records without friction are those that would be worked out again: where the file is damaged, foreign or gone."""
    kept, judged = run.folder / NET_RECORDS, run.folder / "validation.json"
    before, content = judged.read_bytes(), kept.read_bytes()
    assert net_records_of(run.path("estimate")) == kept
    damaged = content[:-100] + bytes([content[-100] ^ 1]) + content[-99:]
    for other in (damaged, run.path("measure").read_bytes(), b"", None):
        kept.unlink()
        if other is not None:
            kept.write_bytes(other)
        assert net_records_of(run.path("estimate")) is None
        run_all(run, ["validate"])
        assert judged.read_bytes() == before
        kept.write_bytes(content)
    for record, net in zip(read_records(run.path("measure")), read_records(kept), strict=True):
        assert np.std(record.u - net.u) == pytest.approx(0.01, rel=0.1)  # Coulomb friction alone
