"""Friction of real axes, from shipped studies of logs that were made for something else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from elastid.app import cli
from elastid.study import load_robot

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
AXIS, ROBOT = DATA / "emps_prismatic_axis" / "DATA_EMPS.mat", DATA / "kuka_kr300" / "traj_A.mat"

needs_axis = pytest.mark.skipif(not AXIS.exists(), reason="the record of the prismatic axis is not here")
needs_robot = pytest.mark.skipif(not ROBOT.exists(), reason="the record of the six axes is not here")


def run(name: str, folder: Path) -> dict[str, Any]:
    """`elastid run` of a shipped study, and the summary it leaves."""
    study = ROOT / "configs" / "real" / f"{name}.yml"
    assert cli.run_command(["run", str(study), "--run", str(folder), "-q", "--set", "report.formats=[png]"]) == 0
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return summary


@pytest.mark.slow
@needs_axis
def test_a_prismatic_axis_has_mass_and_friction_by_direction(tmp_path: Path) -> None:
    """Janot, Gautier and Brunot (2019) have 95.11 kg, 203.5 N s/m and 20.39 N with both directions alike."""
    summary = run("emps", tmp_path / "run")
    value = {name: number["value"] for name, number in summary["parameters"].items()}
    assert value["J_m1"] == pytest.approx(95.1, abs=0.2)
    assert [value["f_m1+"], value["f_m1-"]] == pytest.approx([166, 240], abs=1)
    assert [value["Fc_m1+"], value["Fc_m1-"]] == pytest.approx([20.2, 20.7], abs=0.1)
    motion = summary["motions"]["1"]
    assert motion["relative_error"] < 0.025
    alike = {name: number["value"] for name, number in motion["alike"].items()}
    assert alike["viscous"] == pytest.approx(203.5, abs=0.5)
    assert alike["coulomb"] == pytest.approx(20.39, abs=0.05)
    assert not any(name.startswith(("Fs", "vs")) for name in value)
    (torque,) = summary["torque"]
    assert torque["shares"] == pytest.approx(
        {"inertia": 0.508, "viscous friction": 0.232, "dry friction": 0.259}, abs=0.005
    )
    assert torque["left_without_friction"] == pytest.approx(0.49, abs=0.01)
    assert torque["left"] < 0.001
    (refused,) = (each["reason"] for each in summary["not_identified"] if each["part"] == "stribeck")
    assert refused.startswith("the motion dwells at 3 speeds")
    assert load_robot(tmp_path / "run" / "identified_robot.yml").driven[0].motor.viscous > 0  # type: ignore[union-attr]


@pytest.mark.slow
@needs_robot
def test_six_axes_have_friction_with_the_error_of_their_rigid_body(tmp_path: Path) -> None:
    """Intervals hold what Weigand et al. (2021) identified with a full model of the robot, but for axis 5.

    There it is 468, just below the interval; its Coulomb friction and the coupling in the wrist are not the same.
    """
    summary = run("kr300_friction", tmp_path / "run")
    published = {"1": 1939.52, "2": 1729.85, "3": 1562.42, "4": 280.49, "6": 384.41}
    for joint, viscous in published.items():
        low, high = summary["parameters"][f"f_m{joint}"]["interval95"]
        assert low < viscous < high, joint
    left = [motion["relative_error"] for motion in summary["motions"].values()]
    assert len(left) == 6
    assert max(left) < 0.21
    assert min(left) > 0.03
    (warned,) = (note for note in summary["notes"] if note["severity"] == "warning")
    assert warned["code"] == "rigid-body-error"
    assert len(warned["places"]) == 4
    assert "hold only together with it" in warned["text"]
    torque = {each["place"]: each for each in summary["torque"]}
    rigid = [torque[f"joint {joint}"]["shares"]["rigid body"] for joint in range(1, 7)]
    assert rigid == pytest.approx([0.297, 0.820, 0.906, 0.031, 0.754, 0.087], abs=0.01)
    assert all(each["left"] < 0.05 < each["left_without_friction"] for each in torque.values())
    # Friction that reverses at once: above 5 Hz the model without it leaves less of axis 4.
    top = torque["joint 4"]["bands"][-1]
    assert top["low_hz"] == 5
    assert top["left"] > 2 * top["left_without_friction"]
