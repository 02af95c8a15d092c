"""file -> value -> file: what is kept, what is done again, what is left when work is stopped."""

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest
from plants.refusals import refused
from plants.runs import run_of, summary_of

from elastid.app import run as running
from elastid.app.console import Console
from elastid.app.export import export
from elastid.app.overview import overview
from elastid.app.run import Artefacts, Run, run_all
from elastid.app.stage_table import SIMULATED, stages_of
from elastid.app.stages import fit as fitting
from elastid.app.stages import measure as measuring
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.record import Record
from elastid.response import Response
from elastid.store.artefacts import read_stamp
from elastid.store.plan import read_plan
from elastid.store.results import read_fit
from elastid.study import load, load_robot

ALL = ["design", "measure", "estimate", "fit", "validate", "report"]


def run_in(folder: Path, *overrides: str, jobs: int = 1) -> Run:
    return run_of(folder / "study.yml", folder / "run", *overrides, jobs=jobs)


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "copy"))


@pytest.fixture
def worked_on(monkeypatch) -> list[str]:
    """Stages write down their names instead of working."""
    done = []
    names = {stage.function: name for name, stage in stages_of(SIMULATED).items()}

    def written_down(text: str) -> Callable[..., object]:
        def stage(*_: object) -> Artefacts:
            done.append(names[text])
            return Artefacts({})

        return stage if text in names else resolve_name(text)

    monkeypatch.setattr(running, "resolve_name", written_down)
    return done


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ([], []),
        (["report.formats=[png]"], ["report"]),
        (["compare.folds=2"], ["report"]),
        (["validation.configurations=[b]"], ALL),  # the plan's forecast
        (["fit.starts=3"], ["fit", "validate", "report"]),
        (["estimator.outlier_sigma=7"], ["estimate", "fit", "validate", "report"]),
        (["experiment.simulated.noise.angle_std=1e-5"], ALL),
        (["seed=2"], ALL),
        (["robot.bodies.0.mass=1"], ALL),
    ],
)
def test_only_stages_that_depend_on_a_change_run_again(
    copy: Path, worked_on: list[str], overrides: list[str], expected: list[str]
) -> None:
    """A key of the study reaches the stages that read it, and those after them."""
    run_all(run_in(copy, *overrides))
    assert worked_on == expected


def test_check_foretells_the_plan(finished: Path) -> None:
    """Numbers of its experiments, periods and lines."""
    text, plan = overview(load(finished / "study.yml").study), read_plan(finished / "run" / "plan.h5")
    numbers = re.search(r"(\d+) experiments: .*\s+(\d+) periods of .* \((\d+) of transient\); (\d+) ", text)
    expected = len(plan.experiments), plan.periods + plan.transient_periods, plan.transient_periods, len(plan.lines)
    assert (*map(int, numbers.groups()),) == expected


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores of a process are those of Linux")
def test_processes_match_cores_and_start_only_for_work(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = []
    monkeypatch.setattr(running, "load_for_workers", started.append)
    run_all(run_in(finished, jobs=2))
    assert not started
    cores = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(cores)})
        assert running.all_cores() == 1
    finally:
        os.sched_setaffinity(0, cores)


def test_a_fit_leaves_the_robot_with_its_numbers(finished: Path) -> None:
    """identified_robot.yml is read as a robot with every fitted number; export writes the same file."""
    run = run_in(finished)
    values = read_fit(run.path("fit")).values
    numbers = {
        name: value for name, (value, _) in load_robot(finished / "run" / "identified_robot.yml").parameters().items()
    }
    assert {name: numbers[name] for name in ("k_1", "d_1", "fm_1")} == pytest.approx(
        {name: values[name] for name in ("k_1", "d_1", "fm_1")}, rel=1e-9
    )
    (path,) = export(run, "robot")
    assert path.read_text() == (finished / "run" / "identified_robot.yml").read_text()


def test_result_changed_on_disk_is_made_again(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One bit of a response: `run` says so and ends with the bytes that were there; the fit alone refuses it."""
    path = copy / "run" / "frf.h5"
    before = path.read_bytes()
    spoilt = bytearray(before)
    spoilt[len(before) // 2] ^= 4
    path.write_bytes(spoilt)
    run = run_in(copy)
    with refused("run/earlier-stage"):
        run_all(run, ["fit"])
    run_all(Run(run.loaded, run.folder, 1, Console(0)))
    assert "frf.h5" in capsys.readouterr().err
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "stage"), [("summary.json", "fit"), ("report.html", "report"), ("references/*.csv", "design")]
)
def test_text_changed_on_disk_is_made_again(
    copy: Path, worked_on: list[str], capsys: pytest.CaptureFixture[str], name: str, stage: str
) -> None:
    """One digit that another program would read, or a robot would follow: `run` says so and makes it again."""
    path = min((copy / "run").glob(name))
    spoilt = bytearray(path.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    path.write_bytes(spoilt)
    run_all(run_in(copy))
    assert worked_on == [stage]
    assert path.name in capsys.readouterr().err


def test_every_result_says_where_it_came_from(finished: Path) -> None:
    """Study with robot, seed, version and hashes, in every file."""
    for name in ("plan.h5", "records.h5", "frf.h5", "fit.h5", "validation.h5"):
        stamp = read_stamp(finished / "run" / name)
        assert "name: tiny" in stamp.study
        assert "one elastic joint" in stamp.study
        assert stamp.seed == 1
        assert len(stamp.inputs) == len(stamp.code) == 64
        assert all(f"{name} " in stamp.software for name in ("elastid", "Python", "numpy", "scipy", "casadi"))
    log = (finished / "run" / "run.log").read_text()
    assert stamp.software in log
    assert " UTC: elastid" in log


def test_a_stage_alone_asks_for_what_it_reads(finished: Path, copy: Path, tmp_path: Path) -> None:
    """And names the command; nothing is written."""
    study = finished / "study.yml"
    with refused("run/earlier-stage"):
        run_all(run_of(study, tmp_path / "new"), ["fit"])
    assert not (tmp_path / "new").exists()
    with refused("run/earlier-stage"):
        run_all(run_of(study, finished / "run", "seed=5"), ["fit"])
    (copy / "run" / "frf.h5").write_text("no")
    with refused("run/earlier-stage"):
        run_all(run_in(copy), ["fit"])


class Interrupting(SimulatedRig):
    """A rig whose user loses patience."""

    def measure(self, experiment: Experiment) -> Record:
        if experiment.name == "b-r0-e0":
            raise KeyboardInterrupt
        return super().measure(experiment)


def test_a_stopped_measurement_goes_on_where_it_was(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Finished experiments are kept and not simulated again; the end is the same to the bit."""
    run = run_of(finished / "study.yml", tmp_path / "run")
    run_all(run, ["design"])
    with monkeypatch.context() as patch:
        patch.setattr(measuring, "SimulatedRig", Interrupting)
        with pytest.raises(KeyboardInterrupt):
            run_all(run, ["measure"])
    assert sorted(p.name for p in (run.partial("measure")).iterdir()) == ["a-r0-e0.npz", "a-r1-e0.npz"]
    assert not run.path("measure").exists()
    measured = []
    inner = SimulatedRig.measure
    monkeypatch.setattr(SimulatedRig, "measure", lambda rig, e: (measured.append(e.name), inner(rig, e))[1])
    run_all(run, ["measure"])
    assert measured == ["b-r0-e0", "b-r1-e0"]
    assert run.path("measure").read_bytes() == (finished / "run" / "records.h5").read_bytes()
    assert not (run.partial("measure")).exists()


def test_the_summary_has_the_truth_beside_each_estimate(finished: Path) -> None:
    """Schema 1; the mode is that of both inertias on the spring."""
    summary = summary_of(finished / "run")
    assert summary["schema"] == 1
    assert summary["status"] == "converged"
    k_1 = summary["parameters"]["k_1"]
    assert k_1["truth"] == 60.0
    assert k_1["value"] == pytest.approx(60.0, rel=0.01)
    # f = sqrt(k (1/J + 1/I)) / 2 pi
    assert summary["modes"][0]["frequency_hz"][0] == pytest.approx(np.sqrt(60 * 2e3) / (2 * np.pi), rel=0.01)


def test_left_out_configurations_are_not_fitted_and_are_judged(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit sees the others alone; validation and summary speak of all."""
    seen = []
    inner = fitting.identify_with_motion_bias

    def spy(responses: list[Response], *arguments: Any, **options: Any) -> Any:
        seen.extend(response.configuration.name for response in responses)
        return inner(responses, *arguments, **options)

    monkeypatch.setattr(fitting, "identify_with_motion_bias", spy)
    run_all(run_in(copy, "validation.configurations=[b]"))
    assert seen == ["a"]
    summary = summary_of(copy / "run")
    assert [error["configuration"] for error in summary["frf_error"]] == ["a", "b"]


def test_a_fit_that_finds_nothing_says_so_in_the_summary(copy: Path) -> None:
    """A mass without gravity moves nothing: FitError names it, and nothing of before is passed off as of this one."""
    run = run_in(copy, "fit.parameters.m_load.start=1")
    (copy / "run" / "figures" / "mine.png").touch()
    with refused("fit/not-identifiable"):
        run_all(run)
    summary = summary_of(copy / "run")
    assert summary["status"] == "failed"
    assert "m_load" in summary["message"]
    assert not run.is_current("fit")
    left = {path.name for path in (copy / "run").rglob("*")}
    assert not left & {"validation.json", "report.html", "identified_robot.yml", "fit.h5"}
    assert left >= {"mine.png", "frf.h5", "plan.h5"}


@pytest.fixture
def never_converging(monkeypatch: pytest.MonkeyPatch) -> None:
    inner = fitting.identify_with_motion_bias

    def give_up(*arguments: Any, **options: Any) -> Any:
        result, effects = inner(*arguments, **options)
        return replace(result, status="not_converged"), effects

    monkeypatch.setattr(fitting, "identify_with_motion_bias", give_up)


@pytest.mark.slow
@pytest.mark.usefixtures("never_converging")
def test_a_fit_that_did_not_converge_is_still_shown(copy: Path) -> None:
    """The report shows where it stands, the command fails, and fails again when nothing is left to do."""
    run = run_in(copy, "fit.starts=1")
    for _ in range(2):
        with refused("fit/not-trusted"):
            run_all(run)
        assert run.is_current("report")
        assert read_fit(run.path("fit")).status == "not_converged"
    assert summary_of(copy / "run")["status"] == "not_converged"
