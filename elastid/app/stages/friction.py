"""levels and friction of a friction study: records -> levels.h5 -> friction.h5, summary.json, identified_robot.yml."""

from __future__ import annotations

from pathlib import Path

from elastid.app.console import Console
from elastid.app.friction_summaries import failed_friction, friction_study_summary
from elastid.app.identified_robot import robot_of_friction, with_identified_friction
from elastid.app.run import Run
from elastid.app.summaries import write_summary
from elastid.app.tables import friction_table
from elastid.app.work import Artefacts, Work, text
from elastid.base.errors import FitError
from elastid.base.execution import Execution
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.friction_fit.identify import identify_friction
from elastid.friction_fit.joint_levels import find_joint_levels
from elastid.friction_fit.law_choice import NOT_ASKED
from elastid.friction_fit.result import JointLevels
from elastid.friction_fit.spec import FrictionSpec
from elastid.report.friction_content import part_words, refusals
from elastid.robot import Joint, Robot
from elastid.store.friction_study import (
    read_friction_records,
    read_friction_result,
    read_levels,
    write_friction_result,
    write_levels,
)
from elastid.study import Study
from elastid.validation.friction_twin import friction_balances
from elastid.validation.friction_twin_run import friction_runs
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings


def levels(*, robot: Robot, friction_joints: tuple[Joint, ...], measure_file: Path, work: Work) -> Artefacts:
    """levels.h5: friction at each speed, load and temperature, and the regression of each joint's motions."""
    measured = read_friction_records(measure_file)
    joints = [joint for joint in friction_joints if joint.name in measured.joints]
    joint_levels = find_joint_levels(robot, joints, measured)

    def report(console: Console) -> None:
        console.notes(note for each in joint_levels for note in each.notes)
        for each in joint_levels:
            console.say(f"levels: joint {each.joint}: {_level_words(each)}")

    return Artefacts({"levels.h5": lambda path, stamp: write_levels(path, joint_levels, stamp)}, report)


def friction(
    *,
    name: str,
    robot: Robot,
    experiment: ExperimentSpec,
    friction: FrictionSpec,
    measure_file: Path,
    levels_file: Path,
    work: Work,
) -> Artefacts:
    """friction.h5, summary.json, identified_robot.yml; without a result a summary with the reason, and FitError."""
    study = Study(name=name, experiment=experiment, robot=robot, friction=friction)  # for the words of the summary
    joint_levels, measured = read_levels(levels_file), read_friction_records(measure_file)
    simulated, recorded = experiment.simulated, experiment.recorded
    truth = None if simulated is None else true_robot(robot, simulated.truth)
    try:
        result = identify_friction(robot, joint_levels, measured, friction, truth)
    except FitError as error:
        failed = failed_friction(study, str(error))
        return Artefacts({"summary.json": lambda path, stamp: write_summary(path, failed)}, error=error)
    # Along the first log of each group of joints that moved together.
    identified, controller = with_identified_friction(robot, result), None if recorded is None else recorded.controller
    runs = friction_runs(identified, result.joints, measured, controller, Execution(work.jobs))
    twin = TwinFindings(friction_balances(result.joints, measured), runs)
    content = friction_study_summary(study, result, twin)
    reported = [note for each in joint_levels for note in each.notes]

    def report(console: Console) -> None:
        console.notes(note for each in result.joints for note in each.notes if note not in reported)
        console.say(f"friction: {result.message}")
        for balance in twin.balances:
            console.say(f"friction: {describe_balance(balance)}")
        for words in twin.run_words:
            console.say(f"friction: {words}")

    return Artefacts(
        {
            "summary.json": lambda path, stamp: write_summary(path, content),
            "identified_robot.yml": text(robot_of_friction(name, robot, result)),
            "friction.h5": lambda path, stamp: write_friction_result(path, result, stamp, twin),
        },
        report,
    )


def conclude(run: Run) -> None:
    """Show the numbers, the files, and in the last line the parts that were not identified."""
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


def _level_words(joint: JointLevels) -> str:
    unit = "m/s" if joint.slides else "rad/s"
    parts = []
    if joint.levels is not None:
        curve = joint.levels.levels
        parts.append(f"{curve.n_levels} levels from {curve.speed.min():.3g} to {curve.speed.max():.3g} {unit}")
    if joint.motion is not None:
        error = joint.motion.chosen.relative_error
        parts.append(f"a motion, {error:.1%} of whose torque inertia, gravity and friction leave")
    return ", ".join(parts)
