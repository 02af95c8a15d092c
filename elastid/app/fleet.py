"""fleet: one study over robots and dates -> a run folder each, fleet.parquet, and a page of what differs and drifts.

Members are independent tasks, on the cores of this machine or on a Dask cluster. What is finished is kept: a fleet that
was interrupted goes on, and a worker that dies costs the member that it was at.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.base.errors import ElastidError
from elastid.base.execution import unordered
from elastid.report.page.page_of_fleet import FleetContent, Outcome, write_page_of_fleet
from elastid.store import replacing, text_file
from elastid.study import load
from elastid.study.fleet import Fleet, Member
from elastid.validation.fleet import FleetValue, find_changes

MEMBERS = "members"
# Rounds in which workers may die, as long as each finishes some member.
MAX_ROUNDS = 20


@dataclass(frozen=True)
class FleetRow:
    """A parameter of a member, with its 95 % interval; std and interval None where it was held."""

    robot: str
    date: str
    status: str
    parameter: str
    unit: str
    value: float
    std: float | None
    low: float | None
    high: float | None


def run_fleet(fleet: Fleet, folder: Path, jobs: int, console: Console) -> Path:
    """All members, then fleet.parquet (fleet.csv without pyarrow) and fleet.html; the path of the page.

    Raises StudyError where the study of a member is wrong, and ElastidError where no member could be identified.
    """
    for member in fleet.members:  # a wrong override is told before hours of work
        load(fleet.study, member.overrides)
    outcomes = _outcomes(fleet, folder, jobs, console)
    rows = [row for member in fleet.members for row in _rows(folder, member)]
    if not rows:
        raise ElastidError(f"fleet {fleet.name}: no member was identified; {outcomes[0].robot}: {outcomes[0].message}")
    table = _write_table(folder, rows)
    values = _values(rows)
    findings = find_changes(values, fleet.false_discovery_rate)
    units = {row.parameter: row.unit for row in rows}
    content = FleetContent(fleet.name, values, units, findings, outcomes, fleet.false_discovery_rate)
    page = write_page_of_fleet(content, folder)
    console.say(f"fleet: {content.verdict}")
    for path in (table, page):
        console.say(str(path))
    return page


def _outcomes(fleet: Fleet, folder: Path, jobs: int, console: Console) -> tuple[Outcome, ...]:
    """How each member ended; those whose worker died are tried again while others get done."""
    work = partial(_identified, fleet.study, folder)
    done: dict[str, Outcome] = {}
    for _ in range(MAX_ROUNDS):
        todo = [member for member in fleet.members if member.name not in done]
        before = len(done)
        try:
            with console.progress(f"fleet of {len(fleet.members)}") as progress:
                for index, outcome in unordered(work, todo, jobs, progress):
                    done[todo[index].name] = outcome
        except ElastidError as error:
            if len(done) == before:
                raise
            console.warn(f"fleet: {error}; {len(fleet.members) - len(done)} members are tried again")
        else:
            break
    return tuple(done[member.name] for member in fleet.members)


def _identified(study: Path, folder: Path, member: Member) -> Outcome:
    """The stages of a member's study that are not current, in its own folder, and how it ended."""
    run = Run(load(study, member.overrides), folder / MEMBERS / member.name, 1, Console(-2))
    try:
        run_all(run)
    except ElastidError as error:
        return Outcome(member.robot, member.date, _status(run.folder) or "failed", str(error))
    return Outcome(member.robot, member.date, _status(run.folder), "")


def _summary(folder: Path) -> dict[str, Any]:
    path = folder / "summary.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return found


def _status(folder: Path) -> str:
    return str(_summary(folder).get("status", ""))


def _rows(folder: Path, member: Member) -> Iterator[FleetRow]:
    """The parameters in the summary of a member; none where it failed."""
    summary = _summary(folder / MEMBERS / member.name)
    for name, found in summary.get("parameters", {}).items():
        low, high = found.get("interval95") or (None, None)
        yield FleetRow(
            member.robot, member.date, str(summary["status"]), name, found["unit"], found["value"], found.get("std"),
            low, high,
        )  # fmt: skip


def _values(rows: Sequence[FleetRow]) -> tuple[FleetValue, ...]:
    """Numbers that were identified, their dates as days."""
    return tuple(
        FleetValue(row.robot, float(date.fromisoformat(row.date).toordinal()), row.parameter, row.value, row.std)
        for row in rows
        if row.std is not None
    )


def _write_table(folder: Path, rows: Sequence[FleetRow]) -> Path:
    """fleet.parquet, a row each parameter of each member; fleet.csv where no reader of Parquet is installed."""
    columns = list(asdict(rows[0]))
    if find_spec("pyarrow") is None:
        path = folder / "fleet.csv"
        with text_file(path) as file:
            csv.writer(file, lineterminator="\n").writerows([columns, *([*asdict(row).values()] for row in rows)])
        return path
    import pyarrow
    import pyarrow.parquet

    path = folder / "fleet.parquet"
    table = pyarrow.table({name: [getattr(row, name) for row in rows] for name in columns})
    with replacing(path) as temporary:
        pyarrow.parquet.write_table(table, temporary)
    return path
