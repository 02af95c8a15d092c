"""A robot's file of bodies, Denavit-Hartenberg `links`, or a `urdf` (its keys decide which) -> Robot; and back."""

import io
import json
import os
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, TypeAlias

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.scalarstring import SingleQuotedScalarString

from elastid.base.errors import StudyError
from elastid.base.escape import comment_lines
from elastid.robot import Robot
from elastid.study.messages import Problem, make_error, validate
from elastid.study.source import YamlSource, read_source

# kp (N*m/rad) and kd (N*m*s/rad) of the position servos of joints by name, link side.
Servos: TypeAlias = Mapping[str, tuple[float, float]]
# Forms of a robot that are made into one, by a key that only they have.
_FORMS = {"links": "elastid.robot.denavit_hartenberg:DenavitHartenberg", "urdf": "elastid.robot.urdf:UrdfRobot"}
# Texts that readers of the older YAML 1.1 take for true and false.
_YAML_1_1_WORDS = ("yes", "no", "on", "off", "y", "n")


def load_robot(path: Path | str) -> Robot:
    """Read the robot of a YAML file; StudyError with a line `file:line:col: key: message` for each error."""
    path = Path(path)
    source = with_robot(read_robot(path), path.parent)
    robot = source.data["robot"]
    return robot if isinstance(robot, Robot) else _validate(source, Robot)


def read_robot(path: Path) -> YamlSource:
    """Read the file's content under the key `robot`, which the places of its keys do not show."""
    source = read_source(path, str(path), rank=1)
    if not isinstance(source.data, dict):
        raise StudyError("robot/file", "a robot is a mapping with the keys name and bodies", f"{path}:1:1")
    if "experiment" in source.data:
        text = "this is a study. Give its robot model (the file under `robot`), or its run folder"
        raise StudyError("robot/file", text, f"{path}:1:1")
    key_places = {
        ("robot", *keys): (replace(key, skipped_keys=1), replace(value, skipped_keys=1))
        for keys, (key, value) in source.places.items()
    }
    return YamlSource({"robot": source.data}, key_places, source.text)


def with_robot(source: YamlSource, folder: Path) -> YamlSource:
    """Make a Robot of `links` or a `urdf` under `robot`, paths from folder on; StudyError, a line for each error."""
    data = source.data.get("robot")
    forms = [] if not isinstance(data, dict) or "bodies" in data else [_FORMS[key] for key in _FORMS if key in data]
    if not forms:
        return source
    form = _validate(source, resolve_name(forms[0]))
    make = form.robot
    if "links" not in data:
        file = folder / form.urdf
        lines = file.read_text("utf-8", "replace").splitlines() if os.path.isfile(file) else []
        source = replace(source, text=source.text + "".join(comment_lines(line) for line in lines))
        make = partial(make, folder)
    try:
        return replace(source, data={**source.data, "robot": make()})
    except ValueError as error:
        raise make_error(source, [Problem(("robot",), str(error))]) from None


def _validate(source: YamlSource, kind: type) -> Any:
    value, problems = validate(source.data["robot"], kind)
    if problems:
        raise make_error(source, [replace(problem, path=("robot", *problem.path)) for problem in problems])
    return value


def yaml_text(value: Any, comments: tuple[str, ...] = ()) -> str:
    """Return YAML of a robot, of any section of a study, or of a mapping with such sections and plain data.

    In SI, keys at their defaults left out.  comments: lines at its head.
    """
    yaml = YAML()
    yaml.width = 100_000
    yaml.indent(mapping=2, sequence=4, offset=2)
    stream = io.StringIO()
    yaml.dump(_plain(value), stream)
    return "".join(comment_lines(line) for line in comments) + stream.getvalue()


def _plain(value: Any) -> Any:
    """Return mappings, lists, numbers and texts; a number keeps all its digits."""
    if is_dataclass(value):
        from elastid.store.kinds import text_of  # brings h5py

        return _plain(json.loads(text_of(value)))
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        inner = CommentedSeq(map(_plain, value))
        if all(not isinstance(entry, dict) for entry in inner):
            inner.fa.set_flow_style()
        return inner
    if isinstance(value, str) and value.lower() in _YAML_1_1_WORDS:
        return SingleQuotedScalarString(value)
    if isinstance(value, bool | int | str | None):
        return value
    return float(value)
