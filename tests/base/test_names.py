"""A name is one line of printable characters wherever it is given, and stands for itself before it is a pattern."""

from pathlib import Path

import pytest
from plants.hostile_names import REFUSED
from plants.refusals import refused

from elastid.base.names import NameRule
from elastid.robot import Body, Frame, Joint, Motor, Robot, Spring
from elastid.study import load, load_robot

URDF = """<robot name="r"><link name="foot"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="continuous"><parent link="foot"/><child link="arm"/></joint></robot>"""


def quoted(name: str) -> str:
    """A name as a text of YAML in double quotes."""
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in name) + '"'


def robot_called(joint: str, body: str = "arm") -> Robot:
    return Robot("r", (Body(body, joints=(Joint(joint, spring=Spring(1e3), motor=Motor(1.0, 1.0)),), inertia=1.0),))


@pytest.mark.parametrize("name", REFUSED)
def test_anything_else_is_refused_in_python(name: str) -> None:
    for make in (robot_called, lambda text: robot_called("1", text), lambda text: Frame(text, "arm")):
        with pytest.raises(ValueError, match=r"name: the name "):
            make(name)


@pytest.mark.parametrize("name", ["&#10;", "&#9;", " x", "", "a@b", "&#x202e;"])
def test_it_is_refused_with_its_line_in_a_urdf(tmp_path: Path, name: str) -> None:
    (tmp_path / "r.urdf").write_text(URDF.format(joint=name), encoding="utf-8")
    (tmp_path / "r.yml").write_text("urdf: r.urdf\njoints: {'1': {motor: {inertia: 1, ratio: 1}}}\n")
    with refused("robot/file"):
        load_robot(tmp_path / "r.yml")


@pytest.mark.parametrize("name", [*REFUSED[:3], "../x", "a/b", "C:\\x", "CON", "x.", ".x", "é" * 101, "轴" * 70])
def test_what_no_folder_can_be_called_is_refused(tiny: Path, name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        NameRule(is_file=True).check(name)
    tiny.write_text(tiny.read_text().replace("    a: [0]", f"    {quoted(name)}: [0]"), encoding="utf-8")
    with refused("study/invalid"):
        load(tiny)


@pytest.mark.parametrize(
    "option",
    [
        "experiment.configurations={a: [0], A: [0]}",
        "robot.bodies.0.name=base",
        "robot.bodies.0.name=Base",
        "robot.frames=[{name: t, body: load}, {name: T, body: load}]",
    ],
)
def test_names_of_one_list_differ_in_more_than_case(tiny: Path, option: str) -> None:
    with refused("study/invalid"):
        load(tiny, [option])
