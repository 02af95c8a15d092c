"""Friction of real axes, from shipped studies of logs that were made for something else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.measured import with_records

from elastid.app import cli
from elastid.friction_study.extended_kalman_filter import JointSamples, KalmanFilter, first_estimate
from elastid.friction_study.filter_consistency import FILTER
from elastid.store.friction_study import read_filter, read_friction_records
from elastid.study import load_robot

ROOT = Path(__file__).parents[2]


def run(name: str, folder: Path, code: int = 0) -> dict[str, Any]:
    """`elastid run` of a shipped study, which ends with that exit code, and the summary it leaves."""
    study = with_records(ROOT / "configs" / "real" / f"{name}.yml")
    assert cli.run_command(["run", str(study), "--run", str(folder), "-q"]) == code
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return summary


@pytest.mark.slow
def test_a_prismatic_axis_has_mass_and_friction_by_direction(tmp_path: Path) -> None:
    """Janot, Gautier and Brunot (2019) have 95.11 kg, 203.5 N s/m and 20.39 N with both directions alike."""
    summary = run("emps", tmp_path / "run")
    value = {name: number["value"] for name, number in summary["parameters"].items()}
    for name, published in {"J_m1": 95.11, "f_m1": 203.5, "Fc_m1": 20.39}.items():
        low, high = summary["parameters"][name]["interval95"]
        assert low < published < high, name
    assert [value["f_m1+"], value["f_m1-"]] == pytest.approx([166, 239], abs=2)
    assert [value["Fc_m1+"], value["Fc_m1-"]] == pytest.approx([20.35, 20.9], abs=0.2)
    motion = summary["motions"]["1"]
    assert motion["relative_error"] < 0.02
    assert motion["misfit"] == ""
    assert sum(motion["seconds"].values()) == pytest.approx(24.841)
    assert not any(name.startswith(("Fs", "vs")) for name in value)
    (torque,) = summary["torque"]
    assert torque["shares"] == pytest.approx(
        {"inertia": 0.497, "viscous friction": 0.237, "dry friction": 0.267}, abs=0.005
    )
    assert torque["left_without_friction"] == pytest.approx(0.502, abs=0.01)
    assert torque["left"] < 0.001
    # Simulated forwards: under the log's force, and under its reference through its controller.
    under_force, followed = ({s["signal"]: s for s in run["signals"]} for run in summary["twin"])
    assert under_force["motor angle"]["error"] == pytest.approx(0.0042, abs=0.0005)
    assert under_force["motor angle"]["error_without_friction"] == pytest.approx(0.42, abs=0.02)
    assert followed["torque"]["error"] == pytest.approx(0.034, abs=0.003)
    assert followed["torque"]["error_without_friction"] == pytest.approx(0.71, abs=0.02)
    (refused,) = (each["reason"] for each in summary["not_identified"] if each["part"] == "stribeck")
    assert refused.startswith("the motion dwells at 3 speeds")
    assert load_robot(tmp_path / "run" / "identified_robot.yml").driven[0].motor.viscous > 0  # type: ignore[union-attr]


@pytest.mark.slow
def test_friction_of_a_prismatic_axis_is_followed_by_direction(tmp_path: Path) -> None:
    """Near the regression of the whole motion; NIS in its band; a law without bristles is less likely.

    F_c changes by -3 to +5 % along the axis, as the study of its law says, and the filter ends with that of its end.

    That law ends near the 171.5 and 248.5 N s/m of a filter whose friction switches with the direction, +- 2.6 and 2.1.
    """
    study = with_records(ROOT / "configs" / "real" / "emps_follow.yml")
    assert (
        cli.run_command(["run", str(study), "measure", "levels", "friction", "follow", "--run", str(tmp_path), "-q"])
        == 0
    )
    (found,) = read_filter(tmp_path / "filter.h5")
    assert found.filtered.viscous == pytest.approx(202.9, abs=0.5)
    regression = {"Fc": 20.5, "f+": 166.1, "f-": 238.6}
    for i, (name, value) in enumerate(zip(found.names, found.values[-1].tolist(), strict=True)):
        half = (found.high[-1, i] - found.low[-1, i]) / 2
        if name in regression:
            assert abs(value - regression[name]) < half + 0.05 * value, name
    # Friction over position, which the law of the study has and the filter has not, leaves some.
    assert 0.9 < found.consistency.nis < FILTER.nis_band[1]
    assert found.consistency.is_white
    (record,) = read_friction_records(tmp_path / "records.h5").records
    samples = JointSamples(record.torque[:-1], np.zeros(len(record.torque) - 1), record.position[1:])
    unlikely = {}
    for bend in (1e-6, 25e-6):
        # Without doubts about what the filter holds.
        sure = replace(found.filtered, tolerances={})
        joint = replace(sure, bristle_stiffness=sure.coulomb / bend)
        track = KalmanFilter(joint, found.rate_hz).run(samples, found.noise, first_estimate(joint, samples.angle[0]))
        unlikely[bend] = float(np.sum((np.log(track.variance) + track.nis)[1000:]))
        if bend < 5e-6:
            ends = [track.values(name)[-1] for name in ("f+", "f-")]
            assert ends == pytest.approx([171.5, 248.5], abs=4)
    assert unlikely[1e-6] > unlikely[25e-6] + 100


@pytest.mark.slow
def test_six_axes_have_friction_with_the_error_of_their_rigid_body(tmp_path: Path) -> None:
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
    assert "hold only together with it" in warned["text"]
    torque = {each["place"]: each for each in summary["torque"]}
    rigid = [torque[f"joint {joint}"]["shares"]["rigid body"] for joint in range(1, 7)]
    assert rigid == pytest.approx([0.293, 0.819, 0.910, 0.078, 0.738, 0.087], abs=0.01)
    assert all(each["left"] < 0.05 < each["left_without_friction"] for each in torque.values())
    (twin,) = summary["twin"]
    assert twin["driven_by"] == "torque"
    errors = {(s["signal"], s["place"]): (s["error"], s["error_without_friction"]) for s in twin["signals"]}
    motors = [errors["motor angle", f"motor {joint}"] for joint in range(1, 7)]
    assert all(error < 0.07 < without for error, without in motors)
    assert [errors["link motion", f"joint {joint}"][0] < 0.06 for joint in range(1, 4)] == [True] * 3
    # Friction that reverses at once: above 5 Hz the model without it leaves less of axis 4.
    top = torque["joint 4"]["bands"][-1]
    assert top["low_hz"] == 5
    assert top["left"] > 2 * top["left_without_friction"]
