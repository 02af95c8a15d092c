"""`elastid fleet`: one study for many robots and dates -> run folders, fleet.parquet, a page of differences and drifts.

Members are independent tasks on this machine or on a Dask cluster. Finished members are kept; if a worker dies, only
its present member is repeated.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from elastid.app.console import Console
from elastid.app.run import Run, open_run_folder, run_all, software
from elastid.base.errors import ElastidError, FitError, MisfitError, StudyError
from elastid.base.execution import map_isolated
from elastid.base.files import path_below, replacing
from elastid.base.statistics import ONE_SIDED_95
from elastid.report.fleet import Outcome, answer_of_fleet, drawings_of_fleet
from elastid.report.page.page import write_page
from elastid.report.page.page_of_use import html_of_answer
from elastid.store.files import changed_texts, save_checksums, write_rows
from elastid.study import load
from elastid.study.fleet import Fleet, Member
from elastid.study.source import first_of
from elastid.validation.fleet import FleetValue, find_changes

MEMBERS = "members"
FLEET_FILES = ("fleet.parquet", "fleet.csv", "fleet.html", "figures")  # next to the folder of the members
# Statuses of members whose parameters are compared, of studies of elasticity and of friction.
COMPARED = ("converged", "noise_unknown", "at_bound", "identified", "partly")

# Parameter of a member with its 95 % interval; std, low and high are None if it was fixed.  std_noise: contribution of
# noise, since all members have the same errors of the robot model.
Row: TypeAlias = dict[str, Any]


def run_fleet(fleet: Fleet, folder: Path, jobs: int, console: Console) -> Path:
    """Run all members, then write fleet.parquet (fleet.csv without pyarrow), fleet.html and run.log; return the page.

    Raises StudyError if the study of a member is invalid. After all files are written, raises FitError if members
    failed and MisfitError if members are misfits.
    """
    _check(fleet, folder)
    with open_run_folder(folder, jobs, console):
        for name in changed_texts(folder, FLEET_FILES):
            console.warn(f"{folder / name} was modified after it was written and is made again")
        outcomes = _outcomes(fleet, folder, jobs, console)
        ends = zip(fleet.members, outcomes, strict=True)
        rows = [row for member, outcome in ends if not outcome.failed for row in rows_of(folder, member)]
        if not rows:
            text = f"no member was identified: {first_of(_reasons(outcomes))}"
            raise FitError("fleet/members", text, f"fleet {fleet.name}")
        table, values = _write_table(folder, rows), _values(rows)
        findings = find_changes(values, fleet.false_discovery_rate)
        units = {row["parameter"]: row["unit"] for row in rows}
        answer = answer_of_fleet(fleet.name, findings, outcomes, fleet.false_discovery_rate)
        html = partial(html_of_answer, answer, software())
        page = write_page(html, drawings_of_fleet(values, units, findings), folder, ("png",), name="fleet.html")
        save_checksums(folder, FLEET_FILES)
        for line in (*(f"fleet: {line}" for line in answer.sentences), str(table), str(page)):
            console.say(line)
        failures = [outcome for outcome in outcomes if outcome.failed or outcome.status not in (*COMPARED, "misfit")]
        misfits = [outcome for outcome in outcomes if outcome.status == "misfit"]
        for kind, members, error in (("failed", failures, FitError), ("are misfits", misfits, MisfitError)):
            if members:
                text = f"{len(members)} of {len(outcomes)} members {kind} and are excluded from the comparison"
                raise error("fleet/members", f"{text}: {first_of(_reasons(members))}", f"fleet {fleet.name}")
        return page


def _check(fleet: Fleet, folder: Path) -> None:
    """Raise StudyError for invalid overrides, and ElastidError for a folder that is not writable, before all work."""
    errors: dict[str, list[Member]] = {}
    for member in fleet.members:
        try:
            load(fleet.study, member.overrides)
        except StudyError as error:
            errors.setdefault(str(error), []).append(member)
    if errors:
        texts = [f"{m.label}{f' and {len(more)} more' * bool(more)}: {error}" for error, (m, *more) in errors.items()]
        raise StudyError("study/invalid", first_of(texts))
    try:
        path_below(folder, MEMBERS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ElastidError("files/folder", f"not writable ({reason}). Give another folder with --run", folder) from None
    for member in fleet.members:
        path_below(folder, MEMBERS, member.name)


def _reasons(outcomes: Sequence[Outcome]) -> list[str]:
    return [f"{outcome.label}: {outcome.message}" for outcome in outcomes]


def _outcomes(fleet: Fleet, folder: Path, jobs: int, console: Console) -> tuple[Outcome, ...]:
    """Run all members, then repeat members whose worker died; return all outcomes."""
    work = partial(_run_member, fleet.study, folder)
    outcomes = {}
    for attempt in range(2):
        todo = [member for member in fleet.members if member.name not in outcomes]
        if todo and attempt:
            console.warn(f"fleet: workers died at {', '.join(member.label for member in todo)}; second attempt")
        with console.progress(f"fleet of {len(fleet.members)}") as progress:
            for index, outcome in map_isolated(work, todo, jobs, progress):
                if outcome is not None:
                    outcomes[todo[index].name] = outcome
    message = "its worker died 2 times, perhaps for lack of memory; run it alone, or with fewer --jobs"
    return tuple(outcomes.get(m.name, Outcome(m.robot, m.date, "died", message)) for m in fleet.members)


def _run_member(study: Path, folder: Path, member: Member) -> Outcome:
    """Run the stages of a member that are not current, in its folder; return the outcome."""
    run = Run(load(study, member.overrides), folder / MEMBERS / member.name, 1, Console(-2))
    try:
        run_all(run)
        message = ""
    except FitError as error:  # the summary has the status
        message = str(error)
    except (ElastidError, OSError, MemoryError) as error:
        return Outcome(member.robot, member.date, "failed", str(error))
    return Outcome(member.robot, member.date, str(_summary(run.folder).get("status", "failed")), message)


def _summary(folder: Path) -> dict[str, Any]:
    path = folder / "summary.json"
    return dict(json.loads(path.read_bytes())) if path.is_file() else {}


def rows_of(folder: Path, member: Member) -> Iterator[Row]:
    """Return the parameters in a member's summary, then its gear parameters."""
    summary = _summary(folder / MEMBERS / member.name)
    parameters, gears = summary.get("parameters", {}), (summary.get("gears") or {}).get("numbers", {})
    values = {name: _numbers_of(number) for name, number in parameters.items()}
    # K1, K2 ... are secants over torque ranges, which differ from robot to robot.
    values |= {k: _numbers_of(number) for k, number in gears.items() if k not in parameters and not k.startswith("K")}
    units = {name: number["unit"] for name, number in (gears | parameters).items()}
    for name, numbers in values.items():
        labels = {"robot": member.robot, "date": member.date, "status": str(summary["status"]), "parameter": name}
        yield labels | {"unit": units[name]} | numbers


def _numbers_of(number: Mapping[str, Any]) -> Row:
    """Return the values of a row; an effect that is not significant is 0, with the std of its one-sided 95 % bound."""
    if number["value"] is None:
        bound = number["bound95"]
        std = bound / ONE_SIDED_95
        return {"value": 0.0, "std": std, "low": 0.0, "high": bound, "std_noise": std}
    low, high = number.get("interval95") or (None, None)
    std = number.get("std")
    numbers = {"value": number["value"], "std": std, "low": low, "high": high}
    return numbers | {"std_noise": number.get("std_noise", std)}


def _values(rows: Sequence[Row]) -> tuple[FleetValue, ...]:
    names = {row["parameter"] for row in rows if row["value"]}
    keys = ("robot", "date", "parameter", "value", "std_noise")
    table_rows = [[row[key] for key in keys] for row in rows if row["status"] in COMPARED and row["parameter"] in names]
    return tuple(
        FleetValue(robot, float(date.fromisoformat(day).toordinal()), *number)
        for robot, day, *number in table_rows
        if number[-1] is not None
    )


def _write_table(folder: Path, rows: Sequence[Row]) -> Path:
    """Write fleet.parquet, a row per parameter and member; fleet.csv if pyarrow is not installed."""
    if find_spec("pyarrow") is None:
        write_rows(path := folder / "fleet.csv", [rows[0].keys(), *(row.values() for row in rows)])
        return path
    import pyarrow
    import pyarrow.parquet

    path = folder / "fleet.parquet"
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    table = pyarrow.table(columns, metadata={"elastid": "fleet", "format": "1", "made by": software()})
    with replacing(path) as temporary:
        pyarrow.parquet.write_table(table, temporary)
    return path
