"""`elastid new --from ROBOT --from LOG`: logs at the motors of the robot that they name, in the postures they hold."""

from pathlib import Path

import numpy as np
import pytest

from elastid.app.cli import run_command
from elastid.study import load_with_logs
from tests.app.test_from_mjcf import ARM as CRANE
from tests.app.test_from_robot import ARM


def logged(path: Path, names: tuple[str, ...], angles: tuple[float, ...], units: str = "") -> str:
    """Two periods of random torques, and the angles of masses that they move, each joint alone."""
    rng = np.random.default_rng(0)
    u = np.tile(rng.standard_normal((1000, len(names))), (2, 1))
    q = np.cumsum(np.cumsum(u - u.mean(axis=0), axis=0), axis=0)
    q = 0.01 * (q - q.mean(axis=0)) / q.std(axis=0) + np.array(angles)
    scale = [np.rad2deg(1.0) if units and name != "x" else 1.0 for name in names]
    units_of = ["" if name == "x" else units for name in names]
    heads = (f"q_{name}{unit}" for name, unit in zip(names, units_of, strict=True))
    head = ",".join(["t", *(f"tau_{name}" for name in names), *heads])
    rows = np.hstack([np.arange(len(u))[:, None] / 500, u, scale * q])
    np.savetxt(path, rows, "%.9g", ",", header=head, comments="")
    return str(path)


@pytest.mark.parametrize(("suffix", "units"), [("urdf", ""), ("xml", " [deg]")])
def test_logs_are_at_the_motors_that_they_name(suffix: str, units: str, tmp_path: Path) -> None:
    """In any order of the columns; the means of the angles are the configurations, in rad."""
    joints = {"urdf": ("shoulder", "elbow"), "xml": ("x", "turn", "lift")}[suffix]
    if suffix == "xml":
        pytest.importorskip("mujoco", reason="MuJoCo is in the group 'oracles'")
    robot = tmp_path / f"arm.{suffix}"
    robot.write_text(ARM if suffix == "urdf" else CRANE)
    logs = [
        logged(tmp_path / f"{i}.csv", joints[::-1], tuple(angle * (k + 1) for k in range(len(joints))), units)
        for i, angle in enumerate((0.2, -0.3))
    ]
    assert run_command(["new", str(tmp_path / "new"), "--from", str(robot), "--from", *logs]) == 0
    study = load_with_logs(tmp_path / "new" / "study.yml").study
    assert [joint.name for joint in study.as_robot().driven] == list(joints)
    recorded = study.experiment.as_recorded()
    assert {(c.at, c.channel.split(" ")[0]) for c in recorded.channels} == {
        (f"motor {joint}", f"{signal}_{joint}") for joint in joints for signal in ("tau", "q")
    }
    wanted = np.outer((0.2, -0.3), np.arange(len(joints), 0, -1))
    np.testing.assert_allclose([*study.experiment.configurations.values()], wanted, atol=1e-3)
    assert {*study.fit.parameters} == {"k_*", "d_*", "fm_*", "Jm_*"}


def test_logs_of_another_number_of_joints_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With both lists; nothing is written."""
    (tmp_path / "arm.urdf").write_text(ARM)
    log = logged(tmp_path / "log.csv", ("1", "2", "3"), (0.0, 0.1, 0.2))
    assert run_command(["new", str(tmp_path / "new"), "--from", str(tmp_path / "arm.urdf"), log]) == 1
    said = capsys.readouterr().err
    assert "torque and motion of 3 joints (tau_1, tau_2, tau_3)" in said
    assert "drives 2 (shoulder, elbow)" in said
    assert not (tmp_path / "new").exists()


def test_joints_without_names_are_in_the_order_of_the_robot(tmp_path: Path) -> None:
    """Which the line of the study says."""
    (tmp_path / "arm.urdf").write_text(ARM)
    log = logged(tmp_path / "log.csv", ("1", "2"), (0.5, -0.5))
    assert run_command(["new", str(tmp_path / "new"), "--from", str(tmp_path / "arm.urdf"), log]) == 0
    text = (tmp_path / "new" / "study.yml").read_text()
    assert "at: motor shoulder, channel: tau_1" in text
    assert "of shoulder by its place in the robot's file" in text
