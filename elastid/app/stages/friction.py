"""Stages of a friction study: plan, records, constant-velocity torques, friction model, Kalman filter and page."""

import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from elastid.app.commanded_robot import robot_of_friction
from elastid.app.console import Console, result_table
from elastid.app.identified_robot import with_identified_friction
from elastid.app.run import Artefacts, Run, Work, Write, text
from elastid.app.stages.measure import measure_parts, report_count
from elastid.app.stages.report import page_artefacts
from elastid.app.summaries import as_json, failed_friction, friction_study_summary
from elastid.base.display import number
from elastid.base.errors import FitError, MisfitError, notes_of
from elastid.design.friction import design_friction
from elastid.experiment.plan.friction import FrictionPlan, pass_reference
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.simulated.plant import true_robot
from elastid.friction_study.friction_tracking import TrackedFriction, track_joints
from elastid.friction_study.result import SlidingFriction, identify_friction
from elastid.friction_study.sliding_friction import identify_sliding_friction
from elastid.friction_study.spec import FilterSpec
from elastid.friction_study.static_model_fit import NOT_ASKED
from elastid.logs.friction_logs import read_friction_logs
from elastid.report.figures.drawings import friction_study_drawings
from elastid.report.friction_content import FrictionContent, refusals, term_name
from elastid.report.page.page_of_friction import html_of_friction
from elastid.store import friction_study as stored
from elastid.store.artefacts import NO_STAMP, Stamp
from elastid.store.trajectory import write_signals
from elastid.study import Study
from elastid.validation.friction_simulation import compare_friction_logs, predict_logs


def design_motions(study: Study, work: Work) -> Artefacts:
    """Design a friction study: plan.h5, and references/<motion>.csv within the robot's limits."""
    plan = design_friction(study.as_friction(), study.friction_joints, study.experiment, study.as_robot(), study.seed)

    def report(console: Console) -> None:
        console.say(
            f"design: {len(plan.motions)} trajectories of {len(plan.designs)} joints, "
            f"{plan.robot_time_s / 60:.3g} min of robot time"
        )
        for sentence in plan.assumed_friction:
            console.say(f"design: {sentence}")

    files: dict[str, Write] = {
        "references": partial(_write_motions, plan),
        "plan.h5": lambda path, stamp: stored.write_friction_plan(path, plan, stamp),
    }
    return Artefacts(files, report)


def _write_motions(plan: FrictionPlan, folder: Path, stamp: Stamp) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    limits = {design.joint: design.limits for design in plan.designs}
    for motion in plan.motions:
        path = folder / f"{motion.name}.csv"
        if motion.planned is not None:
            signals_of_pass = pass_reference(motion.planned, limits[motion.joint], plan.rate_hz)
            signals = {name: getattr(signals_of_pass, name) for name in ("position", "velocity", "acceleration")}
            write_signals(path, signals_of_pass.rate_hz, **signals)
        elif motion.torque is not None:
            write_signals(path, plan.rate_hz, torque=motion.torque)


def simulate_motions(study: Study, work: Work) -> Artefacts:
    """Simulate the motions of a friction study, each in a process: records.h5."""
    plan = stored.read_friction_plan(work.sources["design"])
    rig = SimulatedFrictionRig(study.as_robot(), study.experiment, plan, study.seed)
    records, report = measure_parts(work, rig.plan.motions, rig.measure)
    write = stored.write_friction_records
    return Artefacts({"records.h5": lambda path, stamp: write(path, records, stamp, rig.warm_ups())}, report)


def import_motions(study: Study, work: Work) -> Artefacts:
    """Import the logs of a friction study: records.h5."""
    joints = [joint.name for joint in study.friction_joints]
    payloads = {load.name: load.payload for load in study.as_friction().loads}
    with work.execution() as execution:
        logs = read_friction_logs(study.as_robot(), study.experiment, work.base, joints, payloads, execution.progress)
    notes = (*logs.notes, *notes_of(logs.records))
    files: dict[str, Write] = {
        "records.h5": lambda p, stamp: stored.write_friction_records(p, logs.records, stamp, logs.warm_ups, logs.notes)
    }
    return Artefacts(files, partial(report_count, notes, len(logs.records)))


def constant_velocity(study: Study, work: Work) -> Artefacts:
    """Estimate friction torques by speed, load and temperature, and regressions of motions: constant_velocity.h5."""
    measured, _ = stored.read_friction_records(work.sources["measure"]).divided(study.validation.configurations)
    joints = [joint for joint in study.friction_joints if joint.name in measured.joints]
    with work.execution() as execution:
        joint_fits = identify_sliding_friction(study.as_robot(), joints, measured, execution.progress)

    def report(console: Console) -> None:
        notes = notes_of(measured.records)
        console.notes(note for note in notes_of(joint_fits) if note not in notes)
        for fit in joint_fits:
            console.say(f"constant_velocity: joint {fit.joint}: {_fit_sentence(fit)}")

    file = {"constant_velocity.h5": lambda path, stamp: stored.write_constant_velocity(path, joint_fits, stamp)}
    return Artefacts(file, report)


def friction(study: Study, work: Work) -> Artefacts:
    """Fit friction: friction.h5, summary.json, identified_robot.yml; a failure gives a summary and FitError."""
    name, robot, validation_names = study.name, study.as_robot(), study.validation.configurations
    joint_fits = stored.read_constant_velocity(work.sources["constant_velocity"])
    measured, validation = stored.read_friction_records(work.sources["measure"]).divided(validation_names)
    simulated, recorded = study.experiment.simulated, study.experiment.recorded
    truth = None if simulated is None else true_robot(robot, simulated.truth)
    try:
        result = identify_friction(robot, joint_fits, measured, study.as_friction(), truth)
    except FitError as error:
        return Artefacts({"summary.json": as_json(failed_friction(name, str(error)))}, error=error)
    full_robot, controller = with_identified_friction(robot, result), None if recorded is None else recorded.controller
    with work.execution() as execution:
        comparison = compare_friction_logs(full_robot, result.joints, measured, controller, execution)
        prediction = predict_logs(full_robot, result.joints, validation, controller, execution)
    joint_notes = notes_of(joint_fits)

    def report(console: Console) -> None:
        console.notes(note for note in notes_of(result.joints) if note not in joint_notes)
        console.say(f"friction: {result.message}")
        for sentence in (*comparison.sentences, *(f"validation: {sentence}" for sentence in prediction.sentences)):
            console.say(f"friction: {sentence}")

    files: dict[str, Write] = {
        "summary.json": as_json(friction_study_summary(name, result, comparison, prediction)),
        "identified_robot.yml": text(robot_of_friction(name, robot, result)),
        "friction.h5": lambda path, stamp: stored.write_friction_result(path, result, stamp, comparison, prediction),
    }
    return Artefacts(files, report)


def report_friction(study: Study, work: Work) -> Artefacts:
    """Write the page and figures of a friction study."""
    content = _content(study.name, work.sources, work.stamp)
    drawings = friction_study_drawings(content.result, content.filters, content.log_comparison, content.left_out)
    return page_artefacts(partial(html_of_friction, content), drawings, study, work)


def _content(name: str, files: Mapping[str, Path], stamp: Stamp = NO_STAMP) -> FrictionContent:
    plan = stored.read_friction_plan(files["design"]) if "design" in files else None
    filters = stored.read_filter(files["follow"]) if "follow" in files else ()
    result, log_comparison = stored.read_friction_result(files["friction"]), stored.read_simulation(files["friction"])
    left_out = stored.read_validation_logs(files["friction"])
    return FrictionContent(name, result, stamp.study, stamp.entries, plan, filters, log_comparison, left_out)


def conclude(run: Run) -> None:
    """Print the parameters, the answers, the files, and in the last line the parts that were not identified."""
    content = _content(run.study.name, {"friction": run.path("friction")})
    result = content.result
    run.console.table(result_table(result.display, result.numbers))
    for refusal in refusals(result):
        if refusal.reason != NOT_ASKED:
            joints = f"joint{'s' if len(refusal.joints) > 1 else ''} {', '.join(refusal.joints)}"
            run.console.detail(f"{joints}: no {refusal.term}: {refusal.reason}")
    for question, sentences in content.short_questions:
        run.console.say(f"{question} {' '.join(sentences)}")
    run.say_files([*run.stages["report"].leaves, *run.stages["friction"].leaves[1:]])
    gaps = [f"joint {joint.joint}: {term_name(term)}" for joint in result.joints for term in joint.missing]
    if result.status == "failed":
        raise FitError("friction/no-record", f"{result.message} (see the notes above)", "no friction was identified")
    if result.status == "misfit":
        raise MisfitError("fit/misfit", result.message, "misfit")
    for joint in stored.read_filter(run.path("follow")) if "follow" in run.stages else ():
        if joint.consistency.divergence:
            raise FitError("filter/diverged", joint.consistency.divergence, f"filter of joint {joint.joint}")
    meaning = f"not identifiable: {', '.join(gaps)}" if gaps else "friction model of every joint"
    run.console.say(f"{result.status}: {meaning}")


def _fit_sentence(joint: SlidingFriction) -> str:
    unit = "m/s" if joint.slides else "rad/s"
    parts = []
    if (curve := joint.constant_velocity) is not None:
        parts.append(f"{curve.n_conditions} velocities from {curve.speed.min():.3g} to {curve.speed.max():.3g} {unit}")
    if joint.motion is not None:
        parts.append(f"trajectories, unexplained torque {joint.motion.regression.relative_error:.1%}")
        parts.append(joint.motion.time_summary)
    if (fit := joint.commanded) is not None:
        size = f"{number(fit.rms, 2)} {unit.removesuffix('/s')} rms ({fit.relative_error:.1%})"
        parts.append(f"{fit.seconds:.3g} s of commands, error of simulated position {size}")
    return ", ".join(parts) or "no log with sliding"


def track_friction(study: Study, work: Work) -> Artefacts:
    """Track friction of each joint over time by a Kalman filter: filter.h5."""
    measured = stored.read_friction_records(work.sources["measure"])
    result = stored.read_friction_result(work.sources["friction"])
    with work.execution() as execution:
        tracked, notes = track_joints(
            study.as_robot(), result.joints, measured.records, study.filter or FilterSpec(), execution.progress
        )

    def report(console: Console) -> None:
        console.notes([*notes, *notes_of(tracked)])
        for joint in tracked:
            console.say(f"follow: joint {joint.joint}: {_tracking_sentence(joint)}")

    return Artefacts({"filter.h5": lambda path, stamp: stored.write_filter(path, tracked, stamp)}, report)


def _tracking_sentence(tracked: TrackedFriction) -> str:
    ends = [
        f"{name} {number(tracked.values[-1, i])} ({number(tracked.low[-1, i])} to {number(tracked.high[-1, i])})"
        for i, name in enumerate(tracked.names)
    ]
    return f"final values {', '.join(ends)}; mean NIS {number(tracked.consistency.nis, 3)}; {tracked.verdict}"
