"""End of a run with a fit: table of parameters, answers, files, and the status in the last line."""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from elastid.app.console import result_table
from elastid.app.run import Run
from elastid.app.stages.fit import TRUSTED, fitted_rows
from elastid.base.display import capitalise
from elastid.base.errors import FitError, MisfitError
from elastid.base.names import SEPARATOR
from elastid.fit.combinations import COMBINATION
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.result import Result
from elastid.fit.status_terms import DISTORTED
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.gear_result import GearResult, with_gears
from elastid.report.gear_table import gear_line, gear_table
from elastid.report.next_steps import OPEN_GEARS, next_steps
from elastid.report.parameter_row import WITH_COULOMB, ParameterRow
from elastid.report.run_summary import accuracy, is_wrong, numbers_answer, residual_sentence
from elastid.robot import Robot
from elastid.store.measured import read_friction
from elastid.store.results import read_fit, read_gears, read_validation


def conclude(run: Run) -> None:
    """Print the parameters, three answers as on the page, the files, and in the last line the status.

    Raises MisfitError for a significant model error, FitError for a fit without a usable optimum.
    """
    gear_result = read_gears(run.path("gears") if "gears" in run.stages else None)
    linear, say = read_fit(run.path("fit")), run.console.say
    result = linear if gear_result is None else with_gears(linear, gear_result)
    has_responses = run.path("estimate").exists()  # not required by a fit that is kept
    friction = read_friction(run.path("estimate"))
    rows = fitted_rows(run.study, result, friction, gear_result)
    run.console.table(result_table(result.display, rows))
    for line in _legend(run.study.as_robot(), result, rows, friction):
        say(line)
    if gear_result is not None and not gear_result.refused:
        run.console.table(gear_table(gear_result))
        say(f"gears: {gear_line(gear_result)}")
    for note in result.notes:
        if note.code == COMBINATION:
            say(note.text)
    if has_responses and (with_coulomb := ", ".join(row.name for row in rows if row.has_coulomb)):
        say(f"{with_coulomb}: {WITH_COULOMB}")
    has_new_status = result.status != linear.status
    for line in _with_gears(result, rows, gear_result) if has_new_status else _answers(run, result, rows, gear_result):
        say(line)
    run.say_files([*run.stages["report"].leaves, run.stages["fit"].leaves[1]])
    status, meaning = result.status.replace("_", " "), str(result.meaning)
    # The answers above contain the cause.
    failure = meaning if run.console.verbosity >= 0 else f"{result.message.partition('. ')[0]}. {capitalise(meaning)}"
    if result.status == "misfit":
        raise MisfitError("fit/misfit", failure, status)
    if result.status not in TRUSTED:
        raise FitError("fit/not-trusted", failure, status)
    say(f"{status}: {result.message if has_new_status else meaning}")


OF_JOINTS = {"k": "stiffness", "d": "damping"}
OF_BEARINGS = {"f": "viscous friction"}
# Owner, True for a joint with a motor (None: any), and families of parameters.
SYMBOLS = (
    ("joint {} between motor and link (link side)", True, OF_JOINTS),
    ("joint {} behind the gear (link side)", True, OF_BEARINGS),
    ("elastic joint {} (bearing or link, no motor)", False, {**OF_JOINTS, **OF_BEARINGS}),
    (
        "motor {} (motor side)", None,
        {"fm": "viscous friction", "Jm": "inertia", "km": "stiffness of the shaft", "dm": "damping of the shaft"}
    ),
    ("body {}", None, {"m": "mass", "I": "inertia"}),
    ("the outputs relative to the inputs", None, {"delay": "time delay"})
)  # fmt: skip
STD_PARTS = {
    "std_noise": "measured variance of the FRFs (noise, and distortion between realisations)",
    "std_prior": "contribution of the tolerances that more data do not reduce",
}


def _legend(
    robot: Robot, result: Result, rows: Sequence[ParameterRow], friction: CompensatedFriction | None
) -> Iterator[str]:
    """Yield the meaning of the symbols, of the contributions to std, and of the intervals in the table."""
    symbols = [(row.name, *row.name.partition("_")[::2]) for row in reversed(rows)]
    groups = []
    for owner, has_motor, families in SYMBOLS:
        members = {
            family: (name, location)
            for name, family, location in symbols
            if family in families and has_motor in (None, location.partition(SEPARATOR)[0] in robot.driven_names)
        }
        names = ", ".join(f"{members[family][0]} ({families[family]})" for family in families if family in members)
        groups += [f"{names} of {owner.format(next(iter(members.values()))[1])}"] if members else []
    if groups:
        yield f"Names: {'; '.join(groups)}"
    errors = {
        "the assumed model error": result.model_error > 0,
        "residuals above the noise": result.exceeds_noise and not result.is_within_declared,
        "errors of the friction compensation": friction and friction.shapes,
        "unexplained distortion": DISTORTED in result.verdicts,
        "contribution of the tolerances that longer measurements reduce": True,
    }
    meanings = {**STD_PARTS, "std_systematic": ", ".join(compress(errors, errors.values()))}
    if stds := [name for name in result.display.headings if name in meanings]:
        varied, squares = result.parameters.free_names[len(rows) :], " + ".join(f"{name}^2" for name in stds)
        count = f"{len(varied)} values of the robot model"
        names_of_rest = ", ".join(varied) if len(varied) <= LIMITS.n_named else count
        gains = " (gain_u: logged torque / true torque)" if "gain_u" in names_of_rest else ""
        tolerance = "tolerance in the robot model, otherwise the default tolerance"
        yield f"The fit also varied {names_of_rest}{gains}, with a prior. Std of each prior: {tolerance}"
        yield f"std^2 = {squares}. {'. '.join(f'{name}: {meanings[name]}' for name in stds)}"
    profiles = zip(rows, result.profile95, strict=False)
    if by_profile := ", ".join(row.name for row, ends in profiles if not np.isnan(ends).any()):
        yield f"95 % intervals of {by_profile}: from the profile likelihood, not symmetric about the estimate"
    if not stds and result.exceeds_noise:
        yield "std: computed from the differences between blocks of the data (configuration and frequency band)"


def _with_gears(result: Result, rows: Sequence[ParameterRow], gears: GearResult | None) -> Iterator[str]:
    yield f"Are the numbers good? {numbers_answer(result, rows, gears)}"
    yield "Where does the model fail? The linear fit is biased; the line `gears` has the unexplained fraction."
    yield "What next? Use identified_robot.yml, which contains the effects."


def _answers(run: Run, result: Result, rows: Sequence[ParameterRow], gears: GearResult | None) -> Iterator[str]:
    is_linear = gears is None or not gears.explains_misfit  # a validation is of the linear model
    judged = read_validation(run.path("validate")).configurations if is_linear and run.is_current("validate") else ()
    detail = "" if is_wrong(result) else accuracy(result, rows)
    yield f"Are the numbers good? {numbers_answer(result, rows, gears)}{detail and f' {detail}.'}"
    yield f"Where does the model fail? {residual_sentence(result, judged)}"
    step = next_steps(result, rows)[0]
    if step is OPEN_GEARS and "gears" in run.stages:
        step = replace(step, sentence="Run the stage gears.", gain="", text=f"elastid run {run.loaded.path} gears")
    command = step.text
    if command.startswith("--"):
        overrides = "".join(f"--set {shlex.quote(override)} " for override in run.loaded.overrides)
        command = f"elastid run {run.loaded.path} --run {run.folder} {overrides}{command}"
    yield " ".join(filter(None, ("What next?", step.sentence, step.gain, command and f"`{command}`")))
