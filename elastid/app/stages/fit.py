"""Stage fit: responses -> fit.h5 and summary.json, and the table of parameters at the end of a run."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from elastid.app.console import Console, result_table
from elastid.app.identified_robot import robot_files
from elastid.app.parameter_truth import parameter_contents, true_values
from elastid.app.run import Artefacts, Run, Work, Write, text
from elastid.app.summaries import as_json, failure, modes_of, summary
from elastid.base.display import capitalise
from elastid.base.errors import FitError, MisfitError, notes_of
from elastid.base.names import SEPARATOR
from elastid.fit.combinations import COMBINATION, combination_notes, loop_note
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import identify_with_motion_bias
from elastid.fit.parameter_selection import AT_TOOL
from elastid.fit.result import Result
from elastid.fit.status_terms import DISTORTED, FIXED_VALUES
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.gear_result import GearResult, with_gears
from elastid.report.content import (
    DENSE,
    MODES,
    WITH_COULOMB,
    ParameterRow,
    dense_models,
    gear_line,
    gear_table,
    parameter_rows,
)
from elastid.report.run_summary import OPEN_GEARS, accuracy, is_wrong, next_steps, numbers_answer, residual_sentence
from elastid.response import Response
from elastid.robot import Robot
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit, read_gears, read_validation, write_fit
from elastid.study import Study
from elastid.validation.frf_error import agreement

if TYPE_CHECKING:
    from elastid.fit.problem.static_loads import PlacedTest

TRUSTED = ("converged", "noise_unknown", "at_bound")


def fit(study: Study, work: Work) -> Artefacts:
    """Fit the elastic model: fit.h5, summary.json, identified_robot.yml; a failed fit gives a summary and FitError.

    Finished starts of an interrupted fit are kept in fit.partial, from which the next fit resumes.
    """
    robot, spec, validation = study.as_robot(), study.seeded_fit, study.validation.configurations
    responses, friction = read_responses(work.sources["estimate"]), read_friction(work.sources["estimate"])
    recorded, loop = study.experiment.recorded, None
    if recorded is not None and recorded.has_no_torque and recorded.controller is not None:
        from elastid.simulation.controller import loop_of  # a slow import

        loop = loop_of(recorded.controller, len(robot.driven))
    tests: Sequence[PlacedTest] = ()
    tool_frfs: list[Response] = []
    if study.loads is not None:
        from elastid.app.stages.measure import tests_of  # a slow import: rig and readers of logs

        tests = tests_of(study, study.loads, responses)
    if study.tool is not None:
        from elastid.app.stages.estimate import tool_responses  # a slow import: readers and estimators

        tool_frfs = [
            replace(G, configuration=replace(G.configuration, name=G.configuration.name + AT_TOOL))
            for G in tool_responses(study.tool, study, work.base)
            if G.configuration.name not in validation
        ]
    try:
        with work.execution(work.checkpoint()) as execution:
            all_responses = [*study.fitted(responses), *tool_frfs]
            result, effects = identify_with_motion_bias(all_responses, robot, spec, study.model, execution, loads=tests)
    except FitError as error:
        return Artefacts({"summary.json": as_json(failure(study.name, spec.starts, str(error)))}, error=error)
    # Fixed values and base of a simulated robot are exact.
    exact = () if study.experiment.simulated is None else (FIXED_VALUES, "fit/assumed-rigid")
    remarks = [note for note in result.notes if note.code not in exact]
    loop_notes = () if loop is None else loop_note(result, robot, loop)
    result = replace(result, notes=(*remarks, *notes_of(tool_frfs), *loop_notes, *combination_notes(result)))
    model_of_all = FittedRobot.of(result, robot, responses, study.model)
    modelled = model_of_all.responses_by(effects)
    agreements = [agreement(m, G, m.configuration.name in validation) for m, G in zip(responses, modelled, strict=True)]
    notes = notes_of(responses)
    rows = fitted_rows(study, result, friction)
    modes = modes_of(model_of_all)
    content = summary(study.name, robot, result, rows, modes, agreements, notes, friction)
    figures = {"modes": (modes, MODES), "dense": (dense_models(model_of_all), DENSE)}

    def report(console: Console) -> None:
        all_notes = work.unanswered(result.shown_notes)
        # The last lines of the run contain the first cause.
        is_last = console.verbosity >= 0 and not work.has_gears and bool(result.cause[0])
        first = "".join(result.cause) if is_last else ""
        console.notes((note for note in all_notes if str(note) != first), on_page=True)
        seconds = (second.sentence for second in (result.static, result.tool) if second is not None)
        reason = "the residuals exceed the noise" if result.exceeds_noise else "the data contradict the robot model"
        status = f"misfit ({reason})" if result.status == "misfit" else result.status.replace("_", " ")
        for line in (f"{status}; {result.converged_starts}", *seconds):
            console.say(f"fit: {'linear model: ' * work.has_gears}{line}")

    files = robot_files(study.name, robot, result, friction, responses.names)
    robots = {file: text(robot_file) for file, robot_file in files}
    result_file: Mapping[str, Write] = {"fit.h5": lambda path, stamp: write_fit(path, result, stamp, modelled, figures)}
    return Artefacts({"summary.json": as_json(content), **robots, **result_file}, report)


def fitted_rows(
    study: Study, result: Result, friction: CompensatedFriction | None, gears: GearResult | None = None
) -> tuple[ParameterRow, ...]:
    """Return a row for each parameter, with its true value if the rig is simulated."""
    robot, simulated = study.as_robot(), study.experiment.simulated
    true = true_values(robot, simulated, study.fit.parameters, friction)
    return parameter_rows(
        result, true, parameter_contents(robot, simulated is not None, friction, result.parameters, gears)
    )


def current_fit(run: Run) -> Result:
    """Return the fit of a study; raise StudyError if it is missing or outdated."""
    run.study.as_robot()
    run.require_stage("fit")
    run.require_result("fit")
    return read_fit(run.path("fit"))


def warn_of_distrust(run: Run, command: str, result: Result) -> None:
    """Warn if the fit that a command uses has a significant model error or no usable optimum."""
    if result.status not in TRUSTED:
        run.console.warn(f"{command}: do not use this fit. {capitalise(result.message)}")


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
    status, meaning = result.status.replace("_", " "), result.meaning
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
    symbols = [(row.name, *row.name.partition("_")[::2]) for row in reversed(rows)]
    groups = []
    for owner, has_motor, families in SYMBOLS:
        of_owner = {
            family: (name, location)
            for name, family, location in symbols
            if family in families and has_motor in (None, location.partition(SEPARATOR)[0] in robot.driven_names)
        }
        names = ", ".join(f"{of_owner[family][0]} ({families[family]})" for family in families if family in of_owner)
        groups += [f"{names} of {owner.format(next(iter(of_owner.values()))[1])}"] if of_owner else []
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


def gears_of(run: Run) -> GearResult | None:
    """Return the gear effects if the study requests them and they were estimated, else None."""
    if "gears" not in run.stages:
        return None
    run.require_result("gears")
    gears = read_gears(run.path("gears"))
    return None if gears is None or gears.refused else gears
