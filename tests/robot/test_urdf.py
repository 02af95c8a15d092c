"""Robots from URDF files: against pinocchio's own reader, and what cannot be read is refused with its line."""

from pathlib import Path

import numpy as np
import pytest
from plants.pinocchio_robot import assert_mass, assert_pose, mass_of, pin, point_inertia
from plants.refusals import refused
from ruamel.yaml import YAML

from elastid.model.formulation import serial
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import Robot
from elastid.study import load_robot

MOTOR = {"inertia": 1e-300}


def written(seed: int) -> tuple[str, list[str]]:
    """A random tree: turning, sliding and fixed links, some of the fixed ones without mass; names of what moves."""
    rng = np.random.default_rng(seed)
    parts, moving = ['<link name="world"/>'], []

    def text(numbers: np.ndarray) -> str:
        return " ".join(repr(float(number)) for number in numbers)

    for i in range(9):
        kind = ("revolute", "prismatic", "continuous", "fixed", "fixed")[rng.integers(5)] if i else "revolute"
        massless = kind == "fixed" and rng.random() < 0.5
        points, masses = rng.normal(size=(4, 3)), rng.uniform(1, 5, 4)
        points -= masses @ points / masses.sum()
        I = point_inertia(points, masses)  # noqa: E741
        inertial = (
            f'<inertial><origin xyz="{text(rng.normal(size=3))}" rpy="{text(rng.normal(size=3))}"/>'
            f'<mass value="{float(masses.sum())!r}"/><inertia ixx="{I[0, 0]}" ixy="{I[0, 1]}" ixz="{I[0, 2]}" '
            f'iyy="{I[1, 1]}" iyz="{I[1, 2]}" izz="{I[2, 2]}"/></inertial>'
        )
        parts.append(f'<link name="l{i}">{"" if massless else inertial}</link>')
        axis = rng.normal(size=3)
        limit = '<limit lower="-2" upper="1.5" velocity="3" effort="100"/>' if kind != "fixed" else ""
        parent = f"l{rng.integers(i)}" if i else "world"
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{text(rng.normal(size=3))}" rpy="{text(rng.normal(size=3))}"/>'
            f'<axis xyz="{text(axis / np.linalg.norm(axis))}"/>{limit}<dynamics damping="0.5"/></joint>'
        )
        moving += [f"j{i}"] if kind != "fixed" else []
    return "<robot name='random'>\n" + "\n".join(parts) + "\n</robot>\n", moving


def read(urdf: str, joints: dict[str, object], folder: Path, **more: object) -> Robot:
    (folder / "robot.urdf").write_text(urdf)
    YAML(typ="safe").dump({"urdf": "robot.urdf", "joints": joints, **more}, folder / "robot.yml")
    return load_robot(folder / "robot.yml")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.oracle("pinocchio")
def test_dynamics_and_frames_equal_those_of_pinocchios_reader(seed, tmp_path):
    """M, g and every link's place, fixed links with and without mass included."""
    urdf, moving = written(seed)
    robot = read(urdf, {name: {"motor": MOTOR, "viscous": 0} for name in moving}, tmp_path)
    reference = pin.buildModelFromXML(urdf)
    data = reference.createData()
    rng = np.random.default_rng(seed)
    n = len(robot.joints)
    assert reference.nv == n == len(moving)
    q, q_pin = rng.normal(size=n), pin.neutral(reference)
    order = []
    for joint, value in zip(robot.joints, q, strict=True):
        there = reference.joints[reference.getJointId(joint.name)]
        order.append(there.idx_v)
        q_pin[there.idx_q : there.idx_q + there.nq] = [value] if there.nq == 1 else [np.cos(value), np.sin(value)]
    M = mass_of(reference, data, q_pin)[np.ix_(order, order)]
    model = serial(robot)
    assert_mass(model, q, M)
    g = pin.computeGeneralizedGravity(reference, data, q_pin)[order]
    mine = inverse_dynamics(robot)(q, np.zeros(n), np.zeros(n), model.theta).full()[:, 0]
    np.testing.assert_allclose(mine, g, rtol=0, atol=1e-10 * max(np.abs(g).max(), 1))
    pin.framesForwardKinematics(reference, data, q_pin)
    for name in ["world", *(f"l{i}" for i in range(9))]:
        index = reference.getFrameId(name, pin.FrameType.BODY)
        assert_pose(robot, q, name, data.oMf[index])


ARM = """\
<robot name="arm">
  <link name="base_link"/>
  <link name="upper"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="tool0"/>
  <joint name="a1" type="revolute">
    <parent link="base_link"/><child link="upper"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" velocity="3" effort="40"/>
    <dynamics damping="0.7"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool0"/><origin xyz="0 0 0.4"/></joint>
</robot>
"""
BESIDE = {"a1": {"motor": {"inertia": 1e-3, "ratio": 80}, "spring": {"stiffness": "50 kN*m/rad"}}}


@pytest.mark.parametrize(
    ("old", "new", "place", "holds"),
    [
        ('type="revolute"', 'type="floating"', "robot.urdf:5", "floating"),
        ("<axis", '<mimic joint="x"/><axis', "robot.urdf:5", "a1"),
        ('<mass value="3"/>', '<mass value="0"/>', "robot.urdf:5", "a1"),
        ('<mass value="3"/>', "", "robot.urdf", "mass"),
        ('izz="1"', 'izz="9"', "robot.urdf:3", "upper"),
        ('ixx="1"', 'ixx="one"', "robot.urdf:3", "one"),
        ('lower="-1"', 'lower="3"', "robot.urdf:8", ("lower 3", "upper 2")),
        ('<child link="upper"/>', '<child link="lower"/>', "robot.urdf:6", "lower"),
        ('xyz="0 0 1"', 'xyz="0 0 0"', "robot.urdf:5", "axis"),
        ("</robot>", "", "robot.urdf:1", "XML"),
        ("<robot", "<!DOCTYPE a [<!ENTITY b 'c'>]><robot", "robot.urdf:1", "DOCTYPE"),
        ('name="a1"', 'name="a2"', "", ("robot.urdf", "a1", "a2")),
        ('<parent link="upper"/>', '<parent link="tool0"/>', "robot.urdf:11", "tool0"),
        ("<robot ", "<sdf ", "robot.urdf", ""),
    ],
)
def test_what_cannot_be_read_is_refused_with_file_and_line(old, new, place, holds, tmp_path):
    """Never a guess."""
    assert old in ARM
    with refused("robot/file", "robot/unknown-name", place=place, holds=holds):
        read(ARM.replace(old, new, 1), BESIDE, tmp_path)


def test_mimic_joint_is_fixed_and_zero_limits_are_none(tmp_path):
    """A finger at the flange with its own inertia adds a body, no joint."""
    finger = ARM.replace('lower="-1" upper="2"', 'lower="0" upper="0"').replace(
        '<joint name="flange" type="fixed">', '<joint name="flange" type="revolute"><mimic joint="a1"/>'
    )
    robot = read(finger, BESIDE, tmp_path)
    assert [(joint.name, joint.limits.angle) for joint in robot.joints] == [("a1", (-np.inf, np.inf))]
    assert [frame.name for frame in robot.frames] == ["base_link", "tool0"]


def test_base_body_is_frame_and_inertia_is_enlarged(tmp_path):
    """A pedestal with a mass and an impossible inertia bears nothing of the dynamics; 2.1 of 1 + 1 misses by 5 %."""
    bolts = '<joint name="bolts" type="fixed"><parent link="floor"/><child link="base_link"/></joint>'
    heavy = '<link name="base_link"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="9"/></inertial></link>'
    text = ARM.replace("</robot>", f'<link name="floor"/>{bolts}</robot>').replace('izz="1"', 'izz="2.1"')
    robot = read(text.replace('<link name="base_link"/>', heavy), BESIDE, tmp_path)
    assert [body.name for body in robot.bodies] == ["upper"]
    assert [frame.name for frame in robot.frames if frame.body == "base"] == ["floor", "base_link"]
    np.testing.assert_allclose(np.diag(robot.bodies[0].inertia_matrix), [1.05, 1.05, 2.1], atol=1e-12)


def test_unnamed_joints_beside_file_are_refused(tmp_path):
    """A joint without motor and spring would swing freely."""
    with refused("robot/file", place="robot.urdf:5", holds="a1"):
        read(ARM, {}, tmp_path)


def test_missing_file_is_sought_beside_robot_file(tmp_path):
    YAML(typ="safe").dump({"urdf": "no.urdf", "joints": {}}, tmp_path / "robot.yml")
    with refused("study/invalid", holds="no.urdf"):
        load_robot(tmp_path / "robot.yml")


def test_study_reads_rigid_part_from_urdf(tmp_path):
    """Paths count from the robot's file, overrides reach into it, and the study's text holds the URDF."""
    from elastid.study import load

    (tmp_path / "robots").mkdir()
    read(ARM, BESIDE, tmp_path / "robots")
    study = tmp_path / "study.yml"
    study.write_text(
        "name: x\nrobot: robots/robot.yml\nexcitation: {rate_hz: 500, period: 2, band_hz: [2, 50], torque_rms: 1}\n"
        "experiment: {configurations: {c: [0.1]}, simulated: {}}\n"
    )
    loaded = load(study, ["robot.joints.a1.spring.stiffness=7e4"])
    assert loaded.study.robot.joints[0].spring.stiffness == 7e4
    assert '# <robot name="arm">' in loaded.text
    beside = tmp_path / "robots" / "robot.yml"
    beside.write_text(beside.read_text().replace("stiffness", "stifness"))
    with refused("study/invalid", holds=("robot.yml", "joints.a1.spring.stifness")):
        load(study)
