"""Each fault of friction logs has its sentence: what, where, why, and what to do next; clean logs have none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import (
    COULOMB,
    RATE,
    SPEEDS,
    THERMOMETER_LINE,
    VISCOUS,
    sliding_torque,
    trapezoids,
    write_log,
    write_study,
)

from elastid.app import cli
from elastid.app.console import Console
from elastid.app.run import Run, run_stage
from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, ElastidError, StudyError
from elastid.store.friction_study import read_friction_result
from elastid.study import load

REFERENCE = "- {role: reference, at: motor 1, channel: angle, quantity: position, unit: deg, side: motor}"
CONTROLLER = "\n    controller: {position_gain: 30, velocity_gain: 400}"


def write(folder: Path, q: FloatArray, torque: FloatArray | None = None, name: str = "log.csv") -> None:
    write_log(folder / name, q, sliding_torque(q) if torque is None else torque, np.full(len(q), 40.0))


def run(study: Path, *stages: str) -> Run:
    """The stages from the first one."""
    found = Run(load(study), study.parent / "run", 1, Console(0))
    for stage in stages:
        run_stage(found, stage)
    return found


def refusal(study: Path, kind: type[ElastidError] = DataError) -> str:
    with pytest.raises(kind) as error:
        run(study, "measure", "levels")
    return str(error.value)


def test_a_clean_log_gives_the_law_without_an_alarm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Coulomb and viscous friction within 2 %; six speeds there and back in one log."""
    write(tmp_path, trapezoids(SPEEDS))
    study = write_study(tmp_path, thermometer=THERMOMETER_LINE)
    (joint,) = read_friction_result(run(study, "measure", "levels", "friction").path("friction")).joints
    numbers = {number.name: number for number in joint.numbers}
    assert numbers["Fc_m1"].value == pytest.approx(COULOMB, rel=0.02)
    assert numbers["f_m1"].value == pytest.approx(VISCOUS, rel=0.02)
    assert joint.levels is not None
    assert joint.levels.levels.n_levels == len(SPEEDS)
    assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("q", "spoil", "keys", "words"),
    [
        (trapezoids((0.5,))[: round(2.2 * RATE)], None, {"files": "      - {path: log.csv, speed: 0.5}"},
         ("joint 1, passes at 0.5 rad/s: they have positive velocity only", "record both directions")),
        (trapezoids(SPEEDS), lambda u: -u, {}, ("friction drives", "turn one channel (sign: -1)")),
        (trapezoids((0.2, 0.5)), lambda u: -u, {}, ("friction drives (Coulomb -", "turn one channel (sign: -1)")),
        (trapezoids(SPEEDS), None, {"torque_side": "link"},
         ("an inertia of 0.1499", "the robot's file 15", "give the channel side: motor")),
        (trapezoids(SPEEDS), None, {"angle_side": "link"}, ("would turn", "give that channel side: motor")),
    ],
    ids=["one direction", "velocity's sign", "its sign at two speeds", "torque's side", "angle's side"],
)  # fmt: skip
def test_logs_that_cannot_be_used_are_refused(
    q: FloatArray,
    spoil: Callable[[FloatArray], FloatArray] | None,
    keys: dict[str, str],
    words: tuple[str, ...],
    tmp_path: Path,
) -> None:
    u = sliding_torque(q)
    write(tmp_path, q, u if spoil is None else spoil(u))
    study = write_study(tmp_path, **keys)
    said = refusal(study)
    for word in words:
        assert word in said


def test_a_temperature_in_kelvin_is_refused_with_its_unit(tmp_path: Path) -> None:
    q = trapezoids(SPEEDS)
    write_log(tmp_path / "log.csv", q, sliding_torque(q), np.full(len(q), 313.0))
    said = refusal(write_study(tmp_path, thermometer=THERMOMETER_LINE))
    assert "the temperature of joint 1 is 313 to 313 degC, which no joint bears" in said
    assert "give that channel unit: K" in said


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"temperature": "yes"}, "friction.law.temperature: no log has a temperature; add a channel of role t"),
        ({"constant": ""}, "experiment.recorded.channels[0].quantity: a current needs torque_constant (N*m/A)"),
        ({"passes": "{count: 9}"}, "friction.passes: speeds, count and window are of passes that are still to be made"),
        ({"thermometer": CONTROLLER}, "controller: no channel has role reference, so that the motion that"),
        (
            {"thermometer": REFERENCE + CONTROLLER.replace("30", "[30, 40]")},
            "controller.position_gain: 2 gains for 1 driven joints; give one for all, or one for each",
        ),
        ({"thermometer": REFERENCE + CONTROLLER.replace("30", "-1")}, "a loop that holds a joint has a positive one"),
        ({"files": "      - {path: log.csv, joint: 2}"}, "files[0].joint: no driven joint is called '2'"),
        ({"files": "      - {path: log.csv, load: full}"}, "files[0].load: no load is called 'full'; there are empty"),
        ({"files": "      - {path: log.csv, speed: -1}"}, "speed is -1; it must be positive: passes go there and back"),
    ],
)
def test_studies_that_cannot_work_are_refused_before_a_log_is_read(
    keys: dict[str, str], words: str, tmp_path: Path
) -> None:
    write(tmp_path, trapezoids((0.5,)))
    with pytest.raises(StudyError) as error:
        load(write_study(tmp_path, **keys))
    assert words in str(error.value)


def test_one_temperature_tells_no_change_with_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the command line says it, without a traceback."""
    write(tmp_path, trapezoids(SPEEDS))
    study = write_study(tmp_path, temperature="yes", thermometer=THERMOMETER_LINE)
    assert cli.run_command(["run", str(study), "--run", str(tmp_path / "run"), "-q"]) != 0
    said = capsys.readouterr().err
    assert "law.temperature cannot be identified: one temperature; measure cold and warm" in said
    assert "Traceback" not in said


def noted(study: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What the stages warn of."""
    run(study, "measure", "levels")
    return " ".join(capsys.readouterr().err.split())


def test_stick_slip_is_said_of_its_pass(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A pass at 0.03 rad/s in jerks of 2 Hz, in a log of that speed."""
    slow = trapezoids((0.03,))
    jerky = slow + 0.004 * np.sin(2 * np.pi * 2 * np.arange(len(slow)) / RATE)
    write(tmp_path, trapezoids(SPEEDS))
    write(tmp_path, jerky, name="slow.csv")
    said = noted(write_study(tmp_path, ("{path: log.csv}", "{path: slow.csv, speed: 0.03}")), capsys)
    assert "pass slow-1: the joint stands or turns back within the pass" in said
    assert "raise the bandwidth of the controller, or measure faster" in said


def test_a_window_too_short_for_its_speed_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is left is the regression of the motion."""
    write(tmp_path, trapezoids((0.5, 0.5), travel=0.05))
    said = noted(write_study(tmp_path, ("{path: log.csv, joint: 1, speed: 0.5}",)), capsys)
    assert "passes at 0.5 rad/s: no plateau was found (travel 0.062 rad" in said
    assert "the window is too short for ramps, settling and a plateau" in said
    assert "record a longer travel" in said


def test_a_clipped_torque_is_said_of_its_passes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    q = trapezoids(SPEEDS)
    u = sliding_torque(q)
    write(tmp_path, q, np.clip(u, -8.0, 8.0))
    said = noted(write_study(tmp_path), capsys)
    assert "of its torques stand at the limit of 8: clipped there" in said


def test_a_moved_controller_and_large_gravity_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    q = trapezoids((0.1, 0.6, 0.2, 0.9, 0.3, 0.75, 0.15, 0.5))
    write(tmp_path, q, sliding_torque(q) + np.where(np.arange(len(q)) > 16000, 6.0, 0.0))
    assert "their offset jumps by " in noted(write_study(tmp_path), capsys)
    write(tmp_path, q, sliding_torque(q, noise=0.01, gravity=1500.0))
    assert "times friction" in noted(write_study(tmp_path), capsys)


def test_loops_of_few_counts_are_refused(tmp_path: Path) -> None:
    """Two counts of a 16-bit encoder on the motor."""
    t = np.arange(2000) / RATE
    write(tmp_path, trapezoids(SPEEDS))
    write(tmp_path, 1.9e-6 * np.sin(2 * np.pi * t), 5 * np.sin(2 * np.pi * t), name="loops.csv")
    said = refusal(write_study(tmp_path, ("{path: log.csv}", "{path: loops.csv, joint: 1, purpose: loops}")))
    assert "move by less than 3 counts of the encoder" in said
    assert "raise the torque of the loops" in said
