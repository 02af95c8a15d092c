"""Robots of MJCF files: against MuJoCo's own dynamics, and files that are refused."""

from pathlib import Path

import numpy as np
import pytest
from plants.mjcf_arm import ARM
from plants.refusals import refused

from elastid.app.from_robot import read_mjcf_servos
from elastid.app.mjcf_reader import robot_of
from elastid.app.scaffold import new_from_logs
from elastid.model.formulation import serial
from elastid.model.kinematics import frame_poses
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import Robot
from elastid.study import load
from elastid.study.robots import load_robot

mujoco = pytest.importorskip("mujoco", reason="mujoco is in the group oracles")
pytestmark = pytest.mark.oracle


ASSET, MESH = "<asset><mesh name='m' file='no.stl'/></asset>", "<geom type='mesh' mesh='m'/>"


def test_meshes_of_bodies_with_stated_inertia_need_no_files(tmp_path: Path) -> None:
    fore = '<body name="fore">'
    stated = ARM.replace(fore, f'{fore}<inertial mass="2" pos="0 0 0.1" diaginertia="1 1 1"/>')
    robots = []
    for text in (stated, stated.replace("<site", f"{MESH}<site").replace("<worldbody>", f"{ASSET}<worldbody>")):
        (tmp_path / "crane.xml").write_text(text)
        robots.append(read_mjcf_servos(tmp_path / "crane.xml")[0])
    assert robots[0] == robots[1]


def test_public_mjcf_materials_names_and_units_are_accepted(tmp_path: Path) -> None:
    """A material of a site; a site with the name of the trunk; a gear of 0.05 beside controls; a spring undamped."""
    text = ARM.replace("<site", '<site name="trunk" material="red"/><site').replace('name="a"', 'name="a" gear="0.05"')
    trunk = '<worldbody><body name="trunk"><geom size=".1"/></body>'
    assets = '<asset><texture name="t" type="2d" file="no.png"/><material name="red" texture="t"/></asset>'
    text = text.replace("<worldbody>", assets + trunk).replace(' damping="30"', "")
    (tmp_path / "crane.xml").write_text(text)
    robot = load_robot(new_from_logs(tmp_path / "new", [tmp_path / "crane.xml"]).parent / "robot.yml")
    assert [frame.name for frame in robot.frames] == ["trunk", "trunk 2", "tool"]
    x, *_ = robot.driven
    assert (x.motor.ratio, x.limits.torque) == (1.0, 0.05 * 7)
    assert next(joint for joint in robot.joints if joint.name == "bend").spring.damping > 0


def test_joints_of_a_log_are_named_and_servos_give_the_gains(tmp_path: Path) -> None:
    """Columns in alphabetical order, some with numbers in their names; servos without kv."""
    names, body = ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint"), ""
    for name in names[::-1]:
        inertial = '<inertial mass="1" pos="0 .1 .1" diaginertia=".1 .1 .1"/>'
        body = f'<body pos="0 0 .1">{inertial}<joint name="{name}" axis="0 1 0" armature=".1"/>{body}</body>'
    servos = "".join(f'<position joint="{name}" kp="{100 * i}"/>' for i, name in enumerate(names, start=1))
    mjcf = f"<mujoco><worldbody>{body}</worldbody><actuator>{servos}</actuator></mujoco>"
    (tmp_path / "arm.xml").write_text(mjcf)
    t, rng = np.arange(600) / 100, np.random.default_rng(0)
    commands = {name: np.convolve(rng.standard_normal(629), np.hanning(30), "valid") for name in sorted(names)}
    columns = {f"{name}_cmd": x for name, x in commands.items()}
    columns |= {f"{name}_pos": np.append(x[:3], x[:-3]) for name, x in commands.items()}
    heading = ",".join(["time", *columns])
    np.savetxt(tmp_path / "log.csv", np.stack([t, *columns.values()], 1), delimiter=",", header=heading, comments="")
    study = load(new_from_logs(tmp_path / "new", [tmp_path / "arm.xml", tmp_path / "log.csv"])).study
    recorded = study.experiment.recorded
    assert {channel.at: channel.channel for channel in recorded.channels if channel.role == "reference"} == {
        f"motor {name}": f"{name}_cmd" for name in names
    }
    gains = recorded.controller
    np.testing.assert_allclose(np.multiply(gains.position_gain, gains.velocity_gain), [100, 200, 300, 400])


def test_dynamics_are_those_of_mujoco(tmp_path: Path) -> None:
    """M and the torques of gravity and motion, armatures, spring and damping of the joints apart; places of a site."""
    path = tmp_path / "crane.xml"
    path.write_text(ARM)
    robot, _ = read_mjcf_servos(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_armature[:], model.dof_damping[:], model.jnt_stiffness[:] = 0, 0, 0
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    assert [joint.name for joint in robot.joints] == ["x", "turn", "bend", "lift"]
    assert [joint.name for joint in robot.driven] == ["x", "turn", "lift"]
    ours, theta = serial(robot), serial(robot).theta.copy()
    for i, name in enumerate(ours.parameters):  # the links alone
        theta[i] = 0.0 if name.startswith(("Jm_", "f_", "k_", "d_")) else theta[i]
    q, v, a = rng.normal(size=(3, 4))
    data.qpos[:], data.qvel[:], data.qacc[:] = q + model.qpos0, v, a
    mujoco.mj_inverse(model, data)
    expected = np.zeros((4, 4))
    mujoco.mj_fullM(model, data, expected) if _takes_data() else mujoco.mj_fullM(model, expected, data.qM)
    np.testing.assert_allclose(ours.mass(q, theta).full(), expected, atol=1e-10 * np.abs(expected).max())
    torque = inverse_dynamics(robot)(q, v, a, theta).full()[:, 0]
    np.testing.assert_allclose(torque, data.qfrc_inverse, atol=1e-9 * np.abs(data.qfrc_inverse).max())
    mujoco.mj_kinematics(model, data)
    pose = frame_poses(robot, q[None], "tool")
    np.testing.assert_allclose(pose.position[0], data.site("tool").xpos, atol=1e-12)
    np.testing.assert_allclose(pose.rotation[0].ravel(), data.site("tool").xmat, atol=1e-12)
    turn = robot.driven[1].motor
    assert turn.inertia * turn.ratio**2 == pytest.approx(12.0)
    assert turn.ratio == -60.0


def test_mjcf_damping_becomes_motor_friction_and_range_limits_torque() -> None:
    """Beside the armature, before the gear; a force's range, a control's where it is a force, and the joint's own."""
    robot = compiled(ARM.replace('armature="12"', 'armature="12" damping="7.2" stiffness="5"'))
    x, turn, _ = robot.driven
    assert (x.motor.viscous, turn.motor.viscous) == (4.0, pytest.approx(7.2 / 60**2))
    assert [joint.viscous for joint in robot.joints] == [0.0, 0.0, 0.0, 0.0]
    assert [joint.limits.torque for joint in robot.driven] == [7.0, 60 * 3.0, np.inf]
    robot = compiled(ARM.replace('axis="1 0.2 0"', 'axis="1 0.2 0" actuatorfrcrange="-5 5"').replace("-3 3", "-30 30"))
    assert [joint.limits.torque for joint in robot.driven] == [5.0, 60 * 0.5 * 8, np.inf]


@pytest.mark.parametrize("joint", ["", "<freejoint/>"])
def test_a_pedestal_and_a_trunk_that_floats_are_the_base(joint: str) -> None:
    """A body called `base`, as most arms of public collections have, turned and moved, with a camera's stand on it."""
    stand = '<body name="stand" pos="0 0 1"><geom size=".1"/></body>' * (not joint)
    at = f'<worldbody><body name="base" pos="1 2 3" euler="90 0 0">{joint}<geom size=".1"/>{stand}'
    text = ARM.replace("<worldbody>", at).replace("</worldbody>", "</body></worldbody>")
    robot, before, model = compiled(text), compiled(ARM), mujoco.MjModel.from_xml_string(text)
    assert [body.name for body in robot.bodies] == [body.name for body in before.bodies]
    assert [joint.motor for joint in robot.driven] == [joint.motor for joint in before.driven]
    assert [frame.name for frame in robot.frames if frame.body == "base"] == ["stand"] * (not joint)
    data = mujoco.MjData(model)
    data.qpos[-len(robot.joints) :] += (q := np.random.default_rng(1).normal(size=len(robot.joints)))
    mujoco.mj_kinematics(model, data)
    for frame in (frame.name for frame in robot.frames if frame.name != "stand"):
        np.testing.assert_allclose(frame_poses(robot, q[None], frame).position[0], data.site(frame).xpos, atol=1e-12)


def compiled(text: str) -> Robot:
    """The robot of an MJCF file in this process."""
    return robot_of(mujoco.MjModel.from_xml_string(text), "crane")


def _takes_data() -> bool:
    """From release 3.4 on mj_fullM takes the data."""
    return "data" in (mujoco.mj_fullM.__doc__ or "").partition("->")[0].lower().replace("mjdata", "data")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("</worldbody>", f"<body><joint name='z'/>{MESH}</body></worldbody>{ASSET}"), "no.stl"),
        (("<worldbody>", "<worldbody><body name='b'><joint type='ball'/><geom size='.1'/></body>"), "ball"),
        (("</worldbody>", ""), "XML"),
    ],
)
def test_a_file_that_is_no_robot_is_refused(change: tuple[str, str], says: str, tmp_path: Path) -> None:
    path = tmp_path / "crane.xml"
    path.write_text(ARM.replace(*change))
    with refused("robot/file", place="crane.xml", holds=says):
        read_mjcf_servos(path)
    assert [each.name for each in tmp_path.iterdir()] == ["crane.xml"]
