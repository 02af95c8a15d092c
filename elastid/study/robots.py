"""A robot's file in any of its forms -> Robot: bodies and joints, Denavit-Hartenberg parameters, or a URDF.

The keys `bodies`, `links` or `urdf` decide which.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from elastid.base.errors import StudyError
from elastid.base.escape import comment_lines
from elastid.robot import Robot
from elastid.robot.denavit_hartenberg import DenavitHartenberg
from elastid.robot.urdf import UrdfRobot
from elastid.study.messages import Problem, make_error, validate
from elastid.study.yaml_source import YamlSource, read_source


def load_robot(path: Path | str) -> Robot:
    """The robot of a YAML file; StudyError with a line `file:line:col: key: message` for each error."""
    path = Path(path)
    source = with_robot(read_robot(path), path.parent)
    robot = source.data["robot"]
    return robot if isinstance(robot, Robot) else _validated(source, Robot)


def read_robot(path: Path) -> YamlSource:
    """The file's content under the key `robot`, which the places of its keys do not show."""
    part = read_source(path, str(path), rank=1)
    if not isinstance(part.data, dict):
        raise StudyError(f"{path}:1:1: a robot is a mapping with the keys name and bodies")
    places = {
        ("robot", *keys): (replace(key, hidden=1), replace(value, hidden=1))
        for keys, (key, value) in part.places.items()
    }
    return YamlSource({"robot": part.data}, places, part.text)


def with_robot(source: YamlSource, folder: Path) -> YamlSource:
    """The same with a Robot under `robot` where that is given by links or a URDF; folder: paths start there.

    StudyError with a line for each error.
    """
    data = source.data.get("robot")
    if not isinstance(data, dict) or "bodies" in data:
        return source
    if "links" in data:
        make = _validated(source, DenavitHartenberg).robot
    elif "urdf" in data:
        rigid = _validated(source, UrdfRobot)
        file = folder / rigid.urdf
        lines = file.read_text("utf-8", "replace").splitlines() if os.path.isfile(file) else []
        source = replace(source, text=source.text + "".join(comment_lines(line, "# ") for line in lines))
        make = partial(rigid.robot, folder)
    else:
        return source
    try:
        return replace(source, data={**source.data, "robot": make()})
    except ValueError as error:
        raise make_error(source, [Problem(("robot",), str(error))]) from None


def _validated(source: YamlSource, kind: type) -> Any:
    value, found = validate(source.data["robot"], kind)
    if found:
        raise make_error(source, [replace(problem, path=("robot", *problem.path)) for problem in found])
    return value
