r"""Torque balances of friction motions, and simulation along their logs with the identified friction.

The components of a balance are those of the regression. A joint that moved alone has its own inertia and gravity;
joints that moved together have a common rigid body with gravity and offset. The simulation along a log is

.. math:: M(q) \ddot q + f(q, \dot q) + \tau_f(\dot q, z) = B\, [u - (\tau_r - \hat \tau_r)]

tau_r: rigid-body torque that was identified from the log; hat tau_r: of the robot model; both along the logged motion.
A counterbalance or payload that is missing in the robot model therefore acts on it as on the robot. A loop of 5 Hz
holds the other joints. `predict_logs` uses the numbers of another study.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.execution import Execution
from elastid.experiment.simulated.plant import Plant
from elastid.experiment.specs.logs import CascadeSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.inverse_dynamics_regression import TORQUE_COMPONENTS, MotionFriction, torque_components
from elastid.friction_study.motion_signals import MotionSignals
from elastid.friction_study.regressor import columns_of, full_rate_columns
from elastid.friction_study.result import JointFriction
from elastid.friction_study.rigid_body_columns import rigid_body_torques
from elastid.friction_study.sliding_friction import motion_log, motion_logs, simulated_commands
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.record import Configuration, drive_unit, motion_unit
from elastid.robot import Robot
from elastid.robot.simplified import without_friction
from elastid.simulation.closed_loop import Commands, Trajectory
from elastid.simulation.controller import feed_forward, gains_of
from elastid.validation.log_comparison import (
    DRY,
    GRAVITY,
    INERTIA,
    LINK,
    MOTION,
    RIGID_BODY,
    TORQUE,
    VISCOUS,
    ComparedSignal,
    Drive,
    LogComparison,
    LogSimulation,
    SignalKind,
    TorqueBalance,
)
from elastid.validation.simulation import LONGEST_S, simulate_log, simulate_tracking, tracking_gains
from elastid.validation.torque_balance import torque_balance

# Components of a torque balance by those of a regression.
PART_OF = dict(zip(TORQUE_COMPONENTS, (INERTIA, GRAVITY, VISCOUS, DRY), strict=True))


def friction_balances(joints: Iterable[JointFriction], measured: FrictionRecords) -> tuple[TorqueBalance, ...]:
    """Return the balances of joints with a regression of their motions, over the first log, in its passband."""
    return tuple(
        _balance(joint.motion, _record_of(joint.motion, measured.of(joint.joint, "motion")))
        for joint in joints
        if joint.motion is not None and not joint.motion.motion.is_run_down
    )


def _record_of(motion: MotionFriction, records: Iterable[FrictionRecord]) -> FrictionRecord:
    """Return the record of a motion, with the smallest payload if several records have its positions."""
    lightest = sorted(records, key=lambda record: record.payload)
    return next(record for record in lightest if np.array_equal(record.position, motion.motion.position))


def _balance(fit: MotionFriction, record: FrictionRecord) -> TorqueBalance:
    signals = MotionSignals.of(fit.motion, fit.passband_hz)
    components = {}
    if "inertia" not in fit.regression.names:
        components[RIGID_BODY] = signals.filtered(record.torque - fit.motion.torque)
    numbers = torque_components(fit.regression, columns_of(signals, fit.terms))
    components |= {PART_OF[name]: numbers[name] for name in TORQUE_COMPONENTS if name in numbers}
    rate_hz = record.rate_hz / int(signals.decimation.step)
    torque, band_hz = signals.filtered(record.torque), (0.0, fit.passband_hz)
    return torque_balance(
        f"joint {record.joint}", record.name, drive_unit(record.slides), rate_hz, torque, components, band_hz
    )


# Bandwidth of the loop about the logged motion; a slower loop does not hold an arm of a metre against gravity.
TRACKING_HZ = 0.5


@frozen_value
class _Log:
    """Log of n samples in which the joints `moving_motors` (indices) move, with their regressions and records.

    posture (n_u,): angles of the other joints.  E (n_u, n_u): `robot.mixing`.
    """

    n: int
    posture: FloatArray
    E: FloatArray
    moving_motors: tuple[int, ...]
    regressions: tuple[MotionFriction, ...]
    records: tuple[FrictionRecord, ...]
    signals: tuple[MotionSignals, ...]

    @classmethod
    def of(cls, robot: Robot, members: Sequence[tuple[MotionFriction, FrictionRecord]]) -> "_Log":
        """Return the log of joints that moved together, up to LONGEST_S."""
        names, (regressions, records) = robot.driven_names, zip(*members, strict=True)
        n, posture = round(LONGEST_S * records[0].rate_hz), records[0].angles(len(names))
        signals = tuple(MotionSignals.of(fit.motion, fit.passband_hz) for fit in regressions)
        moving_motors = tuple(names.index(record.joint) for record in records)
        n = min(len(records[0].position), n)
        return cls(n, posture, robot.mixing, moving_motors, regressions, records, signals)

    def joint_values(self, columns: Iterable[FloatArray], rest: FloatArray | float = 0.0) -> FloatArray:
        """Return values (n, n_u) of all joints from the columns (n,) of moving motors and the values of the rest."""
        values = np.full((self.n, len(self.posture)), self.E @ rest if np.ndim(rest) else rest)
        for i, column in zip(self.moving_motors, columns, strict=True):
            values[:, i] = column[: self.n]
        return np.linalg.solve(self.E, values.T).T

    def torques(self, columns: Iterable[FloatArray]) -> FloatArray:
        """Return torques (n, n_u) on all joints from the torques (n,) of the moving motors."""
        return self.joint_values(columns) @ self.E.T @ self.E

    @property
    def position(self) -> FloatArray:
        """Angles (n, n_u) of the motors."""
        return self.joint_values((signals.position for signals in self.signals), self.posture)


def compare_friction_logs(
    robot: Robot, joints: Sequence[JointFriction], measured: FrictionRecords, controller: CascadeSpec | None,
    execution: Execution
) -> LogComparison:  # fmt: skip
    """Balance the torque of motions, and simulate the first log of each group of joints that moved together.

    The input is the logged torque, and with a known controller also the reference.  robot: with the friction of
    `joints`.
    """
    groups: dict[str, list[tuple[MotionFriction, FrictionRecord]]] = {}
    for joint in joints:
        if joint.motion is not None and not joint.motion.motion.is_run_down and joint.friction is not None:
            record = _record_of(joint.motion, measured.of(joint.joint, "motion"))
            groups.setdefault(record.name, []).append((joint.motion, record))
    driven: list[tuple[_Log, CascadeSpec | None]] = []
    for members in groups.values():
        log = _Log.of(robot, members)
        driven.append((log, None))
        if controller is not None and all(record.reference is not None for record in log.records):
            driven.append((log, controller))
    runs = execution.ordered(partial(_run, robot), driven)
    by_commands = _commanded_runs(robot, joints, motion_logs(measured, "commands")[:1])
    return LogComparison(friction_balances(joints, measured), (*runs, *by_commands))


def _commanded_runs(
    robot: Robot, joints: Sequence[JointFriction], logs: Iterable[Mapping[str, FrictionRecord]]
) -> Iterator[LogSimulation]:
    """Yield simulations along logs without torques, from their commands alone."""
    fits = {joint.joint: joint.commanded for joint in joints if joint.commanded is not None}
    for records in logs:
        log = {name: record for name, record in records.items() if name in fits}
        if not log:
            continue
        first, trajectory = next(iter(log.values())), simulated_commands(robot, log, fits)
        signals = tuple(
            ComparedSignal(MOTION, f"motor {name}", record.unit, record.position, simulated)
            for (name, record), simulated in zip(log.items(), trajectory.T, strict=True)
        )
        yield LogSimulation(first.name, "reference", 0.0, first.duration_s, first.rate_hz, signals)


def _rigid_torque(fit: MotionFriction, signals: MotionSignals, record: FrictionRecord) -> FloatArray:
    """Return the torque (n,) of rigid body, gravity and offset in a log, at full rate."""
    if fit.rigid_body is not None:  # of joints that moved together
        return record.torque - fit.motion.torque
    components = torque_components(fit.regression, full_rate_columns(signals, fit.terms))
    return components["inertia"] + components.get("gravity", 0.0)


def _run(robot: Robot, driven: tuple[_Log, CascadeSpec | None]) -> LogSimulation:
    log, controller = driven
    drive: Drive = "torque" if controller is None else "reference"
    tracking_hz = TRACKING_HZ if controller is None else 0.0
    name, rate_hz = log.records[0].name, log.records[0].rate_hz
    empty = LogSimulation(name, drive, tracking_hz, log.n / rate_hz, rate_hz)
    start = Configuration(name, log.position[0])
    spec = SimulatedSpec() if controller is None else SimulatedSpec(controller=controller.spec)
    run = simulate_log(empty, robot, start, spec, partial(_along_motion, log, controller))
    return replace(run, rate_hz=rate_hz / int(log.signals[0].decimation.step)) if run.signals else run


def _along_motion(log: _Log, controller: CascadeSpec | None, plant: Plant) -> Iterator[ComparedSignal]:
    """Yield the compared signals of a plant along a log; joints that do not move have the same commands in all runs."""
    q, moving_motors = plant.point.q, np.isin(np.arange(len(log.posture)), log.moving_motors)
    smooth, path = formulate(without_friction(plant.model.robot)), log.position
    rate = log.joint_values(signals.velocity for signals in log.signals)
    curvature = log.joint_values(signals.acceleration for signals in log.signals)
    torque = log.torques(record.torque for record in log.records)
    demand = feed_forward(smooth, q, path - path[0], rate, curvature)
    rigid = log.torques(map(_rigid_torque, log.regressions, log.signals, log.records))
    if controller is None:
        # The plant has a zero-order hold: the mean of both ends of a sample acts on it.
        acting = (torque + np.vstack([torque[1:], torque[-1:]])) / 2
        gains = tracking_gains(plant, TRACKING_HZ)
        # The same difference quotient as the loop's, so that its torque depends on the error alone.
        position, velocity = path, np.diff(path, axis=0, prepend=path[:1]) * plant.loop.rate_hz
    else:
        gains, zeros = gains_of(plant.model, q, controller.spec), np.zeros(log.n)
        references = (record.reference for record in log.records if record.reference is not None)
        position = log.joint_values(references, log.posture)
        load = log.torques(zeros if record.disturbance is None else record.disturbance for record in log.records)
        velocity = controller.velocity_feedforward * np.gradient(position, 1 / plant.loop.rate_hz, axis=0)
        # Initial torque of the controller's integral; 0 without an integral.
        error = gains.kp * (position[0] - path[0]) + gains.kd * (velocity[0] - rate[0])
        acting = load + np.where(gains.ki > 0, torque[0] - load[0] - error, 0.0)
    correction = np.where(moving_motors, demand - rigid, 0.0)
    commands = Commands(position, velocity, np.where(moving_motors, acting, demand), correction, np.zeros_like(demand))
    return _in_passband(log, plant.model, simulate_tracking(plant, commands, moving_motors, gains, path[0], rate[0]))


def _in_passband(log: _Log, model: ElasticModel, trajectory: Trajectory) -> Iterator[ComparedSignal]:
    """Yield motion and torque of each moving joint, and its link motion if logged, in the passband."""
    position, u = trajectory.reading @ log.E.T, trajectory.u @ np.linalg.inv(log.E)
    for i, record, signals in zip(log.moving_motors, log.records, log.signals, strict=True):
        # The simulation may end before its log.
        samples = signals.decimation
        simulated = replace(signals, decimation=slice(samples.start, min(samples.stop, log.n), samples.step))
        motor, link = f"motor {record.joint}", f"joint {record.joint}"
        unit, torque_unit = motion_unit("position", record.slides), drive_unit(record.slides)
        rows: tuple[tuple[SignalKind, str, str, FloatArray | None, FloatArray], ...] = (
            (MOTION, motor, unit, record.position, position[:, i]),
            (TORQUE, motor, torque_unit, record.torque, u[:, i]),
            (LINK, link, unit, record.link_position, trajectory.q[:, model.index(link)]),
        )
        for kind, location, unit_of_row, y, y_model in rows:
            if y is not None:
                yield ComparedSignal(
                    kind, location, unit_of_row, *(simulated.filtered(x[: log.n]) for x in (y, y_model))
                )


def predict_logs(
    robot: Robot, joints: Sequence[JointFriction], measured: FrictionRecords, controller: CascadeSpec | None,
    execution: Execution
) -> LogComparison:  # fmt: skip
    """Predict the logs of motions with the numbers of `joints` from another study; robot: with their friction."""
    by_name, predicted = {joint.joint: joint for joint in joints}, list[JointFriction]()
    reasons = dict[str, list[str]]()
    for log in motion_logs(measured):
        for name, record in log.items():
            try:
                predicted.append(_along(robot, by_name.get(name), record, log))
            except DataError as error:
                reasons.setdefault(name, []).append(f"{record.name}: {error}")
    missing = {name: "; ".join(texts) for name, texts in reasons.items()}
    findings = compare_friction_logs(robot, predicted, measured, controller, execution)
    by_commands = _commanded_runs(robot, joints, motion_logs(measured, "commands"))
    return replace(findings, runs=(*findings.runs, *by_commands), missing=missing)


def _along(
    robot: Robot, source: JointFriction | None, record: FrictionRecord, log: Mapping[str, FrictionRecord]
) -> JointFriction:
    """Return the joint with its motion of a log, without the torque of a common rigid body.

    Raises DataError if the result does not apply to this motion.
    """
    if source is None or source.motion is None:
        raise DataError("predict/mismatch", "the result has no regression of a motion of this joint")
    if source.slides != record.slides:
        raise DataError("predict/mismatch", "the joint slides in one of the two robots and turns in the other")
    fit = source.motion
    signals = motion_log(robot, log, fit.passband_hz)
    motion = signals.signals[record.joint].motion
    if fit.rigid_body is not None:
        rigid = rigid_body_torques(robot, fit.rigid_body, signals)
        motion = replace(motion, torque=motion.torque - rigid[record.joint])
    elif len(log) > 1:
        text = "the joint moves with others, but alone in the logs of the result, which has no common rigid body"
        raise DataError("predict/mismatch", text)
    else:
        motion = replace(motion, turns_against_gravity="gravity.cos" in fit.regression.names)
    return replace(source, motion=replace(fit, motion=motion))
