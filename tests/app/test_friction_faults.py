"""Each fault of friction logs has its sentence: what, where, why, and what to do next; clean logs have none."""

from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import (
    COULOMB,
    SPEEDS,
    THERMOMETER_LINE,
    VISCOUS,
    sliding_torque,
    trapezoids,
    write_log,
    write_study,
)

from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.store.friction_study import read_friction_result
from elastid.study import load

REFERENCE = "- {role: reference, at: motor 1, channel: angle, quantity: position, unit: deg, side: motor}"
CONTROLLER = "\n    controller: {position_gain: 30, velocity_gain: 400}"


def write(folder: Path, q: FloatArray) -> None:
    write_log(folder / "log.csv", q, sliding_torque(q), np.full(len(q), 40.0))


def run(study: Path, *stages: str) -> Run:
    found = Run(load(study), study.parent / "run", 1, Console(0))
    run_all(found, stages)
    return found


@pytest.mark.slow
def test_a_clean_log_gives_the_law_without_an_alarm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Coulomb and viscous friction within 2 %; six speeds there and back in one log."""
    write(tmp_path, trapezoids(SPEEDS))
    study = write_study(tmp_path, thermometer=THERMOMETER_LINE)
    (joint,) = read_friction_result(run(study, "measure", "constant_velocity", "friction").path("friction")).joints
    numbers = {number.name: number for number in joint.numbers}
    assert numbers["Fc_m1"].value == pytest.approx(COULOMB, rel=0.02)
    assert numbers["f_m1"].value == pytest.approx(VISCOUS, rel=0.02)
    assert joint.constant_velocity.n_conditions == len(SPEEDS)
    assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"constant": ""}, "experiment.recorded.channels[0].quantity: a current needs torque_constant (N*m/A)"),
        ({"constant_velocity": "{count: 9}"}, "friction.constant_velocity: speeds, count and window"),
        ({"thermometer": CONTROLLER}, "controller: no channel has role reference"),
        (
            {"thermometer": REFERENCE + CONTROLLER.replace("30", "[30, 40]")},
            "controller.position_gain: 2 numbers for 1 driven joints",
        ),
        ({"files": "      - {path: log.csv, load: full}"}, "files[0].load: no load is called 'full'; there are empty"),
        ({"temperature": "yes"}, "friction.law.temperature: no log has a temperature"),
        ({"files": "      - {path: log.csv, joint: 2}"}, "files[0].joint: no driven joint is called '2'"),
    ],
)
def test_invalid_friction_studies_are_refused_before_reading_logs(
    keys: dict[str, str], words: str, tmp_path: Path
) -> None:
    write(tmp_path, trapezoids((0.5,)))
    with pytest.raises(StudyError) as error:
        load(write_study(tmp_path, **keys))
    assert words in str(error.value)
