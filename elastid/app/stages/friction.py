"""The stages of a friction study, from its plan to its page; `follow` has a file of its own."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

from elastid.app.console import Console, friction_table
from elastid.app.identified_robot import robot_of_friction, with_identified_friction
from elastid.app.run import Run
from elastid.app.stages.measure import measure_parts, report_count
from elastid.app.stages.report import page_artefacts
from elastid.app.summaries import as_json, failed_friction, friction_study_summary
from elastid.app.work import Artefacts, Work, Write, text
from elastid.base.errors import FitError
from elastid.base.execution import Execution
from elastid.design.friction import design_friction
from elastid.experiment.plan.friction import FrictionPlan, pass_reference
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.friction_study.identify import identify_friction
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.laws import NOT_ASKED
from elastid.friction_study.result import JointLevels
from elastid.friction_study.spec import FrictionSpec, LoadSpec
from elastid.record import FrictionRecord
from elastid.recorded.friction_logs import read_friction_logs
from elastid.report.friction_content import FrictionContent, part_words, refusals
from elastid.report.page.page_of_friction import write_page_of_friction
from elastid.report.spec import ReportSpec
from elastid.robot import Joint, Robot
from elastid.store.artefacts import Stamp
from elastid.store.friction_study import (
    FRICTION,
    read_filter,
    read_friction_plan,
    read_friction_records,
    read_friction_result,
    read_levels,
    write_friction_plan,
    write_friction_records,
    write_friction_result,
    write_levels,
)
from elastid.store.measured import write_pass_reference, write_torque_reference
from elastid.store.results import read_twin
from elastid.validation.friction_twin import friction_balances, friction_runs
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings


def design_motions(
    *,
    seed: int,
    robot: Robot,
    friction_joints: tuple[Joint, ...],
    experiment: ExperimentSpec,
    friction: FrictionSpec,
    work: Work,
) -> Artefacts:
    """plan.h5 of a friction study, and references/<motion>.csv for a robot controller, within the robot's limits."""
    plan = design_friction(friction, friction_joints, experiment, robot, seed)

    def report(console: Console) -> None:
        console.notes(plan.notes)
        console.say(
            f"design: {len(plan.motions)} motions of {len(plan.designs)} joints, {plan.robot_time_s / 60:.3g} min of "
            "the robot's time"
        )
        for sentence in (*plan.known, *plan.unknown):
            console.say(f"design: {sentence}")

    files: dict[str, Write] = {
        "references": partial(_write_motions, plan),
        "plan.h5": lambda path, stamp: write_friction_plan(path, plan, stamp),
    }
    return Artefacts(files, report)


def _write_motions(plan: FrictionPlan, folder: Path, stamp: Stamp) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    limits = {each.joint: each.limits for each in plan.designs}
    for motion in plan.motions:
        path = folder / f"{motion.name}.csv"
        if motion.planned is not None:
            write_pass_reference(path, pass_reference(motion.planned, limits[motion.joint], plan.rate_hz))
        elif motion.torque is not None:
            write_torque_reference(path, motion.torque, plan.rate_hz)


def simulate_motions(
    *, seed: int, robot: Robot, experiment: ExperimentSpec, design_file: Path, work: Work
) -> Artefacts:
    """records.h5 of the simulated rig, which carries out the motions of a friction study, each in a process."""
    rig = SimulatedFrictionRig(robot, experiment, read_friction_plan(design_file), seed)
    records, report = measure_parts(work, rig.motions, rig.measure, _records_in, write_friction_records, "motions")
    files = {"records.h5": lambda path, stamp: write_friction_records(path, records, stamp, rig.warm_ups())}
    return Artefacts(files, report)


def _records_in(path: Path) -> tuple[FrictionRecord, ...]:
    return read_friction_records(path).records


def import_motions(
    *,
    robot: Robot,
    friction_joints: tuple[Joint, ...],
    experiment: ExperimentSpec,
    loads: tuple[LoadSpec, ...],
    files: Path,
    work: Work,
) -> Artefacts:
    """records.h5 of the logs of a friction study."""
    joints, payloads = [joint.name for joint in friction_joints], {load.name: load.payload for load in loads}
    logs = read_friction_logs(robot, experiment, files, joints, payloads)
    notes = (*logs.notes, *(note for record in logs.records for note in record.notes))
    parts: dict[str, Write] = {
        "records.h5": lambda path, stamp: write_friction_records(path, logs.records, stamp, logs.warm_ups, logs.notes)
    }
    return Artefacts(parts, partial(report_count, notes, len(logs.records)))


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
    joint_levels, measured = read_levels(levels_file), read_friction_records(measure_file)
    simulated, recorded = experiment.simulated, experiment.recorded
    truth = None if simulated is None else true_robot(robot, simulated.truth)
    try:
        result = identify_friction(robot, joint_levels, measured, friction, truth)
    except FitError as error:
        return Artefacts({"summary.json": as_json(failed_friction(name, str(error)))}, error=error)
    # Along the first log of each group of joints that moved together.
    identified, controller = with_identified_friction(robot, result), None if recorded is None else recorded.controller
    runs = friction_runs(identified, result.joints, measured, controller, Execution(work.jobs))
    twin = TwinFindings(friction_balances(result.joints, measured), runs)
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
            "summary.json": as_json(friction_study_summary(name, result, twin)),
            "identified_robot.yml": text(robot_of_friction(name, robot, result)),
            "friction.h5": lambda path, stamp: write_friction_result(path, result, stamp, twin),
        },
        report,
    )


def report_friction(
    *,
    name: str,
    text: str,
    report: ReportSpec,
    friction_file: Path,
    work: Work,
    design_file: Path | None = None,
    follow_file: Path | None = None,
) -> Artefacts:
    """The page and figures of a friction study."""
    content = FrictionContent(
        title=name,
        result=read_friction_result(friction_file),
        study_text=text,
        provenance=work.stamp.shown,
        plan=read_friction_plan(design_file) if design_file is not None else None,
        twin=read_twin(friction_file, FRICTION),
        filters=read_filter(follow_file) if follow_file is not None else (),
    )
    return page_artefacts(write_page_of_friction, content, report, work)


def conclude(run: Run) -> None:
    """Show the numbers, the files, and in the last line the parts that were not identified."""
    result = read_friction_result(run.path("friction"))
    run.console.table(friction_table(result.numbers))
    for refusal in refusals(result):
        if refusal.reason != NOT_ASKED:
            joints = f"joint{'s' if len(refusal.joints) > 1 else ''} {', '.join(refusal.joints)}"
            run.console.say(f"{joints}: no {refusal.part}: {refusal.reason}")
    leaves = (*run.stages["report"].leaves, *run.stages["friction"].leaves[1:])
    for path in (run.folder / name for name in leaves):
        if path.exists():
            run.console.say(str(path))
    missing = [f"joint {each.joint}: {part_words(held)}" for each in result.joints for held in each.missing]
    if result.status == "failed":
        raise FitError(f"no friction was identified: {result.message}; the notes above say why")
    meaning = f"these data do not identify {', '.join(missing)}" if missing else "each joint has its curve of friction"
    run.console.say(f"{result.status}: {meaning}")


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
