"""predict: the friction that one study has identified, judged on the logs of another: prediction.json.

Of a joint that moved alone all its numbers are those of the result. Of joints that moved together the result has no
rigid body; that of the logs is taken, and their friction alone is predicted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from elastid.app.identified_robot import with_identified_friction
from elastid.app.run import Run, carry_out, logged_in
from elastid.app.summaries import prediction_summary
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.friction_study.result import FrictionResult, JointFriction, JointLevels
from elastid.record import FrictionRecords
from elastid.store.files import keep_checksums, write_text
from elastid.store.friction_study import read_friction_records, read_friction_result, read_levels
from elastid.validation.friction_twin import friction_balances, friction_runs
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings


def predict(run: Run, source: Path) -> None:
    """prediction.json: torque and forward motion along the logs of a study by the friction of `source`, and by its own.

    source: a friction.h5, or the folder that holds it.  Stages up to levels are run where they are out of date.
    StudyError for a study without friction, or where no joint has a motion in both.
    """
    if "friction" not in run.stages:
        raise StudyError(
            f"{run.loaded.path}: the study identifies elasticity, and friction alone can be predicted; give friction: "
            "{} in a study of these logs"
        )
    path = source / "friction.h5" if source.is_dir() else source
    if not path.is_file():
        raise StudyError(f"--with {source}: {path.name} is not there; name the run folder of a study of friction")
    result = read_friction_result(path)
    with logged_in(run.folder, run.jobs, run.console):
        for name in list(run.stages)[: list(run.stages).index("levels") + 1]:
            if not run.is_current(name):
                carry_out(run, name)
        levels, measured = read_levels(run.path("levels")), read_friction_records(run.path("measure"))
        missing = dict(_missing(result, levels))
        for joint, reason in missing.items():
            run.console.warn(f"joint {joint} is not predicted: {reason}")
        known = [each for each in levels if each.joint not in missing]
        if not known:
            raise StudyError(f"--with {path}: none of its joints can be predicted on these logs; the reasons are above")
        own = [JointFriction(each.joint, each.slides, motion=each.motion) for each in known]
        left = {balance.place: balance.left for balance in friction_balances(own, measured)}
        twin = _twin(run, result, predicted(result, own), measured)
        summary = prediction_summary(run.study.name, str(path), twin, left, missing)
        path = run.folder / "prediction.json"
        write_text(path, summary)
        keep_checksums(run.folder, [path.name])
        for balance in twin.balances:
            words = f"{describe_balance(balance)} A regression of these logs leaves {left[balance.place]:.1%}."
            run.console.say(f"predict: {words}")
        for words in (*twin.run_words, str(path)):
            run.console.say(f"predict: {words}")


def _twin(run: Run, result: FrictionResult, joints: Sequence[JointFriction], measured: FrictionRecords) -> TwinFindings:
    recorded = run.study.experiment.recorded
    controller = None if recorded is None else recorded.controller
    robot = with_identified_friction(run.study.as_robot(), result)
    runs = friction_runs(robot, joints, measured, controller, Execution(run.jobs))
    return TwinFindings(friction_balances(joints, measured), runs)


def predicted(result: FrictionResult, own: Sequence[JointFriction]) -> list[JointFriction]:
    """The joints along their own motions, with the numbers of a result."""
    known, joints = {joint.joint: joint for joint in result.joints}, []
    for each in own:
        source = known[each.joint]
        assert each.motion is not None
        numbers = {name: getattr(source.motion, name) for name in ("alike", "apart", "are_apart", "chance")}
        joints.append(replace(source, motion=replace(each.motion, **numbers)))
    return joints


def _missing(result: FrictionResult, levels: Sequence[JointLevels]) -> Iterator[tuple[str, str]]:
    """(joint, reason) of those of the logs that the result cannot predict."""
    known = {joint.joint: joint for joint in result.joints}
    for level in levels:
        source = known.get(level.joint)
        if source is None:
            yield level.joint, f"the result has the joints {', '.join(known)} only"
        elif source.motion is None or source.friction is None:
            yield level.joint, "the result has no regression of a motion of it"
        elif level.motion is None:
            yield level.joint, "it has no motion in these logs"
        elif source.slides != level.slides:
            yield level.joint, "it slides in one of the two robots and turns in the other"
        elif ("inertia" in source.motion.chosen.names) != ("inertia" in level.motion.chosen.names):
            yield level.joint, "it moved alone in one of the two, and with others in the other"
