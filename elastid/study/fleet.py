"""A fleet: one study over many robots and dates, from a YAML file, a table, or the names of folders."""

from __future__ import annotations

import csv
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

from elastid.base.errors import StudyError
from elastid.base.names import FileName
from elastid.base.section import section
from elastid.study.messages import Problem, make_error, validate
from elastid.study.yaml_source import read_source

# Columns of a table that are no keys of the study.
ROBOT, DATE = "robot", "date"


@section
class MemberSpec:
    """One robot on one date.

    robot: its name. -- the serial number rather than a place in the hall, since trends follow it over the years.
    date: when it was measured, year-month-day. -- that of the measurement, not of the analysis; two dates of one robot
    make a trend, and three show whether it is steady.
    set: keys of the study that are its own, dotted. -- paths of logs above all, such as
    experiment.recorded.files.0.path; other keys only where this robot differs in fact.
    """

    robot: FileName
    date: str
    set: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse a date that is none."""
        try:
            date.fromisoformat(self.date)
        except ValueError:
            raise ValueError(f"date is '{self.date}'; write it as year-month-day, for example 2026-03-31") from None


@section
class FleetSpec:
    """One study over robots and dates.

    name: of the fleet. -- it names the run folder; a fleet that grows keeps its name, and only new members are run.
    study: path of the study that every member runs, relative to this file. -- one that runs well for a single member;
    keys that differ between members are overridden by `set`.
    members: listed here. -- for a few robots whose keys differ; a table is easier to keep from ten on.
    table: CSV file with columns robot, date and keys of the study, a row each member. -- where a spreadsheet or a data
    base lists the measurements: a column for each key that differs.
    folders: pattern of folders, a member each, such as logs/{robot}/{date}. -- where logs are filed by robot and date
    already; every folder that fits the pattern is a member.
    set: keys of the study for all members; {robot}, {date} and {folder} stand for those of the member. -- for what is
    common to all members and not to the study, such as fewer starts; with {folder} the paths of logs.
    false_discovery_rate: share of the differences and trends that are reported which may be chance. -- lower, 0.01,
    where each finding stops a robot; higher where looking is cheap. At 0.05 one finding in twenty may be chance.
    """

    name: FileName
    study: str
    members: tuple[MemberSpec, ...] = ()
    table: str | None = None
    folders: str | None = None
    set: dict[str, Any] = field(default_factory=dict)
    false_discovery_rate: float = 0.05

    def __post_init__(self) -> None:
        """One source of members, and a rate."""
        if sum(bool(source) for source in (self.members, self.table, self.folders)) != 1:
            raise ValueError("give the members by one of members, table and folders")
        if not 0 < self.false_discovery_rate < 1:
            raise ValueError(f"false_discovery_rate is {self.false_discovery_rate:g}; it lies between 0 and 1")


@dataclass(frozen=True)
class Member:
    """One robot on one date, with the overrides of its study as `key.path=value`."""

    robot: str
    date: str
    overrides: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of its run folder."""
        return f"{self.robot}_{self.date}"

    @property
    def words(self) -> str:
        """As messages name it."""
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
        raise StudyError(f"{path}:1:1: a fleet is a mapping with the keys name, study and members, table or folders")
    spec, found = validate(source.data, FleetSpec)
    if found:
        raise make_error(source, found)
    study = path.parent / spec.study
    if not os.path.isfile(study):
        raise make_error(source, [Problem(("study",), f"no such file (looked for {study})")])
    members = sorted(_members(spec, path), key=lambda member: (member.robot, member.date))
    if not members:
        raise StudyError(f"{path.parent / (spec.table or path.name)}: there are no members; give a row for each")
    names = Counter(member.words for member in members)
    if twice := [words for words, count in names.items() if count > 1]:
        raise StudyError(
            f"{path}: {', '.join(twice)} {'is' if len(twice) == 1 else 'are'} given twice; leave one out, or correct "
            "its date"
        )
    return Fleet(spec.name, study, tuple(members), spec.false_discovery_rate)


def _members(spec: FleetSpec, path: Path) -> Iterator[Member]:
    """All members, not in order."""
    for own in spec.members:
        yield _member(own, "", spec.set)
    if spec.table is not None:
        for own in _rows(path.parent / spec.table):
            yield _member(own, "", spec.set)
    if spec.folders is not None:
        found = [_member(own, folder, spec.set) for own, folder in _folders(spec.folders, path.parent)]
        if not found:
            raise StudyError(f"{path}: no folder is like {spec.folders} (below {path.parent}); correct the pattern")
        yield from found


def _member(own: MemberSpec, folder: str, shared: Mapping[str, Any]) -> Member:
    names = {"robot": own.robot, "date": own.date, "folder": folder}
    overrides = [f"{key}={_filled(value, names)}" for key, value in {**shared, **own.set}.items()]
    return Member(own.robot, own.date, tuple(overrides))


def _filled(value: Any, names: Mapping[str, str]) -> str:
    """A value of an override as text, with the member's names; other braces stay."""
    text = value if isinstance(value, str) else repr(value)
    return re.sub(r"\{(robot|date|folder)\}", lambda found: names[found[1]], text)


def _rows(path: Path) -> Iterator[MemberSpec]:
    """The rows of a table; StudyError with its line for one that is no member."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            missing = [name for name in (ROBOT, DATE) if name not in (rows.fieldnames or ())]
            if missing:
                raise StudyError(f"{path}:1:1: no column is called {missing[0]}; the first line names the columns")
            for row in rows:
                own = {key: value for key, value in row.items() if key not in (ROBOT, DATE) and value}
                try:
                    yield MemberSpec(str(row[ROBOT]).strip(), str(row[DATE]).strip(), own)
                except ValueError as error:
                    raise StudyError(f"{path}:{rows.line_num}:1: {error}") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StudyError(f"{path}: cannot be read as a table ({error})") from None


def _folders(pattern: str, base: Path) -> Iterator[tuple[MemberSpec, str]]:
    """Folders like a pattern, with the robot and date of their names; those whose date is none are left out."""
    glob = re.sub(r"\{\w+\}", "*", pattern)
    parts = re.split(r"\{(robot|date)\}", pattern)
    texts = [re.escape(part) if i % 2 == 0 else f"(?P<{part}>[^/]+)" for i, part in enumerate(parts)]
    for folder in sorted(base.glob(glob)):
        named = re.fullmatch("".join(texts), folder.relative_to(base).as_posix())
        if named is None or set(named.groupdict()) != {ROBOT, DATE}:
            continue
        try:
            yield MemberSpec(named[ROBOT], named[DATE]), folder.relative_to(base).as_posix()
        except ValueError:
            continue
