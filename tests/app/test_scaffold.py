"""`elastid new --from robot.urdf`: a study that checks, guesses by the inertia, and faults by their line."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants import arm
from plants.refusals import refused

from elastid.app.cli import run_command
from elastid.app.from_robot import from_robot
from elastid.app.scaffold import new_from_logs
from elastid.robot import Limits
from elastid.robot.gears import GearCoupling
from elastid.study import load
from elastid.study.robots import yaml_text
from tests.robot.test_urdf import written

ARM = """<robot name="two \\n#link arm">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 0.4"/><mass value="40"/>
  <inertia ixx="3" iyy="3" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.3 0 0"/><mass value="25"/>
  <inertia ixx="0.3" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="1.5" velocity="3" effort="900"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.8"/>
  <axis xyz="0 1 0"/></joint>
</robot>
"""


def made(urdf: str, folder: Path) -> int:
    (folder / "arm.urdf").write_text(urdf)
    return run_command(["new", str(folder / "new"), "--from", str(folder / "arm.urdf")])


def test_gears_are_guessed_by_the_inertia_that_they_drive(tmp_path: Path) -> None:
    """Of the last joint it does not depend on the posture: I + m c^2."""
    assert made(ARM, tmp_path) == 0
    assert run_command(["check", str(tmp_path / "new" / "study.yml")]) == 0
    study = load(tmp_path / "new" / "study.yml").study
    elbow = study.robot.driven[1]
    inertia = 1.0 + 25 * 0.3**2
    assert elbow.spring.stiffness == pytest.approx(inertia * (2 * math.pi * 15) ** 2, rel=0.05)
    assert elbow.motor.inertia * elbow.motor.ratio**2 == pytest.approx(inertia, rel=0.05)
    assert all(-2 < angles[0] < 1.5 for angles in study.experiment.configurations.values())
    assert study.excitation.torque_rms[0] <= 0.2 * 900
    assert [*study.fit.parameters] == ["k_*", "d_*", "fm_*"]


@pytest.mark.parametrize("seed", [0, 3])
def test_a_study_of_any_tree_checks(seed: int, tmp_path: Path) -> None:
    urdf, moving = written(seed)
    assert made(urdf, tmp_path) == 0
    assert run_command(["check", str(tmp_path / "new" / "study.yml")]) == 0
    assert {joint.name for joint in load(tmp_path / "new" / "study.yml").study.robot.driven} == {*moving}


def test_a_robot_without_springs_has_a_study_of_its_motors(tmp_path: Path) -> None:
    (tmp_path / "arm.yml").write_text(yaml_text(arm.robot(damping=None)))
    study = new_from_logs(tmp_path / "new", [tmp_path / "arm.yml"])
    assert run_command(["check", str(study)]) == 0
    assert [*load(study).study.fit.parameters] == ["fm_*"]


def test_a_file_that_is_no_robot_leaves_no_study(tmp_path: Path) -> None:
    assert made(ARM.replace('type="continuous"', 'type="floating"'), tmp_path) == 2
    assert not (tmp_path / "new").exists()


def test_joint_without_link_inertia_is_refused_at_its_row(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    inertia = '<inertia ixx="{0}" iyy="{0}" izz="{0}"/>'
    link = '<link name="{1}"><inertial><mass value="0.2"/>' + inertia + "</inertial></link>\n"
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/></joint>\n'
    links = '<link name="base"/>\n' + link.format(0.1, "arm") + link.format(0, "flange")
    joints = joint.format(1, "base", "arm") + joint.format(2, "arm", "flange")
    path.write_text('<robot name="two">\n' + links + joints + "</robot>")
    with refused("robot/file", place="arm.urdf:6"):
        from_robot(path)


@pytest.mark.parametrize(("share", "limit"), [(0.0, 500.0), (-1.5, 700.0)])
def test_gravity_takes_half_of_no_torque_limit_in_drafted_postures(tmp_path: Path, share: float, limit: float) -> None:
    """An arm that its motors hold stretched out with 343 of 500 Nm would have no torque left to be excited.

    share: turns of the second motor's gear per turn of the first joint.
    """
    robot = arm.robot(limits=(Limits((-2.5, 2.5), torque=limit),) * 2)
    gears = (GearCoupling("2", "1", share * arm.RATIO),) if share else ()
    (tmp_path / "arm.yml").write_text(yaml_text(replace(robot, gears=gears)))
    study = load(new_from_logs(tmp_path / "new", [tmp_path / "arm.yml"])).study
    first, second = np.array(list(study.experiment.configurations.values())).T
    # Moments about the joints with both links in a vertical plane, at the shafts.
    of_fore = arm.MASS[1] * arm.OFFSET[1] * np.cos(first + second)
    of_both = (arm.MASS[0] * arm.OFFSET[0] + arm.MASS[1] * arm.LENGTH) * np.cos(first) + of_fore
    of_both -= share * of_fore
    assert len(first) == 5
    assert np.max(np.abs([of_fore, of_both])) * arm.GRAVITY < limit / 2
