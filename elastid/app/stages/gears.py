"""Stage gears: records, responses and a fit -> gears.h5; adds the effects to summary.json and the robot model.

k and d of the linear fit apply at the amplitude of the records; k in gears.h5 applies at zero torque.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any

from elastid.app.console import Console
from elastid.app.identified_robot import robot_files
from elastid.app.run import Artefacts, Work, Write, text
from elastid.app.stages.estimate import RecordsOnShafts
from elastid.app.stages.fit import fitted_rows
from elastid.app.summaries import as_json, list_notes, section
from elastid.base.errors import DataError, StudyError, notes_of
from elastid.base.execution import Execution
from elastid.fit.diagnosis.hypotheses import WITHOUT_OTHER_ROBOTS
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec
from elastid.fit.status_terms import CODES_WITH_CAUSE
from elastid.model.spec import ModelSpec
from elastid.nonlinear.gear_result import GearNumber, GearResult, with_gears
from elastid.nonlinear.identify_gears import identify_gears
from elastid.nonlinear.spec import GearsSpec
from elastid.report.gear_table import gear_line
from elastid.report.parameter_row import ParameterRow
from elastid.response import Response
from elastid.robot import Robot
from elastid.robot.simplified import with_straight_springs
from elastid.store.kinds import json_value
from elastid.store.measured import read_friction, read_responses
from elastid.store.plan import read_plan
from elastid.store.results import read_fit, write_gears
from elastid.study import Study


def gears(study: Study, work: Work) -> Artefacts:
    """Estimate the gear effects: gears.h5, and the effects in summary.json and identified_robot.yml of the fit."""
    robot, model, files_of = study.as_robot(), study.model, work.sources
    measured, friction = read_responses(files_of["estimate"]), read_friction(files_of["estimate"])
    responses, result = study.fitted(measured), read_fit(files_of["fit"])
    plan_lines = read_plan(files_of["design"]).lines if "design" in files_of else None
    records = [RecordsOnShafts(files_of["measure"], response.configuration.name, None) for response in responses]
    with work.execution() as execution:
        start = fit_with_linear_springs(robot, responses, result, model, study.seeded_fit, execution)
        spec = study.gears or GearsSpec()
        gear_result = identify_gears(records, responses, *start, study.estimator, spec, execution, model, plan_lines)
    final, summary = with_gears(result, gear_result), _summary(files_of["fit"].with_name("summary.json"))
    content = with_gear_section(summary, result, fitted_rows(study, final, friction, gear_result), gear_result)
    robots = robot_files(study.name, robot, final, friction, measured.names, gear_result)
    files: dict[str, Write] = {
        "summary.json": as_json(content),
        **{file: text(robot_file) for file, robot_file in robots},
        "gears.h5": lambda path, stamp: write_gears(path, gear_result, stamp),
    }

    def report(console: Console) -> None:
        linear = [*result.notes, *notes_of(responses)]
        console.notes(gear_result.unanswered_notes(note for note in linear if note.code in CODES_WITH_CAUSE))
        console.notes(gear_result.notes)
        if gear_result.refused:  # otherwise the end of the run prints the effects
            console.warn(f"gears: {gear_line(gear_result)}")

    return Artefacts(files, report)


def fit_with_linear_springs(
    robot: Robot, responses: Sequence[Response], result: Result, model: ModelSpec, spec: FitSpec, execution: Execution
) -> tuple[Result, Robot]:
    """Return fit and robot with linear springs, since the stage estimates the spring characteristics.

    Within a gap of the robot model, k would not influence the responses.  StudyError if the fit has a free parameter of
    a spring characteristic, which would act twice.
    """
    straight = with_straight_springs(robot)
    if straight == robot:
        return result, robot
    names = sorted(set(result.parameters.free_names) - set(straight.parameters(straight.geometry)))
    if terms := ", ".join(name for name in names if name in robot.parameters()):
        text = f"fit.parameters frees {terms}, and gears finds the law of a spring from the records"
        raise StudyError("fit/parameters", f"{text}; leave out {terms}, or the section gears")
    bare = replace(spec, profile=(), bootstrap=0)
    start = identify(responses, straight, bare, model=model, execution=execution.quiet, hypotheses=WITHOUT_OTHER_ROBOTS)
    return start, straight


def _summary(path: Path) -> dict[str, object]:
    try:
        content: dict[str, object] = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise DataError("files/damaged", f"it cannot be read ({error}); the stage fit makes it again", path) from None
    return content


def with_gear_section(
    content: Mapping[str, Any], result: Result, rows: Sequence[ParameterRow], gears: GearResult
) -> dict[str, Any]:
    """Add the section `gears` to summary.json, and the parameters that were estimated together with the effects.

    rows: of these parameters, which get the linear fit as `linear`.  The section has numbers by name, in SI and makers'
    units (value null and `bound95` if not significant), and the reason if nothing was estimated (`refused`).
    """
    parameters = dict(content["parameters"])
    for row in rows if not gears.refused else ():
        entries = {name: x for name, x in parameters[row.name].items() if name not in ("profile95", "bootstrap95")}
        fit = {"value": result.values[row.name], "std": result.std[row.name], "interval95": result.interval(row.name)}
        parameters[row.name] = entries | section(row, "value=estimate std interval95=interval") | {"linear": fit}
    numbers = {
        "refused": gears.refused,
        "numbers": {number.name: _number(sheet.joint, number) for sheet in gears.sheets for number in sheet.numbers},
        "largest_torque": {sheet.joint: sheet.peak for sheet in gears.sheets},
        "notes": list_notes(gears.notes),
    }
    final = with_gears(result, gears)
    changes = section(final, "status message")
    changes |= {} if final.indices else {"modification_indices": []}  # explained by the gear effects
    if gears.explains_misfit and not final.indices:
        is_unanswered = [note["code"] not in CODES_WITH_CAUSE for note in content["notes"]]
        changes |= {name: list(compress(content[name], is_unanswered)) for name in ("warnings", "notes")}
    return {**content, **changes, "parameters": json_value(parameters), "gears": json_value(numbers)}


def _number(joint: str, row: GearNumber) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "joint": joint,
        **section(row, "meaning unit value std"),
        "interval95": row.interval if row.is_significant else None,
        "bound95": None if row.is_significant else row.bound,
    }
    if row.order:
        entry |= section(row, "order phase phase_std")
    if math.isfinite(row.rated_fraction):
        entry["of_rated"] = row.rated_fraction
    if row.maker_unit:
        size = row.value if row.is_significant else row.bound
        entry |= {"maker_unit": row.maker_unit, "in_maker_unit": size * row.factor}
    return entry
