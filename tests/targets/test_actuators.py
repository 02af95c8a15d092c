"""Snippets for simulators, read by MuJoCo or by parsers of their languages: the numbers of the joints, link side."""

import ast
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import pytest
from ruamel.yaml import YAML

from elastid.fit.fitted_robot import FittedRobot
from elastid.friction_study.commanded import DELAY
from elastid.friction_study.result import RIGID_TERMS, FrictionNumber, FrictionResult, JointFriction
from elastid.robot import Body, Friction, Joint, Limits, Motor, Robot, Spring
from elastid.robot.friction import Directions
from elastid.robot.friction_numbers import TERMS
from elastid.targets.actuators import (
    actuators_of,
    fit_intervals,
    friction_intervals,
    with_total_inertias,
    write_actuators,
)

LAW = Friction(0.5, stiction=0.8, stribeck_velocity=2.0, directions=Directions(0.1))
KNEE = Joint(
    'kn"e.e', spring=Spring(3e4, 20.0, backlash=1e-3), viscous=0.3, limits=Limits(torque=90.0, velocity=4.0),
    motor=Motor(1e-3, -10.0, viscous=2e-3, friction=LAW),
)  # fmt: skip
RAIL = Joint("rail", axis="x", motion="translation", motor=Motor(0.02, 20.0, viscous=0.01, coulomb=0.2))
ROBOT = Robot("bench", (Body("slide", joints=(RAIL,), mass=4.0), Body("shank", "slide", joints=(KNEE,), mass=1.0)))
INTERVALS = {("rail", "viscous"): (3.5, 4.5), ("rail", "kp"): (90.0, 110.0)}


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """All snippets of two joints with gains and a delay of 12 ms."""
    gains = [(100.0, 8.0), (2000.0, 50.0)]
    actuators = actuators_of("bench", ROBOT, INTERVALS, gains, 0.012)
    return {path.name: path for path in write_actuators(tmp_path_factory.mktemp("actuators"), actuators)}


@pytest.mark.oracle("mujoco")
def test_mujoco_has_the_numbers_of_included_classes(files: dict[str, Path], tmp_path: Path) -> None:
    """Armature n^2 J_m, damping, frictionloss, stiffness of the gear, kp and kv of the servo."""
    import mujoco

    text = f"""<mujoco><include file="{files["mjcf.xml"]}"/><worldbody><body name="a">
      <joint name="rail" class="rail" type="slide"/><geom size=".1"/><body name="b">
      <joint name="knee" class="kn&quot;e.e"/><joint name="twist" class="kn&quot;e.e gear"/><geom size=".1"/></body>
      </body></worldbody><actuator><position joint="rail" class="rail"/><position joint="knee" class="kn&quot;e.e"/>
      </actuator></mujoco>"""
    (tmp_path / "model.xml").write_text(text)
    engine = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert engine.dof_armature == pytest.approx([8.0, 0.1, 0.0])
    assert engine.dof_damping.reshape(3, -1)[:, 0] == pytest.approx([4.0, 0.5, 20.0])
    assert engine.dof_frictionloss == pytest.approx([4.0, 5.0, 0.0])
    assert engine.jnt_stiffness.reshape(3, -1)[:, 0] == pytest.approx([0.0, 0.0, 3e4])
    assert engine.actuator_gainprm[:, 0] == pytest.approx([100.0, 2000.0])
    assert engine.actuator_biasprm[:, 2] == pytest.approx([-8.0, -50.0])


def test_isaac_lab_module_has_one_configuration_for_each_joint(
    files: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its names match a joint alone; a delay of 12 ms is 2 to 3 steps of 5 ms."""
    source = files["isaac_lab.py"].read_text(encoding="utf-8")
    ast.parse(source)
    monkeypatch.setitem(sys.modules, "isaaclab", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", SimpleNamespace(DelayedPDActuatorCfg=dict))
    content = {}
    exec(source, content)
    rail, knee = (content["ACTUATORS"][joint.name] for joint in (RAIL, KNEE))
    assert (rail["armature"], rail["viscous_friction"], rail["dynamic_friction"]) == (8.0, 4.0, 4.0)
    assert (knee["friction"], knee["dynamic_friction"], knee["stiffness"]) == (8.0, 5.0, 2000.0)
    assert (knee["min_delay"], knee["max_delay"], knee["effort_limit"], rail["effort_limit"]) == (2, 3, 90.0, None)
    (expression,) = knee["joint_names_expr"]
    assert re.fullmatch(expression, KNEE.name)
    assert not re.fullmatch(expression, KNEE.name.replace(".", "x"))


def test_xml_snippets_have_damping_friction_and_rotors(files: dict[str, Path]) -> None:
    """URDF and SDF link side; Drake the rotor on the motor side with its ratio, which has its sign."""
    urdf, sdf, drake = (ET.parse(files[name]).getroot() for name in ("urdf.xml", "sdf.xml", "drake.xml"))
    dynamics = [element.attrib for element in urdf.iter("dynamics")]
    assert [float(row["damping"]) for row in dynamics] == [4.0, 0.5]
    assert [float(row["friction"]) for row in dynamics] == [4.0, 5.0]
    assert [float(element.text or "") for element in sdf.iter("friction")] == [4.0, 5.0]
    tag = "{http://drake.mit.edu}"
    numbers = zip(drake.iter(f"{tag}rotor_inertia"), drake.iter(f"{tag}gear_ratio"), strict=True)
    assert [(float(J.attrib["value"]), float(n.attrib["value"])) for J, n in numbers] == [(0.02, 20.0), (1e-3, -10.0)]
    assert [float(e.attrib["p"]) for e in drake.iter(f"{tag}controller_gains")] == [100.0, 2000.0]
    for name in ("urdf.xml", "sdf.xml", "drake.xml", "mjcf.xml"):
        parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
        elements = ET.parse(files[name], parser).getroot().iter()
        assert any("3.5 to 4.5" in (element.text or "") for element in elements if element.tag is ET.Comment)


def test_ros_parameters_have_gains_and_limits(files: dict[str, Path]) -> None:
    content = YAML(typ="safe").load(files["ros2_control.yaml"])
    gains = content["joint_trajectory_controller"]["ros__parameters"]["gains"]
    assert gains == {"rail": {"p": 100.0, "i": 0.0, "d": 8.0}, KNEE.name: {"p": 2000.0, "i": 0.0, "d": 50.0}}
    assert content["joint_limits"][KNEE.name]["max_effort"] == 90.0


def test_readme_has_intervals_and_the_lost_parts(files: dict[str, Path]) -> None:
    """Of the joint with a Stribeck law by direction and a gap."""
    text = files["README.md"].read_text(encoding="utf-8")
    assert "| rail | viscous | 4 | N*s/m | 3.5 to 4.5 |" in text
    (lost,) = [line for line in text.splitlines() if line.startswith(f"- {KNEE.name}: ")]
    assert "backlash" in lost
    assert "direction" in lost


def test_intervals_of_a_fit_are_on_the_link_side(serial_model: FittedRobot) -> None:
    """Stiffness as in the fit; viscous friction of the motor times ratio^2, about the number of the snippet."""
    intervals = fit_intervals(serial_model, None)
    rows = {row.joint: row for row in actuators_of("arm", serial_model.robot, intervals).rows}
    known = {parameter.stands_for: parameter.name for parameter in serial_model.parameters if parameter.is_free}
    assert intervals
    for (joint, quantity), (low, high) in intervals.items():
        assert low <= getattr(rows[joint], quantity) <= high
        if quantity == "stiffness":
            assert (low, high) == pytest.approx(serial_model.result.interval(known[f"k_{joint}"]))


def test_intervals_of_a_friction_study_are_assigned_by_name() -> None:
    """Coulomb and viscous friction; no interval of a number for each direction. The delay is of all joints."""

    def number(path: str, mark: str = "") -> FrictionNumber:
        term = (TERMS | RIGID_TERMS)[path]
        return FrictionNumber(f"{term.name('rail')}{mark}", term.symbol, term.meaning, "N", 4.0, 0.1, 3.8, 4.2, "log")

    joint = JointFriction("rail", True, numbers=(number("coulomb", "+"), number("viscous"), number(DELAY)))
    result = FrictionResult((joint, JointFriction("knee", False)), (), "identified", "")
    ends = 3.8, 4.2
    assert friction_intervals(result) == {
        ("rail", "viscous"): ends, ("rail", "delay"): ends, ("knee", "delay"): ends,
    }  # fmt: skip


def test_total_inertia_of_a_joint_is_listed_as_lost(tmp_path: Path) -> None:
    """It contains the links, so it is no armature; a joint of the result without it has no such line."""
    term = RIGID_TERMS["inertia"]
    number = FrictionNumber(term.name("rail"), term.symbol, term.meaning, "kg", 12.5, 0.1, 12.3, 12.7, "log")
    result = FrictionResult((JointFriction("rail", True, numbers=(number,)),), (), "identified", "")
    actuators = with_total_inertias(actuators_of("bench", ROBOT, {}), result)
    assert [row.armature for row in actuators.rows] == [8.0, pytest.approx(0.1)]
    write_actuators(tmp_path, actuators)
    lines = [x for x in (tmp_path / "README.md").read_text().splitlines() if "total inertia" in x]
    assert len(lines) == 1
    assert "12.5 kg" in lines[0]
