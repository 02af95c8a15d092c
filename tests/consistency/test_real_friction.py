"""Friction of real axes, from records that were made for something else."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.measured import EMPS, EMPS_PULSES, measured, with_records
from plants.paths import ROOT
from plants.runs import summary_of
from scipy.io import loadmat

from elastid.app import cli
from elastid.friction_study.extended_kalman_filter import JointSamples, KalmanFilter
from elastid.friction_study.filter_consistency import MAX_CORRELATION, NIS_BAND
from elastid.friction_study.inverse_dynamics_regression import regress_motion
from elastid.friction_study.motion_signals import Motion
from elastid.store.friction_study import read_filter, read_friction_records, read_friction_result, read_validation_logs
from elastid.study import load_robot

STAGES = ("measure", "constant_velocity", "friction", "follow")


def run(name: str, folder: Path, code: int = 0) -> dict[str, Any]:
    """`elastid run` of a shipped study, which ends with that exit code, and the summary it leaves."""
    study = with_records(ROOT / "configs" / "real" / f"{name}.yml")
    assert cli.run_command(["run", str(study), "--run", str(folder), "-q"]) == code
    return summary_of(folder)


@pytest.mark.slow
def test_prismatic_axis_is_simulated_by_force_and_by_controller(tmp_path: Path) -> None:
    """Its mass and friction are those of friction_study/test_inverse_dynamics_regression.py."""
    summary = run("emps", tmp_path / "run")
    assert summary["motions"]["1"]["misfit"] == ""
    assert not any(name.startswith(("Fs", "vs")) for name in summary["parameters"])
    # Simulated forwards: under the log's force, and under its reference through its controller.
    under_force, followed = ({s["signal"]: s for s in run["signals"]} for run in summary["simulation"])
    assert under_force["motor angle"]["error"] == pytest.approx(0.0042, abs=0.0005)
    assert followed["torque"]["error"] == pytest.approx(0.034, abs=0.003)
    assert load_robot(tmp_path / "run" / "identified_robot.yml").driven[0].motor.viscous > 0


@pytest.mark.slow
def test_friction_of_a_prismatic_axis_is_followed_by_direction(tmp_path: Path) -> None:
    """Near the regression of the whole motion; NIS in its band; a law without bristles is less likely.

    F_c changes by -3 to +5 % along the axis, as the study of its law says, and the filter ends with that of its end.

    That law ends near the 171.5 and 248.5 N s/m of a filter whose friction switches with the direction, +- 2.6 and 2.1.
    """
    study = with_records(ROOT / "configs" / "real" / "emps_follow.yml")
    assert cli.run_command(["run", str(study), *STAGES, "--run", str(tmp_path), "-q"]) == 0
    (found,) = read_filter(tmp_path / "filter.h5")
    assert found.filtered.viscous == pytest.approx(202.9, abs=0.5)
    regression = {"Fc": 20.5, "f+": 166.1, "f-": 238.6}
    for i, (name, value) in enumerate(zip(found.names, found.values[-1].tolist(), strict=True)):
        half = (found.high[-1, i] - found.low[-1, i]) / 2
        if name in regression:
            assert abs(value - regression[name]) < half + 0.05 * value, name
    # Friction over position, which the law of the study has and the filter has not, leaves some.
    assert 0.9 < found.consistency.nis < NIS_BAND[1]
    assert found.consistency.autocorrelation[1] < MAX_CORRELATION
    (record,) = read_friction_records(tmp_path / "records.h5").records
    samples = JointSamples(record.torque[:-1], np.zeros(len(record.torque) - 1), record.position[1:])
    unlikely = {}
    for bend in (1e-6, 25e-6):
        # Without doubts about what the filter holds.
        sure = replace(found.filtered, tolerances={})
        joint = replace(sure, bristle_stiffness=sure.coulomb / bend)
        track = KalmanFilter(joint, found.rate_hz).run([samples], found.noise)
        unlikely[bend] = float(np.sum((np.log(track.innovation_variance) + track.nis)[1000:]))
        if bend < 5e-6:
            ends = [track.values(name)[-1] for name in ("f+", "f-")]
            assert ends == pytest.approx([171.5, 248.5], abs=4)
    assert unlikely[1e-6] > unlikely[25e-6] + 100


@pytest.mark.slow
def test_six_axes_friction_includes_rigid_body_error(tmp_path: Path) -> None:
    """Intervals hold what Weigand et al. (2021) identified with a full model of the robot, but for axis 5.

    There it is 468, just below the interval; its Coulomb friction and the coupling in the wrist are not the same. The
    friction of axis 6 changes with the band, by what the rigid body lacks: a misfit.
    """
    summary = run("kr300_friction", tmp_path / "run", code=3)
    assert summary["status"] == "misfit"
    assert "joint 6: below 2.5 Hz viscous is" in summary["message"]
    published = {"1": 1939.52, "2": 1729.85, "3": 1562.42, "4": 280.49, "6": 384.41}
    for joint, viscous in published.items():
        low, high = summary["parameters"][f"f_m{joint}"]["interval95"]
        assert low < viscous < high, joint
    left = [motion["relative_error"] for motion in summary["motions"].values()]
    assert len(left) == 6
    assert max(left) < 0.21
    assert min(left) > 0.03
    (warned,) = (note for note in summary["notes"] if note["severity"] == "warning")
    assert warned["code"] == "friction/rigid-body"
    assert len(warned["places"]) == 3
    (body,) = summary["rigid_bodies"]  # columns that are rounding have no number of 1e17 kg*m
    assert max(abs(each["value"]) for each in body["base_parameters"].values()) < 1e5
    torque = {each["place"]: each for each in summary["torque"]}
    rigid = [torque[f"joint {joint}"]["fractions"]["rigid body"] for joint in range(1, 7)]
    assert rigid == pytest.approx([0.293, 0.819, 0.910, 0.078, 0.738, 0.087], abs=0.01)
    assert all(each["unexplained_fraction"] < 0.05 < each["unexplained_without_friction"] for each in torque.values())
    (log_comparison,) = summary["simulation"]
    assert log_comparison["driven_by"] == "torque"
    errors = {(s["signal"], s["place"]): s["error"] for s in log_comparison["signals"]}
    motors = [errors["motor angle", f"motor {joint}"] for joint in range(1, 7)]
    assert all(error < 0.07 for error in motors)
    assert [errors["link motion", f"joint {joint}"] < 0.06 for joint in range(1, 4)] == [True] * 3
    # Friction that reverses at once: above 5 Hz the model without it leaves less of axis 4.
    top = torque["joint 4"]["bands"][-1]
    assert top["low_hz"] == 5
    assert top["unexplained_fraction"] > 2 * top["unexplained_without_friction"]


def test_two_records_of_the_axis_agree_within_their_intervals() -> None:
    """Motion alone, and with pulses of force: 95 % intervals of the difference of each number."""
    logs = [loadmat(measured(name)) for name in (EMPS, EMPS_PULSES)]
    motions = [Motion("joint 1", 1e3, log["qm"].ravel(), 35.1507 * log["vir"].ravel(), slides=True) for log in logs]
    first, second = (regress_motion(motion).regression for motion in motions)
    assert first.names == second.names
    for name in first.names:
        assert abs(first[name] - second[name]) < 1.96 * np.hypot(first.std(name), second.std(name)), name


@pytest.mark.slow
def test_legs_of_a_quadruped_move_by_their_commands_alone(tmp_path: Path) -> None:
    """Reserved logs at most at 0.004 rad rms over 12 joints; published 0.0056, and 0.079 where a joint is told to be.

    The delay is between nothing and three samples, and inertias of equal joints of the four legs agree within 10 %.
    """
    assert run("go2", tmp_path / "run")["status"] == "identified"
    found = read_friction_result(tmp_path / "run" / "friction.h5")
    judged = read_validation_logs(tmp_path / "run" / "friction.h5")
    assert [run.log for run in judged.runs] == ["log_6", "log_7"]
    for log in judged.runs:
        squares = [np.mean((signal.measured - signal.simulated) ** 2) for signal in log.signals]
        assert len(squares) == 12
        assert np.sqrt(np.mean(squares)) < 0.004
    numbers = {number.name: number for number in found.numbers}
    assert 0.0 < numbers["T_d_mFL_hip"].value < 0.015
    for part in ("hip", "thigh", "calf"):
        inertias = [numbers[f"J_m{leg}_{part}"].value for leg in ("FL", "FR", "RL", "RR")]
        assert np.ptp(inertias) < 0.1 * np.mean(inertias)
