"""Logs judged by rigid body and friction from other logs, compared with a regression of their own.

The torque of each joint in each log is divided into the parts of the model, and the robot with the identified friction
is simulated along the logs. A joint that moved alone has its own inertia and gravity; joints that moved together have
the base parameters of their rigid body, which hold for every motion of these joints, of one joint alone too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.execution import Execution
from elastid.experiment.specs.recorded import CascadeSpec
from elastid.friction_study.joint_levels import find_joint_levels, motion_logs, robot_log
from elastid.friction_study.motion import MotionFriction, RigidBody
from elastid.friction_study.motion_signals import Motion, MotionSignals
from elastid.friction_study.result import JointFriction
from elastid.friction_study.robot_motion import RobotLog, rigid_body_torques
from elastid.record import FrictionRecord, FrictionRecords
from elastid.robot import Robot
from elastid.validation.friction_twin import friction_balances, friction_runs
from elastid.validation.twin_run import Prediction, TwinFindings


def predict_logs(
    robot: Robot,
    joints: Sequence[JointFriction],
    measured: FrictionRecords,
    controller: CascadeSpec | None,
    execution: Execution | None = None,
) -> Prediction:
    """The logs of motions by the numbers of `joints`; robot: with their friction, for the simulations."""
    outcomes = list(_along_logs(robot, joints, measured))
    judged = [each for each in outcomes if isinstance(each, JointFriction)]
    reasons = [each for each in outcomes if not isinstance(each, JointFriction)]
    missing = {joint: "; ".join(text for name, text in reasons if name == joint) for joint, _ in reasons}
    runs = friction_runs(robot, judged, measured, controller, execution)
    twin = TwinFindings(friction_balances(judged, measured), runs)
    try:
        moved = [joint for joint in robot.driven if any(joint.name == each.joint for each in judged)]
        levels = find_joint_levels(robot, moved, measured)
    except DataError as error:
        return Prediction(twin, (), f"These logs have no regression of their own: {error}.", missing)
    regressed = [JointFriction(each.joint, each.slides, motion=_as_regressed(each.motion)) for each in levels]
    own = [each for each in _along_logs(robot, regressed, measured) if isinstance(each, JointFriction)]
    return Prediction(twin, friction_balances(own, measured), "", missing)


def _as_regressed(fit: MotionFriction | None) -> MotionFriction | None:
    """With the rigid body by least squares, which leaves least of its own logs."""
    if fit is None or fit.rigid_body is None:
        return fit
    return replace(fit, rigid_body=replace(fit.rigid_body, predicting=fit.rigid_body.values))


def _along_logs(
    robot: Robot, joints: Sequence[JointFriction], measured: FrictionRecords
) -> Iterator[JointFriction | tuple[str, str]]:
    """Each joint along each log in which it moves, or its name and the reason why it cannot be predicted there."""
    known = {joint.joint: joint for joint in joints}
    for log in motion_logs(measured):
        motions = robot_log(robot, log)
        rigid = cache(partial(_rigid_torques, robot, motions))  # of each rigid body once for all of its joints
        for name, record in log.items():
            try:
                yield _along(known.get(name), record, motions.motions, rigid)
            except DataError as error:
                yield name, f"{record.name}: {error}"


@dataclass(frozen=True)
class _Body:
    """A rigid body and the band of its regression, the same for all joints that moved together."""

    joints: tuple[str, ...]
    passband_hz: float
    body: RigidBody = field(compare=False)


def _rigid_torques(robot: Robot, log: RobotLog, of: _Body) -> Mapping[str, FloatArray]:
    return rigid_body_torques(robot, of.body, log, of.passband_hz)


def _along(
    source: JointFriction | None,
    record: FrictionRecord,
    motions: Mapping[str, Motion],
    rigid: Callable[[_Body], Mapping[str, FloatArray]],
) -> JointFriction:
    """The joint with its motion of a log, less the torque of a rigid body where it shares one; else DataError."""
    if source is None or source.motion is None:
        raise DataError("the result has no regression of a motion of it")
    if source.slides != record.slides:
        raise DataError("it slides in one of the two robots and turns in the other")
    fit, motion = source.motion, motions[record.joint]
    if fit.rigid_body is not None:
        body = _Body(fit.rigid_body.joints, fit.passband_hz, fit.rigid_body)
        motion = replace(motion, torque=motion.torque - rigid(body)[record.joint])
    elif len(motions) > 1:
        raise DataError("it moves with others, and alone in the logs of the result, which know no rigid body of all")
    else:
        motion = replace(motion, turns_against_gravity="gravity.cos" in fit.chosen.names)
    MotionSignals.of(motion, fit.passband_hz)  # DataError where the log is too short for it
    return replace(source, motion=replace(fit, motion=motion))
