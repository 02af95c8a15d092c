"""A CSV file of static load tests -> entries of `loads.tests`, with the line of each."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from elastid.base.errors import StudyError, did_you_mean
from elastid.base.tables import name_and_unit, read_table
from elastid.robot import Robot
from elastid.study.source import KeyPath, Place, YamlSource

# Columns of the entries of a key; those of one text or number are called as their key.
_ENTRIES: Mapping[str, tuple[str, ...]] = {
    "force": ("fx", "fy", "fz"), "torque": ("tx", "ty", "tz"), "along": ("along_x", "along_y", "along_z"),
    "deflection": ("x", "y", "z"), "std": ("std_x", "std_y", "std_z"),
}  # fmt: skip
_TEXTS = ("configuration", "frame", "measured_at")
_SINGLE = ("mass", "deflection", "std")  # deflections and their std also of dial gauges


def existing_file(key: str, path: Path, place: Place) -> Path:
    """Return a path that a study states under a key; StudyError if no file has it."""
    if not os.path.isfile(path):
        text = f"{key}: no such file (looked for {path}; the path is relative to the study)"
        raise StudyError("files/missing", text, place)
    return path


def with_load_file(source: YamlSource, folder: Path) -> YamlSource:
    """Read the study with tests of `loads.file` behind those that it lists; StudyError where the file is no table."""
    loads = source.data["loads"]
    place = source.place(("loads", "file"), of_value=True)
    path = existing_file("loads.file", folder / loads["file"], place)
    entries = loads.get("tests") or []
    if not isinstance(entries, list):
        return source
    tests = list(_tests(path, _joints(source.data.get("robot"))))
    places: dict[KeyPath, tuple[Place, Place]] = {
        ("loads", "tests", i): (place, place) for i, (place, _) in enumerate(tests, start=len(entries))
    }
    data = {**source.data, "loads": {**loads, "tests": [*entries, *(test for _, test in tests)]}}
    return YamlSource(data, {**source.places, **places}, source.text)


def _joints(robot: Any) -> tuple[str, ...]:
    if isinstance(robot, Robot):
        return robot.driven_names
    bodies = robot.get("bodies") if isinstance(robot, dict) else None
    joints = (j for b in bodies or [] if isinstance(b, dict) for j in b.get("joints") or [] if isinstance(j, dict))
    return tuple(str(joint.get("name")) for joint in joints if joint.get("motor") is not None)


def _tests(path: Path, joints: Sequence[str]) -> Iterator[tuple[Place, dict[str, Any]]]:
    for line, row in read_table(path):
        columns = [_column(f"{path}:1:1", head, joints) for head in row]
        cells = {
            column: f"{cell} {unit}".strip() if isinstance(_value(cell), float) else cell
            for cell, (column, unit) in zip(row.values(), columns, strict=True)
            if cell
        }
        yield Place(1, line, 1, str(path)), _test(cells, joints)


def _column(place: str, head: str, joints: Sequence[str]) -> tuple[str, str]:
    name, unit = name_and_unit(head)
    columns = [*_TEXTS, *_SINGLE, *(word for names in _ENTRIES.values() for word in names)]
    if name not in (*columns, *joints):
        text = f"a CSV file of load tests has no column '{name}'; {did_you_mean(name, [*columns, *joints])}"
        raise StudyError("files/table", text, place)
    return f"joint {name}" * (name in joints) or name, unit


def _test(cells: Mapping[str, str], joints: Sequence[str]) -> dict[str, Any]:
    test: dict[str, Any] = {key: cells[key] for key in _TEXTS if key in cells}
    test |= {key: _value(cells[key]) for key in _SINGLE if key in cells}
    angles = {} if "configuration" in test else {"angles": tuple(f"joint {name}" for name in joints)}
    for key, names in {**_ENTRIES, **angles}.items():
        if key not in test and any(name in cells for name in names):
            test[key] = [_value(cells.get(name, "0")) for name in names]
    return test


def _value(text: str) -> float | str:
    """Return a number of a cell without a unit; else the text, which the section reads or refuses."""
    try:
        return float(text)
    except ValueError:
        return text
