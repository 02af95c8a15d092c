"""friction: levels and records -> friction.h5, summary.json, identified_robot.yml, and the table that ends a run."""

from __future__ import annotations

from elastid.app.friction_twin_runs import runs_of_friction
from elastid.app.identified_robot import robot_of_friction
from elastid.app.run import Run
from elastid.app.summaries import failed_friction, friction_study_summary, write_summary
from elastid.app.tables import friction_table
from elastid.base.errors import FitError
from elastid.base.execution import Execution
from elastid.experiment.simulated.plant import true_robot
from elastid.friction_fit.identify import identify_friction
from elastid.friction_fit.law_choice import NOT_ASKED
from elastid.report.friction_content import part_words, refusals
from elastid.robot import Robot
from elastid.store import text_file
from elastid.store.friction_study import (
    read_friction_records,
    read_friction_result,
    read_levels,
    write_friction_result,
)
from elastid.study import Study
from elastid.validation.friction_twin import friction_balances
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings


def friction(run: Run) -> None:
    """friction.h5, summary.json, identified_robot.yml; where nothing was found, a summary with the reason: FitError."""
    study, path = run.study, run.summary("friction")
    found, measured = read_levels(run.path("levels")), read_friction_records(run.path("measure"))
    try:
        result = identify_friction(study.as_robot(), found, measured, study.as_friction(), _true_robot(study))
    except FitError as error:
        write_summary(path, failed_friction(study, str(error)))
        raise
    runs = runs_of_friction(study, result, measured, Execution(run.jobs))
    twin = TwinFindings(friction_balances(result.joints, measured), runs)
    write_summary(path, friction_study_summary(study, result, twin))
    with text_file(run.folder / run.stages["friction"].leaves[2]) as file:
        file.write(robot_of_friction(study, result))
    write_friction_result(run.path("friction"), result, run.stamps["friction"], twin)
    said = [note for each in found for note in each.notes]
    run.console.notes(note for each in result.joints for note in each.notes if note not in said)
    run.console.say(f"friction: {result.message}")
    for balance in twin.balances:
        run.console.say(f"friction: {describe_balance(balance)}")
    for words in twin.run_words:
        run.console.say(f"friction: {words}")


def conclude(run: Run) -> None:
    """Show the numbers, where the results are, and in the last line what was not identified and why."""
    result = read_friction_result(run.path("friction"))
    run.console.table(friction_table(result.numbers))
    for refusal in refusals(result):
        if refusal.reason != NOT_ASKED:
            run.console.say(f"{_joints(refusal.joints)}: no {refusal.part}: {refusal.reason}")
    leaves = (*run.stages["report"].leaves, *run.stages["friction"].leaves[1:])
    for path in (run.folder / name for name in leaves):
        if path.exists():
            run.console.say(str(path))
    missing = [f"joint {each.joint}: {part_words(held)}" for each in result.joints for held in each.missing]
    if result.status == "failed":
        raise FitError(f"no friction was identified: {result.message}; the notes above say why")
    meaning = f"these data do not tell {', '.join(missing)}" if missing else "each joint has its curve of friction"
    run.console.say(f"{result.status}: {meaning}")


def _joints(names: tuple[str, ...]) -> str:
    return f"joint{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _true_robot(study: Study) -> Robot | None:
    """The simulated robot with its truth; None where it is recorded."""
    simulated = study.experiment.simulated
    return None if simulated is None else true_robot(study.as_robot(), simulated.truth)
