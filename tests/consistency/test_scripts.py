"""Every script runs: examples give their number, benches and studies end with one line of JSON."""

import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
EXAMPLES = SCRIPTS / "examples"
FOLDERS = (SCRIPTS / "benchmarks", SCRIPTS / "studies")
RUNNABLE = sorted(
    path
    for folder in FOLDERS
    for path in folder.glob("*.py")
    if path.stem not in ("study_plants", "fast_rig", "timing")
)


def example(name: str) -> dict[str, Any]:
    """The variables of an example, without its figures."""
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def test_example_1_finds_the_stiffness_of_one_joint() -> None:
    """From Python alone, without a study file: within its interval, and the interval is narrow."""
    said = example("ex01_identify_from_python")
    assert said["low"] < said["true_stiffness"] < said["high"]
    assert said["high"] - said["low"] < 0.05 * said["true_stiffness"]


def test_example_2_has_one_response_of_two_formulations() -> None:
    """To rounding."""
    assert example("ex02_linkage_two_formulations")["difference"] < 1e-9


@pytest.mark.slow
def test_examples_3_and_4_fit_what_python_control_has_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """The numbers of the transfer function; a gain of 100/s behind two lags T = 2 ms has a margin of 2 / (100 T)."""
    monkeypatch.syspath_prepend(str(EXAMPLES))
    result = example("ex03_responses_of_python_control")["result"]
    assert result.values == pytest.approx(result.values | {"k_1": 3e3, "d_1": 4.0}, rel=1e-6)
    assert result.status == "noise_unknown"
    assert example("ex04_controller_on_the_fitted_model")["gain_margin"] == pytest.approx(10, rel=0.01)


@pytest.mark.slow
def test_example_6_finds_the_friction_of_one_axis() -> None:
    """Coulomb and viscous friction within 0.5 % of the truth, by intervals that are as narrow."""
    found = example("ex06_friction_curve")["found"]
    for name, truth in {"Fc_m1": 22.0, "f_m1": 13.0, "Fs_m1": 31.0}.items():
        low, high = found[name]
        assert low > 0.995 * truth, name
        assert high < 1.005 * truth, name


def test_every_example_is_short_and_asserted() -> None:
    """A new example comes with its test, here or, of example 5, with the run folder of the README."""
    tests = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    for path in EXAMPLES.glob("*.py"):
        assert path.stem in tests, path.name
        assert len(path.read_text().split("__main__")[0].splitlines()) <= 35, path.name


@pytest.mark.slow
@pytest.mark.parametrize("script", RUNNABLE, ids=lambda path: f"{path.parent.name} {path.stem}")
def test_every_bench_and_study_ends_with_json(script: Path, tmp_path: Path) -> None:
    """--quick is a small problem; the full size is for scripts' users."""
    done = subprocess.run(
        [sys.executable, str(script), "--quick"], cwd=tmp_path, capture_output=True, text=True, timeout=580, check=False
    )
    assert done.returncode == 0, done.stderr
    assert isinstance(json.loads(done.stdout.splitlines()[-1]), dict)
