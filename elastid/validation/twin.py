r"""The twin of a robot moved along a log, simulated forwards, by its torque or under its controller.

.. math:: error_i = \sqrt{\overline{(y_i - \hat y_i)^2}} \,/\, \sqrt{\overline{(y_i - \bar y_i)^2}}

What drives the twin is one of two:

`reference`: that of the robot's controller, through the same controller. Motion and torque are the twin's own.
`torque`: that of the log. A robot under a torque alone drifts, since its motors have no springs and gravity may pull it
further away; so a loop about the logged motion, slower than what is judged, holds the twin. The torque that this loop
adds is what the model lacks at low frequencies, and is shown as error of the torque.

Along a record signals are compared at all lines between the lowest and the highest of the response, in the last period
that counts. Below them the twin is held by a loop of a fifth of the lowest line; an error at that line is changed by
4 % in its amplitude, higher ones by less. The torque between samples is that of the record's hold; its mean is the
holding torque of the model, since that of a log contains what no response shows.

Along the log of a motion

.. math:: M(q) \ddot q + f(q, \dot q) + \tau_f(\dot q, z) = B\, [u - (\tau_r - \hat \tau_r)]

tau_r is the rigid body's torque that the identification found in the log (for a joint alone its inertia, gravity and
offset), hat tau_r that of the robot's file, both along the logged motion: a counterbalance or a payload that the file
lacks acts on the twin as it does on the robot. Joints that rest are held by a loop of 5 Hz on the model's torque.
Logs are judged by the numbers of others, too (`predict_logs`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Execution
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import synthesise
from elastid.experiment.simulated.hardware import filter_motions, logged_quantity, sense
from elastid.experiment.simulated.plant import Plant, true_plant
from elastid.experiment.specs.recorded import CascadeSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction_study.joint_levels import motion_log, motion_logs
from elastid.friction_study.motion import MotionFriction, motion_parts, rigid_body_torques
from elastid.friction_study.motion_signals import MotionSignals
from elastid.friction_study.motion_terms import full_rate_columns
from elastid.friction_study.result import JointFriction
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration, FrictionRecord, FrictionRecords, Record, drive_unit, motion_unit
from elastid.robot import Robot
from elastid.robot.simplified import without_friction
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import Gains, feed_forward, gains_of, rigid_motion, rigid_path, tune
from elastid.validation.torque_balance import (
    TorqueBalance,
    describe_balance,
    friction_balances,
    last_counted,
    last_period,
    record_of,
)

Drive: TypeAlias = Literal["reference", "torque"]
SignalKind: TypeAlias = Literal["torque", "motor angle", "link motion"]
TORQUE: Final = "torque"
MOTION: Final = "motor angle"
LINK: Final = "link motion"
_DRIVES = {"reference": "reference through its controller", "torque": "torque"}
# Of a log this much is simulated at most.
LONGEST_S = 30.0


@frozen_value
class TwinSignal:
    """One signal (n,) of a log and of its twin, link side, in SI, at rate_hz of its run."""

    kind: SignalKind
    place: str
    unit: str
    measured: FloatArray = labelled("as measured, link side", "{unit}", "sample")
    simulated: FloatArray = labelled("of the twin", "{unit}", "sample")

    @property
    def error(self) -> float:
        """Rms error over the rms of the signal about its mean."""
        rms = float(np.sqrt(np.mean((self.measured - self.simulated) ** 2)))
        return rms / max(float(np.std(self.measured)), 1e-300)


@dataclass(frozen=True)
class TwinRun:
    """The twin moved along one log.

    held_hz: bandwidth of the loop about the logged motion, 0 under the controller's reference.  seconds: of the log
    that were simulated.  lost: why there is no result; empty where there is.
    """

    log: str
    drive: Drive
    held_hz: float
    seconds: float
    rate_hz: float
    signals: tuple[TwinSignal, ...] = ()
    lost: str = ""

    def of(self, kind: SignalKind) -> tuple[TwinSignal, ...]:
        """The signals of a kind."""
        return tuple(signal for signal in self.signals if signal.kind == kind)


@dataclass(frozen=True)
class TwinFindings:
    """The torque of logs part by part, and the twin moved along them; missing: joints not predicted there, and why."""

    balances: tuple[TorqueBalance, ...] = ()
    runs: tuple[TwinRun, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def run_words(self) -> tuple[str, ...]:
        """Errors of the twin in each run."""
        return tuple(map(describe_run, self.runs))

    @property
    def words(self) -> tuple[str, ...]:
        """The torque of each joint, then the simulations."""
        return (*map(describe_balance, self.balances), *self.run_words)


NO_TWIN = TwinFindings()


def describe_run(run: TwinRun) -> str:
    """Errors of the twin along its log, in a sentence or two."""
    if run.lost:
        return f"Simulated forwards on {run.log}, driven by its {_DRIVES[run.drive]}, the twin is lost: {run.lost}."
    held = f", held on the log by a loop of {run.held_hz:.2g} Hz" if run.held_hz else ""
    errors = {kind: [100 * signal.error for signal in run.of(kind)] for kind in (MOTION, TORQUE, LINK)}
    parts = [f"{kind} at most {max(values):.3g} %" for kind, values in errors.items() if values]
    return (
        f"Simulated forwards over {run.seconds:.3g} s of {run.log}, driven by its {_DRIVES[run.drive]}{held}, the twin "
        f"is off by (rms error over rms signal): {'; '.join(parts)}."
    )


def _run_along(
    empty: TwinRun,
    robot: Robot,
    start: Configuration,
    spec: SimulatedSpec,
    moved: Callable[[Plant], Iterable[TwinSignal]],
) -> TwinRun:
    """The run of a robot along a log, or why it is lost; empty: without its signals, at the rate of the samples.

    spec: equations and controller of its plant.  moved: the signals of that, without limits, at rest at the start.
    """
    try:
        plant = true_plant(robot, spec, empty.rate_hz, start, is_free=True)
        return replace(empty, signals=tuple(moved(plant)))
    except (DataError, StudyError) as error:
        return replace(empty, lost=str(error))


def _holding_gains(plant: Plant, bandwidth_hz: float) -> Gains:
    """Gains of a loop about the logged motion, damped critically, so that it adds no resonance."""
    return tune(plant.model, plant.point.q, bandwidth_hz, 1.0)


def _follow(
    plant: Plant, commands: Commands, moving: BoolArray, held: Gains, position: FloatArray, velocity: FloatArray
) -> Trajectory:
    """Trajectory from position and velocity (n_u,) of the motors; DataError where one is lost.

    held: gains of motors that move (n_u,); others are held by a loop of 5 Hz.
    """
    model, point, resting = plant.model, plant.point, _holding_gains(plant, 5.0)
    gains = Gains(*(np.where(moving, getattr(held, name), getattr(resting, name)) for name in ("kp", "kd", "ki")))
    (q,) = rigid_path(model, point.q, point.configuration.angles, position[None])
    return simulate(plant.loop, gains, commands, q, v0=rigid_motion(model, q) @ velocity)


def elastic_runs(
    record: Record, robot: Robot, band_hz: tuple[float, float], delay_s: float = 0.0, spec: ModelSpec = EXACT
) -> tuple[TwinRun, ...]:
    """The run along a record, driven by its torque and compared within band_hz; none without a rate.

    robot: with its fitted elasticity and friction.  delay_s: of its torques.  spec: the equations that it has.  Of a
    record without a period at most LONGEST_S from its beginning are simulated.
    """
    if not record.rate_is_known:
        return ()
    n = round(LONGEST_S * record.rate_hz)
    if not record.is_periodic and record.n_samples > n:
        record = replace(record, u=record.u[:n], y=record.y[:n], r=None, period_samples=n)
    held_hz = 0.2 * band_hz[0]
    empty = TwinRun(record.name, "torque", held_hz, record.period_samples / record.rate_hz, record.rate_hz)
    moved = partial(_along_record, record, held_hz, band_hz, delay_s)
    return (_run_along(empty, robot, record.configuration, SimulatedSpec(model=spec), moved),)


def _along_record(
    record: Record, held_hz: float, band_hz: tuple[float, float], delay_s: float, plant: Plant
) -> Iterator[TwinSignal]:
    """Signals of a plant under the torque of the last period of a record, over and over, held on its motion."""
    model, angles, chain = plant.model, record.configuration.angles, plant.model.robot.chain
    N, motors = record.period_samples, [model.inputs.index(place) for place in record.inputs]
    last = last_counted(record.n_periods, {index // (2 if record.half_wave else 1) for index in record.left_out})
    period = slice(last * N, (last + 1) * N)
    position = np.tile(angles, (N, 1))
    for i, place in zip(motors, record.inputs, strict=True):
        if (place, "position") in zip(record.outputs, record.quantities, strict=True):
            position[:, i] = record.y[period, record.outputs.index(place)] / chain.gain("y", place)
    # As the loop differentiates what it reads, so that its torque is of the error alone.
    velocity = (position - np.roll(position, 1, axis=0)) * record.rate_hz
    if not record.is_periodic:
        velocity[0] = velocity[1]
    torque = np.tile(plant.point.u, (N, 1))
    torque[:, motors] += _held(record, record.u[period]) / [chain.gain("u", place) for place in record.inputs]
    period_s = N / record.rate_hz
    # A critically damped loop leaves a thousandth of an error at the start after one and a half of its periods.
    lead = min(max(0, math.floor(LONGEST_S / period_s) - 1), math.ceil(1.5 / held_hz / period_s))
    lead = lead if record.is_periodic else 0  # periods before the one that is compared
    still = np.zeros(((lead + 1) * N, model.n_u))
    path, rate, driving = (np.tile(signal, (lead + 1, 1)) for signal in (position, velocity, torque))
    commands = Commands(path, rate, driving, still, still)
    moving, held = np.isin(np.arange(model.n_u), motors), _holding_gains(plant, held_hz)
    return _in_band(record, band_hz, delay_s, plant, _follow(plant, commands, moving, held, position[0], velocity[0]))


def _logged(record: Record, plant: Plant, moved: Trajectory) -> Record:
    """The last period of a trajectory as it would be logged."""
    N, model, chain = record.period_samples, plant.model, plant.model.robot.chain
    y = sense(moved.q, moved.reading, model, plant.point.q, record.outputs, record.rate_hz, N)
    y = filter_motions(model.robot, y, record.rate_hz) * [chain.gain("y", place) for place in record.outputs]
    motors = [model.inputs.index(place) for place in record.inputs]
    u = moved.u[:, motors] * [chain.gain("u", place) for place in record.inputs]
    return replace(
        record, u=u[-N:], y=y[-N:], r=None, left_out=(), hold="zero-order", hold_samples=(),
        quantities=tuple(logged_quantity(place) for place in record.outputs), sampled=(True,) * len(record.outputs),
    )  # fmt: skip


def _held(record: Record, u: FloatArray) -> FloatArray:
    """The command (N, n_u), held from sample to sample, whose torque acts as that of one period u does; no mean."""
    N = record.period_samples
    freq_hz = line_frequencies(np.arange(N // 2 + 1), record.rate_hz, N)
    held = replace(record, hold="zero-order", hold_samples=())
    factor = record.hold_response(freq_hz) / held.hold_response(freq_hz)
    factor[0] = 0.0
    return np.asarray(np.fft.irfft(np.fft.rfft(u, axis=0) * factor, N, axis=0))


def _in_band(
    record: Record, band_hz: tuple[float, float], delay_s: float, plant: Plant, moved: Trajectory
) -> Iterator[TwinSignal]:
    """Torques and motions of the last period, at the lines within the band."""
    N = record.period_samples
    lines = grid_lines("odd" if record.half_wave else "full", band_hz, record.rate_hz, N)
    late = np.exp(-2j * np.pi * line_frequencies(lines, record.rate_hz, N) * delay_s)[:, None]

    def in_time(log: Record, factor: ComplexArray | float) -> FloatArray:
        (Y,), (U,) = last_period(log, lines, "position")
        return synthesise(lines, np.hstack([U, factor * Y]), N)

    kinds: list[SignalKind] = [TORQUE] * len(record.inputs)
    kinds += [MOTION if place in record.inputs else LINK for place in record.outputs]
    units = *record.units_of_inputs, *(motion_unit("position", place in record.sliding) for place in record.outputs)
    measured, simulated = in_time(record, 1.0).T, in_time(_logged(record, plant, moved), late).T
    for row in zip(kinds, (*record.inputs, *record.outputs), units, measured, simulated, strict=True):
        yield TwinSignal(*row)


# Bandwidth of the loop about the logged motion: below it gravity pulls an arm of a metre away faster than it is held.
HELD_HZ = 0.5


@frozen_value
class _Log:
    """A log of n samples along which the joints `moving`, of n_u, move: their regressions, records and signals.

    rest (n_u,): angles of the posture, at which the others are held.
    """

    n: int
    rest: FloatArray
    moving: tuple[int, ...]
    regressions: tuple[MotionFriction, ...]
    records: tuple[FrictionRecord, ...]
    signals: tuple[MotionSignals, ...]

    @classmethod
    def of(cls, robot: Robot, members: Sequence[tuple[MotionFriction, FrictionRecord]]) -> _Log:
        """The log of joints that moved together, up to LONGEST_S."""
        names, (regressions, records) = [joint.name for joint in robot.driven], zip(*members, strict=True)
        posture, n = records[0].configuration, round(LONGEST_S * records[0].rate_hz)
        rest = np.zeros(len(names)) if posture is None else posture.angles
        signals = tuple(MotionSignals.of(fit.motion, fit.passband_hz) for fit in regressions)
        moving = tuple(names.index(record.joint) for record in records)
        return cls(min(len(records[0].position), n), rest, moving, regressions, records, signals)

    def whole(self, columns: Iterable[FloatArray], rest: FloatArray | float = 0.0) -> FloatArray:
        """Signals (n, n_u) of all joints by those of the joints that move; rest: of the others."""
        values = np.full((self.n, len(self.rest)), rest)
        for i, column in zip(self.moving, columns, strict=True):
            values[:, i] = column[: self.n]
        return values

    @property
    def position(self) -> FloatArray:
        """Angles (n, n_u) of the motors."""
        return self.whole((signals.position for signals in self.signals), self.rest)


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
    groups: dict[str, list[tuple[MotionFriction, FrictionRecord]]] = {}
    for joint in joints:
        if joint.motion is not None and not joint.motion.motion.is_run_down and joint.friction is not None:
            record = record_of(joint.motion, measured.of(joint.joint, "motion"))
            groups.setdefault(record.name, []).append((joint.motion, record))
    driven: list[tuple[_Log, CascadeSpec | None]] = []
    for members in groups.values():
        log = _Log.of(robot, members)
        driven.append((log, None))
        if controller is not None and all(record.reference is not None for record in log.records):
            driven.append((log, controller))
    runs = execution.ordered(partial(_run, robot), driven)
    return TwinFindings(friction_balances(joints, measured), tuple(runs))


def _rigid_torque(fit: MotionFriction, signals: MotionSignals, record: FrictionRecord) -> FloatArray:
    """The torque (n,) at full rate of all that is no friction in its log: rigid body, gravity and offset.

    A joint that moved with others has no numbers of its own of the rigid body.
    """
    if fit.rigid_body is not None:
        return record.torque - fit.motion.torque
    parts = motion_parts(fit.chosen, full_rate_columns(signals, fit.terms))
    return np.asarray(parts["inertia"] + parts.get("gravity", 0.0))


def _run(robot: Robot, driven: tuple[_Log, CascadeSpec | None]) -> TwinRun:
    """Run along a log, driven by its torque, or by its reference through a controller."""
    log, controller = driven
    drive: Drive = "torque" if controller is None else "reference"
    held_hz = HELD_HZ if controller is None else 0.0
    name, rate_hz = log.records[0].name, log.records[0].rate_hz
    empty = TwinRun(name, drive, held_hz, log.n / rate_hz, rate_hz)
    start = Configuration(name, log.position[0])
    spec = SimulatedSpec() if controller is None else SimulatedSpec(controller=controller.spec)
    run = _run_along(empty, robot, start, spec, partial(_along_motion, log, controller))
    return replace(run, rate_hz=rate_hz / int(log.signals[0].kept.step)) if run.signals else run


def _along_motion(log: _Log, controller: CascadeSpec | None, plant: Plant) -> Iterator[TwinSignal]:
    """Signals of a plant under reference, torque and gains; joints that rest have the same in all."""
    q, moving = plant.point.q, np.isin(np.arange(len(log.rest)), log.moving)
    smooth, path = formulate(without_friction(plant.model.robot)), log.position
    rate, curvature = (log.whole(getattr(part, name) for part in log.signals) for name in ("velocity", "acceleration"))
    torque = log.whole(record.torque for record in log.records)
    demand = feed_forward(smooth, q, path - path[0], rate, curvature)
    rigid = log.whole(map(_rigid_torque, log.regressions, log.signals, log.records))
    if controller is None:
        # The plant holds a torque from sample to sample: the mean of both ends acts on it.
        acting = (torque + np.vstack([torque[1:], torque[-1:]])) / 2
        held = _holding_gains(plant, HELD_HZ)
        # As the loop differentiates what it reads, so that its torque is of the error alone.
        position, velocity = path, np.diff(path, axis=0, prepend=path[:1]) * plant.loop.rate_hz
    else:
        held, still = gains_of(plant.model, q, controller.spec), np.zeros(log.n)
        position = log.whole((record.reference for record in log.records if record.reference is not None), log.rest)
        known = log.whole(still if record.disturbance is None else record.disturbance for record in log.records)
        velocity = controller.velocity_feed_forward * np.gradient(position, 1 / plant.loop.rate_hz, axis=0)
        # The torque that the controller's integral holds at the start; 0 without an integral.
        error = held.kp * (position[0] - path[0]) + held.kd * (velocity[0] - rate[0])
        acting = known + np.where(held.ki > 0, torque[0] - known[0] - error, 0.0)
    lacking = np.where(moving, demand - rigid, 0.0)
    commands = Commands(position, velocity, np.where(moving, acting, demand), lacking, np.zeros_like(demand))
    return _in_passband(log, plant.model, _follow(plant, commands, moving, held, path[0], rate[0]))


def _in_passband(log: _Log, model: ElasticModel, moved: Trajectory) -> Iterator[TwinSignal]:
    """Motion and torque of each joint that moves, and of its link where it was logged, in the passband."""
    for i, record, signals in zip(log.moving, log.records, log.signals, strict=True):
        # Of a log that is not simulated to its end, without the rest.
        kept = replace(signals, kept=slice(signals.kept.start, min(signals.kept.stop, log.n), signals.kept.step))
        motor, link = f"motor {record.joint}", f"joint {record.joint}"
        turning, driving = motion_unit("position", record.slides), drive_unit(record.slides)
        rows: tuple[tuple[SignalKind, str, str, FloatArray | None, FloatArray], ...] = (
            (MOTION, motor, turning, record.position, moved.reading[:, i]),
            (TORQUE, motor, driving, record.torque, moved.u[:, i]),
            (LINK, link, turning, record.link_position, moved.q[:, model.index(link)]),
        )
        for kind, place, unit, y, y_twin in rows:
            if y is not None:
                yield TwinSignal(kind, place, unit, kept.filtered(y[: log.n]), kept.filtered(y_twin[: log.n]))


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
