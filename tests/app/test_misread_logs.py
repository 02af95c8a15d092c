"""Faulty measurements through the commands: misread logs on which the best fit tips over, and a file's gravity."""

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
from plants.injected_faults import FAULTS
from plants.injected_measurement import Measurement, true_measurement

from elastid.app.cli import run_command


def fitted(fault: Callable[[Measurement], object], folder: Path) -> list[int]:
    """Exit codes of measure, estimate and fit of a measurement with a fault."""
    measurement, _ = true_measurement(1)
    fault(measurement)
    for log in measurement.logs:
        with h5py.File(folder / log.path, "w") as file:
            for name, values in log.signals.items():
                file[name] = values
    (folder / "robot.yml").write_text(json.dumps(measurement.robot))
    (folder / "study.yml").write_text(json.dumps(measurement.study))
    study = [str(folder / "study.yml"), "--run", str(folder / "run"), "--jobs", "1", "-q"]
    return [run_command([stage, *study]) for stage in ("measure", "estimate", "fit")]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("angle 2 negated", "y at motor 2 with the other sign would explain"),
        pytest.param("postures a and c exchanged", "configurations a and c exchanged", marks=pytest.mark.slow),
        pytest.param("torque channels exchanged", "u at motor 1 and at motor 2 exchanged", marks=pytest.mark.slow),
    ],
)
def test_a_misreading_is_named_and_no_spring_is_to_be_stiffened(
    fault: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the numbers of the file as they are, since the tolerances bend towards the fault."""
    assert fitted(FAULTS[fault], tmp_path) == [0, 0, 1]
    words = capsys.readouterr().err
    assert said in words
    assert "raise their stiffness" not in words


@pytest.mark.slow
def test_a_file_without_gravity_says_what_that_of_the_earth_would_move(tmp_path: Path) -> None:
    """Stiffnesses take up m g l: three standard deviations, which no residual shows; nothing of a file that has it."""
    for fault, moved in ((FAULTS["gravity left out"], "3"), (lambda _: None, "")):
        folder = tmp_path / f"moved {moved}"
        folder.mkdir()
        assert fitted(fault, folder) == [0, 0, 0]
        notes = json.loads((folder / "run" / "summary.json").read_text())["notes"]
        said = [str(note) for note in notes if "has no gravity" in str(note)]
        assert len(said) == len(moved)
        assert all(f"would move by {moved} standard deviations" in words for words in said)
