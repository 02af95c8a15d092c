"""fit: responses -> fit.h5 and summary.json, and the table of parameters at the end of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from elastid.app.dry_friction import contents
from elastid.app.identified_robot import robot_of_fit
from elastid.app.run import Run
from elastid.app.summaries import failure, interrupted, modes_of, summary, truth, write_summary
from elastid.app.tables import parameter_table
from elastid.base.errors import FitError, MisfitError
from elastid.export.intervals import lines_of
from elastid.fit.fitted_robot import FittedRobot, robots_by_group
from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.solve.multistart import Interrupted
from elastid.report.parameter_rows import parameter_rows
from elastid.response import FrequencyResponse
from elastid.store import read_fit, read_friction, read_responses, text_file, write_fit
from elastid.validation.agreement import agreement

TRUSTED = ("converged", "noise_unknown", "at_bound")


def fit(run: Run) -> None:
    """fit.h5 and summary.json; a fit that found nothing leaves a summary that says why, and raises FitError.

    An interrupted fit leaves its finished starts in fit.partial, from where the next is resumed.
    """
    study, path = run.study, run.summary("fit")
    responses = read_responses(run.path("estimate"))
    fitted = study.fitted(responses)
    if not run.is_current("validate"):  # of another fit; nobody is to read it beside this one's summary
        run.summary("validate").unlink(missing_ok=True)
    unfinished = run.resumed("fit")
    try:
        with run.execution("fit", unfinished) as execution:
            result = identify(fitted, study.as_robot(), study.seeded_fit, model=study.model, execution=execution)
    except FitError as error:
        write_summary(path, failure(study, str(error)))
        unfinished.clear()
        raise
    except Interrupted as stop:
        write_summary(path, interrupted(study, stop.ends))
        run.console.say(f"fit: stopped, {unfinished.words or 'no start'} done and kept")
        raise
    write_summary(path, _summary(run, result, responses))
    _write_robots(run, result, [response.configuration.name for response in responses])
    write_fit(run.path("fit"), result, run.stamps["fit"])
    unfinished.clear()
    run.console.notes(result.notes)
    run.console.say(f"fit: {result.message}")


def conclude(run: Run) -> None:
    """Show the parameters, where the results are, and in the last line what the status means and what to do.

    MisfitError where the fit is not to be believed as it stands, FitError where it cannot be trusted at all.
    """
    result = read_fit(run.path("fit"))
    estimated = run.path("estimate").exists()  # a kept fit does not need it
    friction = read_friction(run.path("estimate")) if estimated else None
    held = contents(run.study, friction, result.parameters.free) if estimated else {}
    run.console.table(parameter_table(parameter_rows(result, truth(run.study, friction))))
    for words in dict.fromkeys(held.values()):
        names = [name for name, text in held.items() if text == words]
        run.console.say(f"{', '.join(names)}: {words}")
    for path in (*(run.folder / leaves for leaves in run.stages["report"].leaves), run.summary("fit")):
        if path.exists():
            run.console.say(str(path))
    status, meaning = result.status.replace("_", " "), result.meaning
    if result.status == "misfit":
        raise MisfitError(f"done, but a misfit: {meaning}. {_sentence(result.message)}")
    if result.status not in TRUSTED:
        raise FitError(f"the fit cannot be trusted ({status}): {result.message}; {meaning}")
    run.console.say(f"{status}: {meaning}")


def _write_robots(run: Run, result: FitResult, configurations: Sequence[str]) -> None:
    """identified_robot.yml; of groups with parameters of their own identified_robot-<group>.yml each.

    Not robot.yml: a study may lie in its own run folder, beside the robot that it reads.
    """
    friction = read_friction(run.path("estimate"))
    for label, (robot, members) in robots_by_group(result, run.study.as_robot(), configurations).items():
        name = f"identified_robot-{label}.yml" if label else "identified_robot.yml"
        with text_file(run.folder / name) as file:
            file.write(robot_of_fit(run.study.name, robot, friction, lines_of(result, members[0])))


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _summary(run: Run, result: FitResult, responses: Sequence[FrequencyResponse]) -> dict[str, Any]:
    fitted = FittedRobot.of(result, run.study.as_robot(), responses, run.study.model)
    left_out = run.study.validation.left_out
    agreements = [
        agreement(m, G, m.configuration.name in left_out) for m, G in zip(responses, fitted.responses, strict=True)
    ]
    notes = [note for response in responses for note in response.notes]
    return summary(run.study, result, modes_of(fitted), agreements, notes, read_friction(run.path("estimate")))
