"""A robot's file in any of its forms -> Robot: bodies and joints, Denavit-Hartenberg parameters, or a URDF.

Which one it is shows in its keys: `bodies`, `links` or `urdf`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from elastid.base.errors import StudyError
from elastid.robot import Robot
from elastid.robot.denavit_hartenberg import DenavitHartenberg
from elastid.robot.urdf import UrdfRobot
from elastid.study.messages import Problem, booleans, problems, study_error
from elastid.study.yaml_source import YamlSource, read_source


def load_robot(path: Path) -> Robot:
    """The robot of a YAML file; StudyError with a line `file:line:col: key: message` for each thing that is wrong."""
    source = robot_file(path)
    converted = with_robot_value(source, path.parent).data["robot"]
    robot: Robot = converted if isinstance(converted, Robot) else _validated(source, Robot)
    return robot


def robot_file(path: Path) -> YamlSource:
    """The file's content under the key `robot`, which the places of its keys do not show."""
    part = read_source(path, str(path), rank=1)
    if not isinstance(part.data, dict):
        raise StudyError(f"{path}:1:1: a robot is a mapping with the keys name and bodies")
    places = {
        ("robot", *keys): (replace(key, hidden=1), replace(value, hidden=1))
        for keys, (key, value) in part.places.items()
    }
    return YamlSource({"robot": part.data}, places, part.text)


def with_robot_value(source: YamlSource, folder: Path) -> YamlSource:
    """The same with a Robot under `robot` where that has another form than its bodies; folder: paths start there.

    StudyError for each thing that is wrong with it.
    """
    data = source.data.get("robot")
    if not isinstance(data, dict) or "bodies" in data:
        return source
    make: Callable[[], Robot]
    if "links" in data:
        table: DenavitHartenberg = _validated(source, DenavitHartenberg)
        make = table.robot
    elif "urdf" in data:
        beside: UrdfRobot = _validated(source, UrdfRobot)
        text = (folder / beside.urdf).read_text("utf-8", "replace") if (folder / beside.urdf).is_file() else ""
        source = replace(source, text=source.text + "".join(f"# {line}\n" for line in text.splitlines()))

        def make() -> Robot:
            return beside.robot(folder)
    else:
        return source
    try:
        return replace(source, data={**source.data, "robot": make()})
    except ValueError as error:
        raise study_error(source, [Problem(("robot",), str(error))]) from None


def _validated(source: YamlSource, kind: type) -> Any:
    data = source.data["robot"]
    value: Any = None
    try:
        value = TypeAdapter(kind).validate_python(data)
        found = booleans(data, kind)
    except ValidationError as error:
        found = problems(error.errors(include_url=False), kind, data) + booleans(data, kind)
    if found:
        raise study_error(source, [replace(problem, path=("robot", *problem.path)) for problem in found])
    return value
