"""Every script runs: examples give their number, benches and studies end with one line of JSON."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
FOLDERS = (SCRIPTS / "benchmarks", SCRIPTS / "studies")
RUNNABLE = sorted(
    path for folder in FOLDERS for path in folder.glob("*.py") if path.stem not in ("study_plants", "fast_rig")
)


def test_example_1_finds_the_stiffness_of_one_joint() -> None:
    """From Python alone, without a study file: within its interval, and the interval is narrow."""
    said = runpy.run_path(str(SCRIPTS / "examples" / "ex01_identify_from_python.py"))
    assert said["low"] < said["true_stiffness"] < said["high"]
    assert said["high"] - said["low"] < 0.05 * said["true_stiffness"]


def test_every_example_is_asserted_here() -> None:
    """A new example comes with its test."""
    assert {path.name for path in SCRIPTS.glob("examples/*.py")} == {"ex01_identify_from_python.py"}


@pytest.mark.slow
@pytest.mark.parametrize("script", RUNNABLE, ids=lambda path: f"{path.parent.name} {path.stem}")
def test_every_bench_and_study_ends_with_json(script: Path, tmp_path: Path) -> None:
    """--quick is a small problem; the full size is for scripts' users."""
    done = subprocess.run(
        [sys.executable, str(script), "--quick"], cwd=tmp_path, capture_output=True, text=True, timeout=580, check=False
    )
    assert done.returncode == 0, done.stderr
    assert isinstance(json.loads(done.stdout.splitlines()[-1]), dict)
