"""Logs of commands and positions: channels by name, gains in the log, and the channels of a study."""

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import Signals
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import CascadeSpec, FileSpec, RecordedSpec
from elastid.logs.command_log import read_command_log, read_study_log
from elastid.robot import Body, Joint, Motor, Robot

JOINTS = ("hip", "knee")
ROBOT = Robot("leg", tuple(Body(f"{name} link", joints=(Joint(name, motor=Motor(1.0)),), mass=1.0) for name in JOINTS))


@pytest.fixture
def signals() -> Signals:
    """Commands, commanded velocities and positions of two joints, the second at rest; 400 Hz."""
    t = np.arange(800) / 400
    command = np.stack([0.3 * np.sin(2 * np.pi * t), np.full(800, 0.2)], axis=1)
    return {"time_s": t, "command": command, "command_velocity": np.gradient(command, 1 / 400, axis=0),
            "position": 0.9 * command + 0.01}  # fmt: skip


def test_matrices_of_an_archive_are_read_with_gains(signals: Signals, tmp_path: Path) -> None:
    """By column in the order of the joints; one kd for all; a joint that rests is read, too."""
    path = tmp_path / "log.npz"
    np.savez(path, **signals, velocity=signals["command_velocity"], kp=[20.0, 40.0], kd=1.0)
    log = read_command_log(path, JOINTS)
    for name in ("command", "position"):
        np.testing.assert_array_equal(getattr(log, name), signals[name])
    np.testing.assert_array_equal(log.velocity, signals["command_velocity"])
    assert (log.rate_hz, log.clock_hz) == (400.0, 400.0)
    assert (log.kp.tolist(), log.kd.tolist()) == ([20.0, 40.0], [1.0, 1.0])


def test_columns_of_a_text_are_assigned_by_joint_names(signals: Signals, tmp_path: Path) -> None:
    """In any order, in degrees where the heading says so; the rate of the option counts."""
    path = tmp_path / "log.csv"
    columns = [np.rad2deg(signals[name][:, i]) for name in ("command", "position") for i in (1, 0)]
    heads = [f"{name}_{joint} [deg]" for name in ("cmd_pos", "pos") for joint in ("knee", "hip")]
    np.savetxt(path, np.stack([signals["time_s"], *columns], axis=1), delimiter=",", comments="", fmt="%.9f",
               header=",".join(["time", *heads]))  # fmt: skip
    log = read_command_log(path, JOINTS, 500.0)
    np.testing.assert_allclose(log.command, signals["command"], atol=1e-9)
    np.testing.assert_allclose(log.position, signals["position"], atol=1e-9)
    assert (log.rate_hz, log.clock_hz, log.kp, log.kd) == (500.0, 400.0, None, None)
    assert not log.velocity.any()


def test_log_without_commands_or_time_is_refused(signals: Signals, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, position=signals["position"])
    with refused("records/channels"):
        read_command_log(path, JOINTS, 100.0)
    np.savez(path, position=signals["position"], command=signals["command"])
    with refused("records/clock"):
        read_command_log(path, JOINTS)


def test_channels_of_a_study_have_units_and_its_controller_gains(signals: Signals, tmp_path: Path) -> None:
    """Degrees, sign and scale; kp is K_p K_v; commanded velocities are those that the controller feeds forward."""
    path = tmp_path / "log.npz"
    np.savez(path, a=np.rad2deg(signals["command"]), b=-signals["position"])
    of_role = {
        "reference": [ChannelSpec("reference", f"motor {joint}", "a", i + 1, quantity="position", unit="deg")
                      for i, joint in enumerate(JOINTS)],
        "y": [ChannelSpec("y", f"motor {joint}", "b", i + 1, quantity="position", sign=-1)
              for i, joint in enumerate(JOINTS)],
    }  # fmt: skip
    torque = ChannelSpec("u", "motor hip", "c")
    channels = (*of_role["reference"], *of_role["y"], torque)
    controller = CascadeSpec(position_gain=20.0, velocity_gain=(1.0, 2.0), velocity_feedforward=1.0)
    recorded = RecordedSpec(400.0, channels, (FileSpec("log.npz"),), controller=controller)
    log = read_study_log(path, recorded, ROBOT)
    np.testing.assert_allclose(log.command, signals["command"])
    np.testing.assert_allclose(log.position, signals["position"])
    np.testing.assert_allclose(log.velocity[1:-1], signals["command_velocity"][1:-1], atol=1e-9)
    assert log.kp.tolist() == [20.0, 40.0]
    with refused("study/recorded"):
        read_study_log(path, RecordedSpec(400.0, (*of_role["y"], torque), (FileSpec("log.npz"),)), ROBOT)
