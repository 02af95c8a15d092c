"""Moves of a study from the command line, and friction compensation."""

import csv
from pathlib import Path

import numpy as np
import pytest
from plants.arm_study import command
from plants.marks import needs_compiler

from elastid.store.results import read_tune
from elastid.use.tune import IDENTIFIED, RIGID


@pytest.mark.slow
def test_a_fitted_study_commands_a_move(fitted_arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All files are there and agree; the same bytes again."""
    study = fitted_arm
    run, path = study.parent / "run", study.parent / "move.csv"
    words = ("--path", path, "--time", "0.9", "--samples", "3")
    assert command("tune", study, *words) == 0
    files = {"move.c", "move.h", "trajectory.yaml", "move.mat", "load_move.m"}
    files |= {"robot_with_move_fmi2.fmu", "robot_with_move_fmi3.fmu"}
    assert {each.name for each in (run / "tune").iterdir()} == files
    assert (run / "tune.html").stat().st_size > 10_000
    tuned = read_tune(run / "tune.h5")
    assert tuned[IDENTIFIED].largest < tuned[RIGID].largest / 10
    with (run / "tune.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_allclose([float(row["torque 2"]) for row in rows], tuned.torque[:, 1])
    first = (run / "tune.csv").read_bytes()
    assert command("tune", study, *words, "--jobs", "1") == 0
    assert (run / "tune.csv").read_bytes() == first
    assert command("tune", study, *words, "--fastest") == 2
    assert command("tune", study, "--path", path) == 1
    assert "--fastest" in capsys.readouterr().err


@pytest.mark.slow
@needs_compiler
@pytest.mark.oracle("fmpy")
@pytest.mark.parametrize("version", [2, 3])
def test_fmu_with_move_follows_tool_path(fitted_arm: Path, version: int) -> None:
    """In another program, with nothing set: as exactly as planned, and not at all with the path of another time."""
    study = fitted_arm
    import fmpy
    import fmpy.validation

    run = study.parent / "run"
    assert command("tune", study, "--path", study.parent / "move.csv", "--time", "0.9", "--samples", "0") == 0
    assert "draws" not in (study.parent / "run" / "tune.html").read_text("utf-8")
    unit, tuned = str(run / "tune" / f"robot_with_move_fmi{version}.fmu"), read_tune(run / "tune.h5")
    assert fmpy.validation.validate_fmu(unit) == []
    t = tuned.time_s - tuned.time_s[0]
    places = [f"position {axis} of frame tool" for axis in "xyz"]
    out = fmpy.simulate_fmu(unit, stop_time=t[-1], step_size=t[1], output_interval=t[1], output=places)
    tool = np.stack([np.interp(t, out["time"], out[place]) for place in places], axis=1)
    error = np.linalg.norm(tool - tuned.target, axis=1)
    travel = np.linalg.norm(tuned.target - tuned.target[0], axis=1).max()
    assert error.max() < tuned.predicted_error.max() + 2e-4
    assert error.max() < 2e-3 * travel
    assert np.linalg.norm(np.roll(tool, 10, axis=0)[10:] - tuned.target[10:], axis=1).max() > 20 * error.max()


@pytest.mark.slow
def test_a_fitted_study_compensates_friction(fitted_arm: Path) -> None:
    """The friction of the motors over velocity is there in C."""
    assert command("export", fitted_arm, "--to", "compensation") == 0
    assert (fitted_arm.parent / "run" / "export" / "compensation" / "friction.c").is_file()
