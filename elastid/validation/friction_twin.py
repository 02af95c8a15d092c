r"""The twin of a friction study: torque of motions part by part, and a log simulated with the identified friction.

A joint that moved alone has inertia and gravity of its own; of joints that moved together the rigid body is what their
regression took out of the log, gravity and offset with it.

.. math:: M(q) \ddot q + f(q, \dot q) + \tau_f(\dot q, z) = B\, [u - (\tau_r - \hat \tau_r)]

tau_r is the rigid body's torque that the identification found in the log (for a joint alone its inertia, gravity and
offset), hat tau_r that of the robot's file, both along the logged motion: a counterbalance or a payload that the file
lacks acts on the twin as it does on the robot. Joints that rest are held by a loop of RESTING_HZ on the model's torque.

Logs are judged by the numbers of others, too (`predict_logs`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.execution import Execution
from elastid.experiment.simulated.plant import Plant
from elastid.experiment.specs.recorded import CascadeSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction_study.joint_levels import motion_log, motion_logs
from elastid.friction_study.motion import PARTS, MotionFriction, motion_parts, rigid_body_torques
from elastid.friction_study.motion_signals import MotionSignals
from elastid.friction_study.motion_terms import columns_of, full_rate_columns
from elastid.friction_study.result import JointFriction
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.record import Configuration, FrictionRecord, FrictionRecords, drive_unit, motion_unit
from elastid.robot import Robot
from elastid.robot.simplified import without_friction
from elastid.simulation.closed_loop import Commands, Trajectory
from elastid.simulation.controller import feed_forward, gains_of
from elastid.validation.twin import (
    DRY,
    GRAVITY,
    INERTIA,
    LINK,
    LONGEST_S,
    MOTION,
    RIGID_BODY,
    TORQUE,
    VISCOUS,
    Drive,
    SignalKind,
    TorqueBalance,
    TwinFindings,
    TwinRun,
    TwinSignal,
    follow,
    holding_gains,
    run_along,
    torque_balance,
)

# Parts of a regression as the twin names them.
PART_OF = dict(zip(PARTS, (INERTIA, GRAVITY, VISCOUS, DRY), strict=True))
# Bandwidth of the loop about the logged motion: below it gravity pulls an arm of a metre away faster than it is held.
HELD_HZ = 0.5


def friction_balances(joints: Iterable[JointFriction], measured: FrictionRecords) -> tuple[TorqueBalance, ...]:
    """Balances of joints with a regression of their motions, over the first log, in the regression's passband."""
    return tuple(
        _balance(joint.motion, _record_of(joint.motion, measured.of(joint.joint, "motion")))
        for joint in joints
        if joint.motion is not None and not joint.motion.motion.is_run_down
    )


def _record_of(motion: MotionFriction, records: Iterable[FrictionRecord]) -> FrictionRecord:
    """The log of a regression, whose torque holds the rigid body, with the smallest payload."""
    lightest = sorted(records, key=lambda record: record.payload)
    return next(record for record in lightest if np.array_equal(record.position, motion.motion.position))


def _balance(fit: MotionFriction, record: FrictionRecord) -> TorqueBalance:
    signals = MotionSignals.of(fit.motion, fit.passband_hz)
    parts: dict[str, FloatArray] = {}
    if "inertia" not in fit.chosen.names:
        parts[RIGID_BODY] = signals.filtered(record.torque - fit.motion.torque)
    numbers = motion_parts(fit.chosen, columns_of(signals, fit.terms))
    parts |= {PART_OF[name]: numbers[name] for name in PARTS if name in numbers}
    rate_hz = record.rate_hz / int(signals.kept.step)
    torque, band_hz = signals.filtered(record.torque), (0.0, fit.passband_hz)
    return torque_balance(
        f"joint {record.joint}", record.name, drive_unit(record.slides), rate_hz, torque, parts, band_hz
    )


@frozen_value
class _Log:
    """A log of n samples along which joints move: records and signals of those, the whole robot's motion (n, n_u).

    moving (n_u,): true for a joint that does.  torque (n, n_u): logged; rigid (n, n_u): found of the rigid body.
    """

    records: tuple[FrictionRecord, ...]
    signals: tuple[MotionSignals, ...]
    moving: tuple[bool, ...]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    rigid: FloatArray

    @property
    def rate_hz(self) -> float:
        """Rate of the samples."""
        return self.records[0].rate_hz


def friction_twin(
    robot: Robot,
    joints: Sequence[JointFriction],
    measured: FrictionRecords,
    controller: CascadeSpec | None,
    execution: Execution,
) -> TwinFindings:
    """Torque of motions part by part, and the twin along the first log of each group of joints that moved together.

    Under its torque and its reference.  robot: with the friction of `joints`.  controller: None where it is not known;
    no reference drives the twin then.
    """
    groups: dict[str, list[tuple[JointFriction, FrictionRecord]]] = {}
    for joint in joints:
        if joint.motion is not None and not joint.motion.motion.is_run_down and joint.friction is not None:
            record = _record_of(joint.motion, measured.of(joint.joint, "motion"))
            groups.setdefault(record.name, []).append((joint, record))
    driven: list[tuple[_Log, CascadeSpec | None]] = []
    for members in groups.values():
        log = _log(robot, members)
        driven.append((log, None))
        if controller is not None and all(record.reference is not None for record in log.records):
            driven.append((log, controller))
    runs = execution.ordered(partial(_run, robot), driven)
    return TwinFindings(friction_balances(joints, measured), tuple(runs))


def _log(robot: Robot, members: Sequence[tuple[JointFriction, FrictionRecord]]) -> _Log:
    names = [joint.name for joint in robot.driven]
    rate_hz = members[0][1].rate_hz
    n = min(len(members[0][1].position), round(LONGEST_S * rate_hz))
    posture = members[0][1].configuration
    angles = np.zeros(len(names)) if posture is None else posture.angles
    position = np.tile(angles, (n, 1))
    velocity, acceleration, torque, rigid = (np.zeros_like(position) for _ in range(4))
    signals = []
    for joint, record in members:
        assert joint.motion is not None
        i, motion = names.index(joint.joint), MotionSignals.of(joint.motion.motion, joint.motion.passband_hz)
        position[:, i], velocity[:, i] = motion.position[:n], motion.velocity[:n]
        acceleration[:, i], torque[:, i] = motion.acceleration[:n], record.torque[:n]
        rigid[:, i] = _rigid_torque(joint.motion, motion, record.torque)[:n]
        signals.append(motion)
    moving = tuple(name in [joint.joint for joint, _ in members] for name in names)
    return _Log(
        tuple(record for _, record in members), tuple(signals), moving, position, velocity, acceleration, torque, rigid
    )


def _rigid_torque(fit: MotionFriction, signals: MotionSignals, torque: FloatArray) -> FloatArray:
    """The torque (n,) at full rate of all that is no friction in its log: rigid body, gravity and offset.

    torque (n,): with the rigid body, of which a joint that moved with others has no numbers of its own.
    """
    if fit.rigid_body is not None:
        return torque - fit.motion.torque
    parts = motion_parts(fit.chosen, full_rate_columns(signals, fit.terms))
    return np.asarray(parts["inertia"] + parts.get("gravity", 0.0))


def _run(robot: Robot, driven: tuple[_Log, CascadeSpec | None]) -> TwinRun:
    """Run along a log, driven by its torque, or by its reference through a controller."""
    log, controller = driven
    drive: Drive = "torque" if controller is None else "reference"
    held_hz = HELD_HZ if controller is None else 0.0
    empty = TwinRun(log.records[0].name, drive, held_hz, len(log.position) / log.rate_hz, log.rate_hz)
    start = Configuration(log.records[0].name, log.position[0])
    spec = SimulatedSpec() if controller is None else SimulatedSpec(controller=controller.spec)
    run = run_along(empty, robot, start, spec, partial(_signals, log, controller))
    return replace(run, rate_hz=log.rate_hz / int(log.signals[0].kept.step)) if run.signals else run


def _signals(log: _Log, controller: CascadeSpec | None, plant: Plant) -> Iterator[TwinSignal]:
    """Signals of a plant under reference, torque and gains; joints that rest have the same in all."""
    q, moving = plant.point.q, np.array(log.moving)
    smooth = formulate(without_friction(plant.model.robot))
    demand = feed_forward(smooth, q, log.position - log.position[0], log.velocity, log.acceleration)
    lacking = np.where(moving, demand - log.rigid, 0.0)
    still = np.zeros_like(demand)
    if controller is None:
        # The plant holds a torque from sample to sample: the mean of both ends acts on it.
        acting = (log.torque + np.vstack([log.torque[1:], log.torque[-1:]])) / 2
        held = holding_gains(plant, HELD_HZ)
        # As the loop differentiates what it reads, so that its torque is of the error alone.
        position = log.position
        velocity = np.diff(position, axis=0, prepend=position[:1]) * log.rate_hz
    else:
        held = gains_of(plant.model, q, controller.spec)
        position, known = log.position.copy(), np.zeros_like(demand)
        for record, i in zip(log.records, np.flatnonzero(moving), strict=True):
            assert record.reference is not None
            position[:, i] = record.reference[: len(position)]
            if record.disturbance is not None:
                known[:, i] = record.disturbance[: len(position)]
        velocity = controller.velocity_feed_forward * np.gradient(position, 1 / log.rate_hz, axis=0)
        # The torque that the controller's integral holds at the start; 0 without an integral.
        error = held.kp * (position[0] - log.position[0]) + held.kd * (velocity[0] - log.velocity[0])
        acting = known + np.where(held.ki > 0, log.torque[0] - known[0] - error, 0.0)
    commands = Commands(position, velocity, np.where(moving, acting, demand), lacking, still)
    return _compared(log, plant.model, follow(plant, commands, moving, held, log.position[0], log.velocity[0]))


def _compared(log: _Log, model: ElasticModel, moved: Trajectory) -> Iterator[TwinSignal]:
    """Motion and torque of each joint that moves, and of its link where it was logged, in the passband."""
    names, n = [joint.name for joint in model.robot.driven], len(moved.u)
    for record, signals in zip(log.records, log.signals, strict=True):
        # Of a log that is not simulated to its end, without the rest.
        kept = replace(signals, kept=slice(signals.kept.start, min(signals.kept.stop, n), signals.kept.step))
        i, k = names.index(record.joint), model.index(f"joint {record.joint}")
        motor, turning = f"motor {record.joint}", motion_unit("position", record.slides)
        simulated = moved.reading[:, i], moved.u[:, i], moved.q[:, k]
        measured = record.position, record.torque, record.link_position
        kinds: tuple[SignalKind, ...] = (MOTION, TORQUE, LINK)
        places = (motor, turning), (motor, drive_unit(record.slides)), (f"joint {record.joint}", turning)
        for kind, (place, unit), y, y_twin in zip(kinds, places, measured, simulated, strict=True):
            if y is not None:
                yield TwinSignal(kind, place, unit, kept.filtered(y[:n]), kept.filtered(y_twin[:n]))


def predict_logs(
    robot: Robot,
    joints: Sequence[JointFriction],
    measured: FrictionRecords,
    controller: CascadeSpec | None,
    execution: Execution,
) -> TwinFindings:
    """The logs of motions by the numbers of `joints`; robot: with their friction, for the simulations."""
    known, judged = {joint.joint: joint for joint in joints}, list[JointFriction]()
    reasons = dict[str, list[str]]()
    for log in motion_logs(measured):
        for name, record in log.items():
            try:
                judged.append(_along(robot, known.get(name), record, log))
            except DataError as error:
                reasons.setdefault(name, []).append(f"{record.name}: {error}")
    missing = {name: "; ".join(texts) for name, texts in reasons.items()}
    return replace(friction_twin(robot, judged, measured, controller, execution), missing=missing)


def _along(
    robot: Robot, source: JointFriction | None, record: FrictionRecord, log: Mapping[str, FrictionRecord]
) -> JointFriction:
    """The joint with its motion of a log, less the torque of a rigid body where it shares one; else DataError."""
    if source is None or source.motion is None:
        raise DataError("predict/mismatch", "the result has no regression of a motion of it")
    if source.slides != record.slides:
        raise DataError("predict/mismatch", "it slides in one of the two robots and turns in the other")
    fit = source.motion
    signals = motion_log(robot, log, fit.passband_hz)
    motion = signals.of_joints[record.joint].motion
    if fit.rigid_body is not None:
        rigid = rigid_body_torques(robot, fit.rigid_body, signals)
        motion = replace(motion, torque=motion.torque - rigid[record.joint])
    elif len(log) > 1:
        raise DataError(
            "predict/mismatch",
            "it moves with others, and alone in the logs of the result, which know no rigid body of all",
        )
    else:
        motion = replace(motion, turns_against_gravity="gravity.cos" in fit.chosen.names)
    return replace(source, motion=replace(fit, motion=motion))
