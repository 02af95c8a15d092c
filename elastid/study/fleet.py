"""A fleet: one study over many robots and dates, from a YAML file, a table, or the names of folders."""

from __future__ import annotations

import csv
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from elastid.base.errors import StudyError
from elastid.study.messages import Problem, make_error, validate
from elastid.study.sections import FleetSpec, MemberSpec
from elastid.study.source import read_source

# Columns of a table that are no keys of the study.
ROBOT, DATE = "robot", "date"
_NO_FOLDER = (
    "no folder below {} is like that with a date as 2026-03-31 in its name; correct the pattern, or name robot and "
    "date of each folder in a table"
)


@dataclass(frozen=True)
class Member:
    """One robot on one date, with the overrides of its study as `key.path=value`."""

    robot: str
    date: str
    overrides: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name of the run folder."""
        return f"{self.robot}_{self.date}"

    @property
    def words(self) -> str:
        """Name as messages have it."""
        return f"{self.robot} on {self.date}"


@dataclass(frozen=True)
class Fleet:
    """The members in the order of robots and dates, and the study that all of them run."""

    name: str
    study: Path
    members: tuple[Member, ...]
    false_discovery_rate: float


def load_fleet(path: Path) -> Fleet:
    """A fleet of a YAML file; StudyError with a line for each error, and where a robot has one date twice."""
    source = read_source(path, str(path))
    if not isinstance(source.data, dict):
        raise StudyError(
            "files/table", "a fleet is a mapping with the keys name, study and members, table or folders", f"{path}:1:1"
        )
    spec, problems = validate(source.data, FleetSpec)
    if problems:
        raise make_error(source, problems)
    study, by = path.parent / spec.study, next(key for key in ("members", "table", "folders") if getattr(spec, key))
    for key, file in (("study", spec.study), ("table", spec.table)):
        if file is not None and not os.path.isfile(path.parent / file):
            raise make_error(source, [Problem((key,), f"no such file (looked for {path.parent / file})")])
    members = sorted(_members(spec, path), key=lambda member: (member.robot, member.date))
    names = Counter(member.words for member in members)
    if not members and spec.folders:
        raise make_error(source, [Problem((by,), _NO_FOLDER.format(path.parent))])
    if not members:
        raise make_error(source, [Problem((by,), "there are no members; give a row for each")])
    if twice := [words for words, count in names.items() if count > 1]:
        given = f"{', '.join(twice)} {'is' if len(twice) == 1 else 'are'} given twice"
        raise make_error(source, [Problem((by,), f"{given}; leave one out, or correct its date")])
    return Fleet(spec.name, study, tuple(members), spec.false_discovery_rate)


def _members(spec: FleetSpec, path: Path) -> Iterator[Member]:
    for own in spec.members:
        yield _member(own, "", spec.set)
    if spec.table is not None:
        for own in _rows(path.parent / spec.table):
            yield _member(own, "", spec.set)
    if spec.folders is not None:
        for own, folder in _folders(spec.folders, path.parent):
            yield _member(own, folder, spec.set)


def _member(own: MemberSpec, folder: str, shared: Mapping[str, Any]) -> Member:
    names = {"robot": own.robot, "date": own.date, "folder": folder}
    overrides = []
    for key, value in {**shared, **own.set}.items():
        text = value if isinstance(value, str) else repr(value)
        filled = re.sub(r"\{(robot|date|folder)\}", lambda match: names[match[1]], text)  # other braces stay
        overrides.append(f"{key}={filled}")
    return Member(own.robot, own.date, tuple(overrides))


def _rows(path: Path) -> Iterator[MemberSpec]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            missing = [name for name in (ROBOT, DATE) if name not in (rows.fieldnames or ())]
            if missing:
                text = "the first line names the columns, with commas between them"
                raise StudyError("files/table", f"no column is called {missing[0]}; {text}", f"{path}:1:1")
            for row in rows:
                if None in row:
                    raise StudyError(
                        "files/table", "it has more values than the first line has names", f"{path}:{rows.line_num}:1"
                    )
                own = {key: value for key, value in row.items() if key not in (ROBOT, DATE) and value}
                try:
                    yield MemberSpec(str(row[ROBOT]).strip(), str(row[DATE]).strip(), own)
                except ValueError as error:
                    raise StudyError("files/table", str(error), f"{path}:{rows.line_num}:1") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StudyError("files/table", f"cannot be read as a table ({error})", f"{path}:1:1") from None


def _folders(pattern: str, base: Path) -> Iterator[tuple[MemberSpec, str]]:
    """Folders like a pattern, with the robot and date of their names; those whose date is none are left out."""
    glob = re.sub(r"\{\w+\}", "*", pattern)
    parts = re.split(r"\{(robot|date)\}", pattern)
    texts = [_expression(part) if i % 2 == 0 else f"(?P<{part}>[^/]+)" for i, part in enumerate(parts)]
    for folder in sorted(place for place in base.glob(glob) if place.is_dir()):
        path = folder.relative_to(base)
        named = re.fullmatch("".join(texts), path.as_posix())
        names = _names(path) | (named.groupdict() if named else {})
        try:
            yield MemberSpec(names[ROBOT], names[DATE]), path.as_posix()
        except (ValueError, KeyError):
            continue


def _expression(part: str) -> str:
    """The regular expression of the part of a pattern between its names."""
    return re.escape(part).replace(r"\*", "[^/]*").replace(r"\?", "[^/]")


def _names(folder: Path) -> dict[str, str]:
    """The date in the name of a folder, and the robot in the rest of it, or in the name of the folder above."""
    named = re.search(r"(\d{4})-?(\d{2})-?(\d{2})", folder.name)
    if named is None:
        return {}
    rest = folder.name.replace(named[0], "").strip("_-. ")
    return {DATE: "-".join(named.groups()), ROBOT: rest or folder.parent.name}
