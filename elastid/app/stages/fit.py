"""Stage fit: responses -> fit.h5, summary.json and identified_robot.yml; checks of a fit for other commands."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from elastid.app.console import Console
from elastid.app.identified_robot import robot_files
from elastid.app.parameter_truth import parameter_contents, true_values
from elastid.app.run import Artefacts, Run, Work, Write, text
from elastid.app.summaries import as_json, failure, modes_of, summary
from elastid.base.display import capitalise
from elastid.base.errors import FitError, notes_of
from elastid.fit.combinations import combination_notes, loop_note
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import identify_with_motion_bias
from elastid.fit.parameter_selection import AT_TOOL
from elastid.fit.result import Result
from elastid.fit.status_terms import FIXED_VALUES
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.gear_result import GearResult
from elastid.report.content import DENSE, MODES, dense_models
from elastid.report.parameter_row import ParameterRow, parameter_rows
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit, read_gears, write_fit
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

        loop = loop_of(recorded.controller, robot.n_u)
    tests: Sequence[PlacedTest] = ()
    tool_frfs = []
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
    rows, modes = fitted_rows(study, result, friction), modes_of(model_of_all)
    content = summary(study.name, robot, result, rows, modes, agreements, notes_of(responses), friction)
    figures = {"modes": (modes, MODES), "dense": (dense_models(model_of_all), DENSE)}

    def report(console: Console) -> None:
        all_notes = work.unanswered(result.shown_notes)
        # The last lines of the run contain the first cause.
        is_last = console.verbosity >= 0 and not work.has_gears and bool(result.cause.text)
        console.notes((note for note in all_notes if not (is_last and note == result.cause)), on_page=True)
        seconds = (second.sentence for second in (result.static, result.tool) if second is not None)
        reason = "the residuals exceed the noise" if result.exceeds_noise else "the data contradict the robot model"
        status = f"misfit ({reason})" if result.status == "misfit" else result.status.replace("_", " ")
        for line in (f"{status}; {result.converged_starts}", *seconds):
            console.say(f"fit: {'linear model: ' * work.has_gears}{line}")

    files: dict[str, Write] = {"summary.json": as_json(content)}
    files |= {file: text(x) for file, x in robot_files(study.name, robot, result, friction, responses.names)}
    files["fit.h5"] = lambda path, stamp: write_fit(path, result, stamp, modelled, figures)
    return Artefacts(files, report)


def fitted_rows(
    study: Study, result: Result, friction: CompensatedFriction | None, gears: GearResult | None = None
) -> tuple[ParameterRow, ...]:
    """Return a row for each parameter, with its true value if the rig is simulated."""
    robot, simulated = study.as_robot(), study.experiment.simulated
    true = true_values(robot, simulated, study.fit.parameters, friction)
    contents = parameter_contents(robot, simulated is not None, friction, result.parameters, gears)
    return parameter_rows(result, true, contents)


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


def gears_of(run: Run) -> GearResult | None:
    """Return the gear effects if the study requests them and they were estimated, else None."""
    if "gears" not in run.stages:
        return None
    run.require_result("gears")
    gears = read_gears(run.path("gears"))
    return None if gears is None or gears.refused else gears
