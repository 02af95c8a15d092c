"""Logs that were misread so far that the best fit of a file with tolerances tips over: the misreading is named."""

import json
from pathlib import Path

import h5py
import pytest
from plants.injected_faults import FAULTS
from plants.injected_measurement import true_measurement

from elastid.app.cli import run_command


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
    measurement, _ = true_measurement(1)
    FAULTS[fault](measurement)
    for log in measurement.logs:
        with h5py.File(tmp_path / log.path, "w") as file:
            for name, values in log.signals.items():
                file[name] = values
    (tmp_path / "robot.yml").write_text(json.dumps(measurement.robot))
    (tmp_path / "study.yml").write_text(json.dumps(measurement.study))
    study = [str(tmp_path / "study.yml"), "--run", str(tmp_path / "run"), "--jobs", "1", "-q"]
    assert [run_command([stage, *study]) for stage in ("measure", "estimate", "fit")] == [0, 0, 1]
    words = capsys.readouterr().err
    assert said in words
    assert "raise their stiffness" not in words
