"""The open benchmark: records and truths by a seed alone, and a score that follows from both."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plants.measured import EMPS, measured
from plants.paths import ROOT
from scipy.io import loadmat

from elastid.app.cli import run_command

OPEN = ROOT / "scripts" / "benchmarks" / "open"


def run(script: str, folder: Path, *words: str) -> str:
    command = [sys.executable, str(OPEN / script), str(folder), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=500).stdout


@pytest.mark.slow
@pytest.mark.oracle("mujoco")
def test_records_entry_and_score(tmp_path: Path) -> None:
    """Two stiff gears: SciPy is within 1 % of k; guesses of the data sheet are 20 % off and move the tool otherwise."""
    run("make.py", tmp_path, "--robots", "stiff_gears")
    run("by_scipy.py", tmp_path)
    rows = {row["entry"]: row for row in json.loads(run("score.py", tmp_path).splitlines()[-1])["open"]}
    assert rows["scipy"]["k_percent"] < 1 < 20 < rows["start"]["k_percent"]
    assert rows["scipy"]["tool_percent"] < 5 < 20 < rows["start"]["tool_percent"]
    assert (rows["scipy"]["of"], rows["start"]["inside"]) == (4, 0)
    truth = json.loads((tmp_path / "truth" / "seed-0" / "stiff_gears.json").read_text())
    public = "".join(path.read_text() for path in (tmp_path / "seed-0" / "stiff_gears").glob("*.[jx]*"))
    assert not any(str(value) in public for value in truth["scored"].values())


@pytest.mark.slow
@pytest.mark.oracle("mujoco")
def test_same_seed_same_bytes_and_a_secret_word_changes_them(tmp_path: Path) -> None:
    files = []
    for name, words in (("first", ()), ("second", ()), ("secret", ("--secret", "word"))):
        run("make.py", tmp_path / name, "--robots", "commands_alone", *words)
        files.append((tmp_path / name / "seed-0" / "commands_alone" / "logs" / "p1-0-0.csv").read_bytes())
    assert files[0] == files[1] != files[2]


@pytest.mark.slow
@pytest.mark.oracle("mujoco")
def test_torques_that_are_late_by_a_part_of_a_cycle(tmp_path: Path) -> None:
    """Three axes, references without feedforward: `check` accepts the logs, k within 2 %, five intervals of six."""
    run("make.py", tmp_path, "--robots", "late_torque", "--seed", "2")
    run("by_elastid.py", tmp_path, "--seed", "2")
    assert run_command(["check", str(tmp_path / "seed-2" / "late_torque" / "study.yml")]) == 0
    rows = json.loads(run("score.py", tmp_path).splitlines()[-1])["open"]
    row = next(row for row in rows if row["entry"] == "elastid")
    assert (row["status"], row["of"]) == ("converged", 6)
    assert row["inside"] >= 5
    assert row["k_percent"] < 2


@pytest.mark.slow
def test_emps_in_free_run() -> None:
    """Published mass to 1 %; over 25 s without feedback the position stays within 6 mm rms of a stroke of 250 mm."""
    script, log = runpy.run_path(str(OPEN / "../identibench/emps.py")), loadmat(measured(EMPS))
    u, y = log["vir"].ravel(), log["qm"].ravel()
    numbers = script["friction_study"](u, y)
    assert numbers[0] == pytest.approx(95.11, rel=0.01)
    assert np.sqrt(np.mean((script["simulate"](numbers, u, y[:20]) - y) ** 2)) < 6e-3
