"""A fleet: one study over many robots and dates, from a YAML file or a table."""

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from elastid.base.errors import StudyError
from elastid.base.tables import read_table
from elastid.study.messages import Problem, make_error, validate
from elastid.study.sections import FleetSpec, MemberSpec
from elastid.study.source import read_source

# Columns of a table that are no keys of the study.
ROBOT, DATE = "robot", "date"


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
    def label(self) -> str:
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
    """Read a fleet of a YAML file; StudyError with a line for each error, and where a robot has one date twice."""
    source = read_source(path, str(path))
    if not isinstance(source.data, dict):
        text = "a fleet is a mapping with the keys name, study and members or table"
        raise StudyError("files/table", text, f"{path}:1:1")
    spec, problems = validate(source.data, FleetSpec)
    if problems:
        raise make_error(source, problems)
    study, key = path.parent / spec.study, "members" if spec.members else "table"
    for key, file in (("study", spec.study), ("table", spec.table)):
        if file is not None and not os.path.isfile(path.parent / file):
            raise make_error(source, [Problem((key,), f"no such file (looked for {path.parent / file})")])
    members = sorted(_members(spec, path), key=lambda member: (member.robot, member.date))
    names = Counter(member.label for member in members)
    if not members:
        raise make_error(source, [Problem((key,), "there are no members. Give a row for each")])
    if twice := [words for words, count in names.items() if count > 1]:
        text = f"{', '.join(twice)} {'occurs' if len(twice) == 1 else 'occur'} twice"
        raise make_error(source, [Problem((key,), f"{text}. Omit one, or correct its date")])
    return Fleet(spec.name, study, tuple(members), spec.false_discovery_rate)


def _members(spec: FleetSpec, path: Path) -> Iterator[Member]:
    for member in spec.members or _rows(path.parent / str(spec.table)):
        overrides = []
        for key, value in {**spec.set, **member.set}.items():
            text = value if isinstance(value, str) else repr(value)
            member_text = text.replace("{robot}", member.robot).replace("{date}", member.date)  # other braces stay
            overrides.append(f"{key}={member_text}")
        yield Member(member.robot, member.date, tuple(overrides))


def _rows(path: Path) -> Iterator[MemberSpec]:
    for line, row in read_table(path):
        if absent := [name for name in (ROBOT, DATE) if name not in row]:
            raise StudyError("files/table", f"column {absent[0]} is missing; columns: {', '.join(row)}", f"{path}:1:1")
        values = {key: value for key, value in row.items() if key not in (ROBOT, DATE) and value}
        try:
            yield MemberSpec(row[ROBOT], row[DATE], values)
        except ValueError as error:
            raise StudyError("files/table", str(error), f"{path}:{line}:1") from None
