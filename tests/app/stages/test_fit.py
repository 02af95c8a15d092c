"""How a fit ends: everything is written, the last line says what its status means, the exit code what to make of it."""

import shlex
from pathlib import Path

import pytest
from plants.runs import summary_of
from plants.two_axes import measured

from elastid.app import cli
from elastid.report.next_steps import next_steps
from elastid.report.parameter_row import parameter_rows
from elastid.store.results import read_fit
from elastid.study import load_robot


@pytest.mark.parametrize(
    ("factor", "status", "code"), [(1.0, "converged", 0), pytest.param(1.3, "misfit", 3, marks=pytest.mark.slow)]
)
def test_a_fit_ends_with_the_meaning_of_its_status(
    study: Path, capfd: pytest.CaptureFixture[str], factor: float, status: str, code: int
) -> None:
    """In its last line; a misfit is written whole, validated and reported like any fit, and its exit code is 3."""
    overrides = ("fit.starts=1", "fit.profile=[]", "fit.weights.model_error=0")
    robot = load_robot(study.parent / "robot.yml")
    heavier = robot.with_parameters({"m_fore": factor * robot.parameters()["m_fore"][0]})
    run = measured(study, heavier, *overrides, noise=0.005)
    options = [part for override in overrides for part in ("--set", override)]

    def ended(command: str) -> int:
        return cli.run_command(["run", str(study), command, "--run", str(run.folder), "--jobs", "1", *options])

    assert ended("fit") == code
    streams = capfd.readouterr()
    last = " ".join((streams.err if code else streams.out).split("summary.json")[-1].split())
    result = read_fit(run.path("fit"))
    assert result.meaning.clause[1:] in last
    assert result.status == status
    step = next_steps(result, parameter_rows(result, None))[0]
    assert step.sentence in " ".join(streams.out.split())
    said = " ".join(f"--set {shlex.quote(override)}" for override in overrides)
    assert (f"{said} {step.text}" in streams.out) == step.text.startswith("--set")
    summary = summary_of(run.folder)
    assert summary["status"] == status
    assert len(summary["parameters"]) > 3
    assert ended("validate") == 0
