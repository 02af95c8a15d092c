"""A model judged on logs from commands alone, by the command line: robot.yml, URDF and MJCF."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.commanded_joint import CommandedJoint

from elastid.app import cli
from elastid.app.commanded_robot import command_delay, commanded_robot, rigid_numbers, robot_of_friction
from elastid.friction_study.commanded import DELAY
from elastid.friction_study.result import RIGID_TERMS, FrictionNumber, FrictionResult, JointFriction
from elastid.model.formulation import formulate
from elastid.robot import Axis, Body, Friction, Joint, Motor, Placement, Robot
from elastid.robot.simplified import without_friction
from elastid.simulation.controller import feed_forward
from elastid.study import load_robot
from elastid.study.robots import yaml_text

URDF = """<robot name="leg"><link name="base"/><link name="shank"><inertial><mass value="1"/>
<origin xyz="{x} 0 0"/><inertia ixx="0.03" iyy="{I}" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="knee" type="continuous"><parent link="base"/><child link="shank"/><axis xyz="0 1 0"/>
<dynamics damping="0.25" friction="0.15"/></joint></robot>"""
MJCF = """<mujoco model="leg"><worldbody><body name="shank"><joint name="knee" axis="0 1 0" damping="0.25"
frictionloss="0.15" armature="{rotor}"/><inertial mass="1" pos="{x} 0 0" diaginertia="1e-9 1e-9 1e-9"/></body>
</worldbody><actuator><position joint="knee" kp="{kp}" kv="1"/></actuator></mujoco>"""


@pytest.fixture
def log(tmp_path) -> Path:
    """A log of 6 s with time stamps and gains."""
    motion = CommandedJoint().motion(6.0)
    t = np.arange(len(motion.position)) / motion.rate_hz
    np.savez(tmp_path / "log.npz", time=t, command=motion.command, position=motion.position, kp=[20.0], kd=[1.0])
    return tmp_path / "log.npz"


def predicted(folder: Path, *words: str | Path) -> tuple[int, dict]:
    """Exit code and content of prediction.json."""
    code = cli.run_command(["predict", *map(str, words), "--run", str(folder), "--jobs", "1", "-q"])
    file = folder / "prediction.json"
    return code, json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


@pytest.mark.slow
def test_robot_file_passes_right_clock_and_fails_wrong_clock(log: Path, tmp_path: Path) -> None:
    """Exit code 3, and the factor 2.5 of the period first among the tests."""
    model = tmp_path / "robot.yml"
    model.write_text(yaml_text(CommandedJoint().robot))
    code, content = predicted(tmp_path / "right", model, "--log", log, "--log", log)
    assert (code, content["status"], len(content["logs"])) == (0, "passed", 2)
    assert content["rms"]["model"] < 0.05 * content["rms"]["late command"]
    assert (tmp_path / "right" / "prediction.png").is_file()
    code, content = predicted(tmp_path / "wrong", model, "--log", log, "--rate", "500")
    assert (code, content["status"]) == (3, "misfit")
    first = content["tests"][0]
    assert (first["quantity"], first["in_doubt"]) == ("clock", True)
    assert first["value"] == pytest.approx(2.5, rel=0.01)


@pytest.mark.slow
def test_urdf_is_a_model_with_its_damping_and_friction(log: Path, tmp_path: Path) -> None:
    """All inertia is of the link, which is the same to the joint; other gains than the log's by option."""
    joint = CommandedJoint()
    x = -joint.gravity / 9.81
    (tmp_path / "leg.urdf").write_text(URDF.format(x=x, I=joint.inertia - x**2))
    code, content = predicted(tmp_path / "run", tmp_path / "leg.urdf", "--log", log)
    assert code == 0
    assert content["rms"]["model"] < 1e-3
    code, content = predicted(tmp_path / "other", tmp_path / "leg.urdf", "--log", log, "--kp", "30")
    assert (code, content["tests"][0]["quantity"]) == (3, "kp")


@pytest.mark.oracle
@pytest.mark.slow
def test_mjcf_is_a_model_with_its_servo(log: Path, tmp_path: Path) -> None:
    """Armature, damping, frictionloss, kp and kv; a servo of another kp is named although the log has the right one."""
    pytest.importorskip("mujoco", reason="mujoco is in the group oracles")
    joint = CommandedJoint()
    x = -joint.gravity / 9.81
    for kp, expected in ((20, 0), (26, 3)):
        text = MJCF.format(x=x, rotor=joint.inertia - x**2, kp=kp)
        (tmp_path / "leg.xml").write_text(text)
        code, content = predicted(tmp_path / f"kp {kp}", tmp_path / "leg.xml", "--log", log)
        assert code == expected
    assert content["tests"][0]["quantity"] == "kp"
    assert content["tests"][0]["value"] == pytest.approx(20 / 26, rel=0.02)


STUDY = """
name: leg
robot: robot.yml
friction: {{constant_velocity: detect}}
experiment:
  recorded:
    rate_hz: 200
    channels:
      - {{role: u, at: motor knee, channel: kp, unit: N*m}}
      - {{role: reference, at: motor knee, channel: command, quantity: position}}
      - {{role: y, at: motor knee, channel: turned, quantity: position, unit: deg, sign: -1}}
    files: [{{path: log.npz}}]
    controller: {{position_gain: {gain}, velocity_gain: 1}}
"""


@pytest.mark.slow
def test_channels_and_controller_of_a_study_are_used(log: Path, tmp_path: Path) -> None:
    """Positions in degrees and of the other sign; the gains of the study, not of the log."""
    with np.load(log) as content:
        signals = {name: content[name] for name in ("command", "position")}
    np.savez(tmp_path / "log.npz", command=signals["command"], turned=-np.rad2deg(signals["position"]), kp=[99.0])
    (model := tmp_path / "robot.yml").write_text(yaml_text(CommandedJoint().robot))
    study = tmp_path / "study.yml"
    for gain, expected in ((20, 0), (26, 3)):
        study.write_text(STUDY.format(gain=gain))
        code, content = predicted(tmp_path / f"run {gain}", model, "--log", tmp_path / "log.npz", "--study", study)
        assert code == expected
    assert content["tests"][0]["quantity"] == "kp"


@pytest.mark.parametrize("axis", ["z", "y", (0.6, 0.0, 0.8)])
def test_numbers_of_a_study_by_commands_make_pendulums(axis: Axis, tmp_path: Path) -> None:
    """J q'' + f q' + G cos q + H sin q of each joint, whatever the file has; a delay, and offsets apart.

    identified_robot.yml has these numbers if gravity acts across the axis.
    """
    body = Body("shank", joints=(Joint("knee", axis, motor=Motor(9.0, -3.0)),), mass=5.0)
    file = Robot("leg", (replace(body, placement=Placement(rpy=(0.3, 0.0, 0.2))) if axis != "z" else body,))
    values = {"inertia": 0.02, "gravity.cos": 1.1, "gravity.sin": -0.7, "offset": 0.3, DELAY: 0.005}
    numbers = [
        FrictionNumber(term.name("knee"), term.symbol, "", "", value, 0.1, 0.0, 1.0, "")
        for path, value in values.items()
        if (term := RIGID_TERMS[path])
    ]
    joint = JointFriction("knee", False, friction=Friction(0.15), viscous=0.25, numbers=tuple(numbers))
    result = FrictionResult((joint,), (), "identified", "")
    assert command_delay(result) == 0.005
    assert rigid_numbers(result)["knee", "offset"] == 0.3
    robot = commanded_robot(file, result)
    assert robot.driven[0].motor.friction.coulomb == pytest.approx(0.05)
    if axis != "z":
        (tmp_path / "robot.yml").write_text(robot_of_friction("s", file, result))
        robot = load_robot(tmp_path / "robot.yml")
    model = formulate(without_friction(robot))
    q = np.linspace(-2, 2, 5)[:, None]
    still = np.zeros_like(q)
    rest = feed_forward(model, np.zeros(1), q, still, still)
    np.testing.assert_allclose(rest, 1.1 * np.cos(q) - 0.7 * np.sin(q), atol=1e-12)
    np.testing.assert_allclose(feed_forward(model, np.zeros(1), q, still, still + 1) - rest, 0.02, atol=1e-12)


def test_missing_gains_and_models_are_refused(tmp_path: Path) -> None:
    """Before anything is simulated."""
    model = tmp_path / "robot.yml"
    model.write_text(yaml_text(CommandedJoint().robot))
    n = 400
    signals = {"time": np.arange(n) / 200, "command": np.sin(np.arange(n) / 20), "position": np.sin(np.arange(n) / 20)}
    np.savez(tmp_path / "log.npz", **signals)
    assert predicted(tmp_path / "a", model, "--log", tmp_path / "log.npz")[0] == 2
    assert predicted(tmp_path / "b", tmp_path / "none.yml", "--log", tmp_path / "log.npz")[0] == 2
    assert predicted(tmp_path / "c", tmp_path, "--log", tmp_path / "log.npz")[0] == 2
    assert predicted(tmp_path / "d", model)[0] == 2
    two = ["--kp", "1,2", "--kd", "1"]
    assert predicted(tmp_path / "e", model, "--log", tmp_path / "log.npz", *two)[0] == 2


def test_robot_in_place_of_the_study_of_with_is_refused(tmp_path: Path) -> None:
    """The text of a URDF has no section of logs: exit code 2, and no internal error."""
    model = tmp_path / "leg.urdf"
    model.write_text(URDF.format(x=0.1, I=0.03))
    assert cli.run_command(["predict", str(model), "--with", str(tmp_path), "--log", str(model)]) == 2
