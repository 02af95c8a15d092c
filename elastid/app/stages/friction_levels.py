"""levels: records of a friction study -> levels.h5."""

from __future__ import annotations

from elastid.app.run import Run
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.result import JointLevels
from elastid.store.friction_study import read_friction_records, write_levels


def levels(run: Run) -> None:
    """levels.h5: friction at each speed, load and temperature, and what each joint's motions tell."""
    measured = read_friction_records(run.path("measure"))
    joints = [joint for joint in run.study.friction_joints if joint.name in measured.joints]
    found = find_joint_levels(run.study.as_robot(), joints, measured)
    write_levels(run.path("levels"), found, run.stamps["levels"])
    run.console.notes(note for each in found for note in each.notes)
    for each in found:
        run.console.say(f"levels: joint {each.joint}: {_words(each)}")


def _words(found: JointLevels) -> str:
    unit = "m/s" if found.slides else "rad/s"
    said = []
    if found.levels is not None:
        one = found.levels.levels
        said.append(f"{one.n_levels} levels from {one.speed.min():.3g} to {one.speed.max():.3g} {unit}")
    if found.motion is not None:
        left = found.motion.chosen.relative_error
        said.append(f"a motion, {left:.1%} of whose torque inertia, gravity and friction leave")
    return ", ".join(said)
