"""`elastid new --from ROBOT --from LOG`: logs at the motors of the robot that they name, in the postures they hold."""

from pathlib import Path

import numpy as np
import pytest
from plants.mjcf_arm import ARM as CRANE

from elastid.app import cli
from elastid.app.cli import run_command
from elastid.study import load_with_logs
from tests.app.test_scaffold import ARM


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
    u += np.tile(3 * rng.standard_normal((1000, len(names))), (2, 1))  # friction, beside inertias of no robot
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


def test_logs_that_differ_in_one_drive_are_no_periods_of_one_excitation(tmp_path: Path) -> None:
    """The signs of orthogonal experiments, on a carrier that is most of the second drive: `run` would refuse them."""
    t, lines, rng = np.arange(1500) / 500, np.arange(7, 100, 4), np.random.default_rng(0)
    phases, logs = rng.uniform(0, 2 * np.pi, (2, len(lines))), []
    x = np.cos(2 * np.pi * t[:, None, None] * lines + phases).sum(axis=2)
    for number, sign in enumerate((1, -1)):
        u = x * [1, sign] + [0, 15] * np.sin(4 * np.pi * t)[:, None]
        columns = np.concatenate([u, 0.1 * u + 1e-3 * rng.standard_normal(u.shape)], axis=1)
        logs.append(str(tmp_path / f"{number}.csv"))
        np.savetxt(logs[-1], columns, "%.8g", ",", header="torque_1 [Nm],torque_2 [Nm],acc_1,acc_2", comments="")
    assert cli.run_command(["new", str(tmp_path / "new"), "--from", *logs]) == 0
    recorded = load_with_logs(tmp_path / "new" / "study.yml").study.experiment.as_recorded()
    assert [file.realisation for file in recorded.files] == [0, 1]


def _states(folder: Path, logs: dict[str, np.ndarray], head: str) -> list[str]:
    """The configurations of the logs in the study that is made of them."""
    for name, x in logs.items():
        np.savetxt(folder / name, x, "%.8g", ",", header=head, comments="")
    new = folder / f"new {len(list(folder.iterdir()))}"
    assert cli.run_command(["new", str(new), "--from", *(str(folder / name) for name in logs)]) == 0
    study = load_with_logs(new / "study.yml", ()).study
    return [file.configuration for file in study.experiment.recorded.files]


def test_joints_with_names_are_paired_and_postures_are_configurations(tmp_path: Path) -> None:
    """Three motors that are called, not numbered; the same log at other angles."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=(4000, 3))
    q = np.cumsum(np.cumsum(u - u.mean(axis=0), axis=0), axis=0)
    x = np.hstack([np.arange(4000)[:, None] / 500, u, 0.01 * (q - q.mean(axis=0)) / q.std(axis=0)])
    head = "time,tau_base,tau_lift,tau_elbow,q_base,q_lift,q_elbow"
    logs = {"a.csv": x, "b.csv": x[:3000], "c.csv": x + np.array([0, 0, 0, 0, 0.5, 0, -0.3])}
    assert _states(tmp_path, logs, head) == ["state_1", "state_1", "state_2"]
    (study,) = tmp_path.glob("new*/study.yml")
    assert study.read_text().count("role: u") == 3
