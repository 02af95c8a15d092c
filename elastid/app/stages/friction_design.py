"""design of a friction study: plan.h5, and references/*.csv of its passes."""

from __future__ import annotations

import shutil

from elastid.app.run import Run
from elastid.design.friction import design_friction
from elastid.experiment.plan.friction import FrictionPlan
from elastid.experiment.plan.passes import pass_reference
from elastid.store.design import write_pass_reference, write_torque_reference
from elastid.store.friction_study import write_friction_plan
from elastid.study import Study


def design(run: Run) -> None:
    """plan.h5, and references/<motion>.csv for a robot controller, within the robot's limits."""
    plan = friction_plan(run.study)
    _write_references(run, plan)
    write_friction_plan(run.path("design"), plan, run.stamps["design"])
    run.console.notes(plan.notes)
    run.console.say(
        f"design: {len(plan.motions)} motions of {len(plan.designs)} joints, {plan.robot_time_s / 60:.3g} min of the "
        "robot's time"
    )
    for sentence in (*plan.known, *plan.unknown):
        run.console.say(f"design: {sentence}")


def friction_plan(study: Study) -> FrictionPlan:
    """The plan of a study; StudyError for what the robot cannot do."""
    return design_friction(study.as_friction(), study.friction_joints, study.experiment, study.as_robot(), study.seed)


def _write_references(run: Run, plan: FrictionPlan) -> None:
    folder = run.folder / "references"
    shutil.rmtree(folder, ignore_errors=True)
    limits = {each.joint: each.limits for each in plan.designs}
    for motion in plan.motions:
        path = folder / f"{motion.name}.csv"
        if motion.planned is not None:
            write_pass_reference(path, pass_reference(motion.planned, limits[motion.joint], plan.rate_hz))
        elif motion.torque is not None:
            write_torque_reference(path, motion.torque, plan.rate_hz)
