"""A study file and the overrides of the command line -> a checked Study; all errors in one StudyError."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

from elastid.base.errors import StudyError
from elastid.base.escape import comment_lines, printable
from elastid.study.checks import check_lines, check_study
from elastid.study.messages import make_error, validate
from elastid.study.quantities import convert_to_si
from elastid.study.robots import read_robot, with_robot
from elastid.study.sections import Study
from elastid.study.source import KeyPath, Place, YamlSource, parse, read_source


@dataclass(frozen=True)
class LoadedStudy:
    """A study, the path of its file, and the text of the files and overrides that it was read from."""

    study: Study
    path: Path
    text: str
    overrides: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """The path and the study at a glance."""
        return f"{printable(str(self.path))}: {self.study!r}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(printable(str(self.path)))}</p>{self.study.display.html}"

    @property
    def base(self) -> Path:
        """The folder that paths in the study are relative to."""
        return self.path.parent


def load(path: Path | str, overrides: Sequence[str] = ()) -> LoadedStudy:
    """The study of a YAML file, `overrides`, each as 'key.path=value', taking the place of its keys.

    Raises StudyError with a line `file:line:col: key.path: message (got value)` for each error.
    """
    path = Path(path)
    overrides = (overrides,) if isinstance(overrides, str) else tuple(overrides)
    source, robot_errors = _read(path, overrides)
    study, problems = validate(source.data, Study)
    if problems or robot_errors:  # of a robot whose file cannot be read, the errors of that file alone count
        problems = [problem for problem in problems if not robot_errors or problem.path != ("robot",)]
        raise make_error(source, problems, robot_errors)
    study, unresolved = convert_to_si(study)
    problems = [*check_study(study, path.parent), *unresolved]
    if problems := problems or list(check_lines(study)):
        raise make_error(source, problems)
    return LoadedStudy(study, path, source.text, overrides)


def _read(path: Path, overrides: Sequence[str]) -> tuple[YamlSource, str]:
    """Study, robot and overrides as one source; and the errors of the robot's file."""
    source, robot_errors = read_source(path, str(path)), ""
    if source.data is None:
        raise StudyError(f"{path}:1:1: the file is empty; `elastid new DIR` writes a study to start from")
    if not isinstance(source.data, dict):
        raise StudyError(f"{path}:1:1: a study is a mapping with the keys name, robot, experiment ...")
    # `--set robot=other.yml` comes before that file is read, all other overrides reach into it.
    pairs = [_split(override) for override in overrides]
    for keys, value, option in pairs:
        if keys == ("robot",):
            source = _override(source, keys, value, option)
    robot = source.data.get("robot")
    folder = (path.parent / robot).parent if isinstance(robot, str) else path.parent
    try:
        source = _with_robot_file(source, path)
    except StudyError as error:
        robot_errors = str(error)
        source = replace(source, data={key: value for key, value in source.data.items() if key != "robot"})
    for keys, value, option in pairs:
        if keys != ("robot",):
            source = _override(source, keys, value, option)
    text = "".join([source.text, *(comment_lines(f"--set {override}", "# ") for override in overrides)])
    source = replace(source, text=text)
    try:
        return with_robot(source, folder), robot_errors
    except StudyError as error:
        return replace(source, data={key: value for key, value in source.data.items() if key != "robot"}), str(error)


def _with_robot_file(source: YamlSource, path: Path) -> YamlSource:
    """The content of the robot's file instead of its path."""
    robot = source.data.get("robot")
    if not isinstance(robot, str):
        return source
    file = path.parent / robot
    if not os.path.isfile(file):
        place = source.place(("robot",), of_value=True)
        raise StudyError(f"{place}: robot: no such file (looked for {file}; the path is relative to the study)")
    try:
        part = read_robot(file)
    except StudyError as error:
        place = source.place(("robot",), of_value=True)
        raise StudyError(f"{place}: robot: {file} is no robot:\n{error}") from None
    text = f"{source.text.rstrip()}\n\n{comment_lines(robot, '# ')}{part.text}"
    return YamlSource({**source.data, **part.data}, {**source.places, **part.places}, text)


def _split(override: str) -> tuple[KeyPath, YamlSource, str]:
    option = f"--set {override}"
    dotted, equals, text = override.partition("=")
    if not equals or not dotted.strip():
        raise StudyError(f"{option}: write --set key.path=value, for example --set fit.starts=5")
    try:
        value = parse(text, "value", rank=2)
    except StudyError as error:
        raise StudyError(f"{option}: {error}") from None
    keys = tuple(key.strip() for key in dotted.replace("[", ".").replace("]", "").split("."))
    return keys, value, option


def _override(source: YamlSource, keys: KeyPath, value: YamlSource, option: str) -> YamlSource:
    place = Place(2, 0, 0, option)
    data, path = _put(source.data, keys, value.data, option)
    unchanged = {known: places for known, places in source.places.items() if known[: len(path)] != path}
    added = {path[:i]: (place, place) for i in range(1, len(path) + 1) if path[:i] not in unchanged}
    below = {(*path, *keys_below): (place, place) for keys_below in value.places}
    return YamlSource(data, {**unchanged, **added, **below}, source.text)


def _put(data: Any, keys: KeyPath, value: Any, option: str) -> tuple[Any, KeyPath]:
    """A copy of the data with `value` at `keys`, and the keys as the data know them (numbers into lists)."""
    if not keys:
        return value, ()
    step, rest = keys[0], keys[1:]
    if isinstance(data, list):
        if not str(step).isdigit() or int(step) >= len(data):
            raise StudyError(f"{option}: '{step}' must be a number from 0 to {len(data) - 1}: here is a list")
        index = int(step)
        entry, path = _put(data[index], rest, value, option)
        return [*data[:index], entry, *data[index + 1 :]], (index, *path)
    mapping = data if isinstance(data, dict) else {}
    entry, path = _put(mapping.get(step), rest, value, option)
    return {**mapping, step: entry}, (step, *path)
