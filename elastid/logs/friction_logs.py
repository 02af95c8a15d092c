"""Logs of a friction study as records of each moving joint, in SI, on the link side.

Single missing samples and spikes of torque and position are repaired by the samples beside them. A longer gap divides
a log of motions into parts, which become records of their own. Logs of a warm-up become heat (`warm_ups`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, true_runs
from elastid.base.errors import DataError, Note, StudyError
from elastid.base.execution import Progress, no_progress
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.inverse_dynamics_regression import PASSBAND_HZ
from elastid.friction_study.sliding_friction import STILL, turns_against_gravity
from elastid.linear.equilibrium import equilibrium
from elastid.logs.channels import GatheredChannels, gather_channels, report_unused_references
from elastid.logs.files.formats import read_channels
from elastid.logs.motion_relations import REST_TRAVEL_M, REST_TRAVEL_RAD
from elastid.logs.repair import Findings, LogReport
from elastid.logs.repair.interpolation import MAX_BRIDGED
from elastid.logs.repair.masks import MAX_MISSING_FRACTION, step, without_dropouts
from elastid.logs.repair.missing import bridge_gaps, bridge_short_gaps
from elastid.logs.repair.outliers import without_lone_spikes
from elastid.logs.rig import repair_signals
from elastid.logs.units_and_sides import check_values, link_side, on_one_side, to_shafts
from elastid.logs.warm_ups import find_test_passes, join_warm_up_logs
from elastid.model.formulation import formulate
from elastid.record import Configuration, Hold
from elastid.robot import Joint, Robot
from elastid.robot.simplified import with_point_mass
from elastid.simulation.controller import loop_of

# Limits of motions and temperatures of joints (all of 12 clean logs are accepted).
MAX_TEMPERATURE_DEGC = 150.0
MIN_SEGMENT_S = 2.0  # of a log with gaps
# Signals (n,) by role, place and quantity; torques and currents have an empty one.
Signals: TypeAlias = Mapping[tuple[str, str, str], FloatArray]


def read_friction_logs(
    robot: Robot, spec: ExperimentSpec, base: Path, joints: Sequence[str], payloads: Mapping[str, float],
    progress: Progress = no_progress,
) -> FrictionRecords:  # fmt: skip
    """Read the records of all logs, whose paths are relative to base.

    joints: whose friction is asked for; others that move are recorded too.  payloads: kg of each load, added to the
    robot's own.  StudyError where channels, files and robot do not fit, DataError for a log that cannot be used.
    """
    recorded = spec.as_recorded()
    postures = spec.postures
    records, notes, start_s = list[FrictionRecord](), list[Note](), 0.0
    heated: dict[str, list[tuple[FrictionRecord, FileSpec]]] = {}
    for i, (name, file) in enumerate(zip(recorded.log_names, recorded.files, strict=True)):
        progress(i, len(recorded.files))
        angles = postures[file.configuration].angles if file.configuration else np.zeros(robot.n_u)
        payload, start_s = payloads.get(file.load, 0.0), start_s if file.start is None else float(file.start)
        motions = _LogReader(name, robot, recorded, file, base, angles, start_s, payload).records()
        if not any(record.joint in joints for record in motions):
            text = f"none of the joints {', '.join(joints)} moves in it. Correct friction.joints, or omit the file"
            raise DataError("friction/no-record", text, base / file.path)
        start_s = max(record.start_s + record.duration_s for record in motions)
        if file.purpose == "warm_up":
            notes += motions[0].notes
            heated.setdefault(motions[0].joint, []).append((motions[0], file))
            joint = robot.driven[robot.driven_names.index(motions[0].joint)]
            motions = find_test_passes(motions[0], turns_against_gravity(robot, joint, motions[0].configuration))
        records += motions
    warm_ups = tuple(join_warm_up_logs(*zip(*pairs, strict=True)) for pairs in heated.values())
    return FrictionRecords(tuple(records), warm_ups, tuple(notes))


@dataclass(frozen=True)
class _LogReader:
    name: str
    robot: Robot
    recorded: RecordedSpec
    file: FileSpec
    base: Path
    angles: FloatArray
    start_s: float
    payload: float
    offset_s: float = 0.0  # of a part of a log

    @property
    def path(self) -> str:
        return str(self.base / self.file.path)

    def records(self) -> tuple[FrictionRecord, ...]:
        """Read one record of each moving joint. Raises StudyError or DataError if no joint moves."""
        recorded = replace(self.recorded, channels=tuple(c for c in self._channels() if c.role != "t"))
        gathered = gather_channels(recorded, self.file, self.base, self.robot)
        if isinstance(recorded.rate_hz, str):
            text = "friction needs velocities, and recorded.rate_hz is unknown. Give rate_hz in Hz"
            raise StudyError("study/recorded", text, self.path)
        signals = np.copy(gathered.signals)
        if self.file.purpose != "coast_down":  # a coast-down test has zero torque
            measured = [i for i, c in enumerate(gathered.channels) if c.role in ("u", "y")]
            names = tuple(gathered.log.names[i] for i in measured)
            signals[:, measured] = without_dropouts(signals[:, measured], replace(gathered.log, names=names))
        is_whole = self.file.purpose in (*STILL, "warm_up")
        if not is_whole:
            torques = [i for i, c in enumerate(gathered.channels) if c.role == "u"]
            straight = dict.fromkeys(torques, round(gathered.rate_hz / (2 * PASSBAND_HZ)))  # half a period
            signals = bridge_short_gaps(signals, gathered.log, straight)
        gathered = replace(gathered, signals=signals)
        segments = (gathered,) if is_whole else _segments(gathered)
        records = list[FrictionRecord]()
        for i, segment in enumerate(segments):
            name = f"{self.name} part {i + 1}" if i else self.name
            offset_s = (segment.log.first - gathered.log.first) / recorded.known_rate_hz
            reader = replace(self, name=name, start_s=self.start_s + offset_s, offset_s=offset_s)
            records += reader._segment_records(segment)
        if records:
            return tuple(records)
        text = "no moving joint has both torque and position in it. Log role u (or role reference, with the gains as"
        advice = f"role y with quantity position, at one of {', '.join(self.robot.motor_locations)}"
        raise DataError("records/channels", f"{text} controller), and {advice}", self.path)

    def _segment_records(self, gathered: GatheredChannels) -> tuple[FrictionRecord, ...]:
        repaired_signals, N, rate_hz = self._repair(gathered)
        values, tau_d = on_one_side(gathered.channels, repaired_signals, to_shafts(gathered.channels, self.robot))
        if self.recorded.controller is None:
            report_unused_references(gathered.channels, gathered.log)
        motors = [c.at for c in gathered.channels if c.role == "u"]
        keys = [(c.role, c.at, c.quantity if c.role == "y" else "") for c in gathered.channels]
        signals: dict[tuple[str, str, str], FloatArray] = dict(zip(keys, np.ascontiguousarray(values.T), strict=True))
        signals |= {("d", at, ""): d for at, d in zip(motors, tau_d.T, strict=True) if d.any()}
        for channel in self._channels():
            if channel.role == "t":
                time_s = self.offset_s + np.arange(len(values)) / rate_hz
                signals["t", channel.at, ""] = self._thermometer(channel, time_s)
        return self._joint_records(signals, rate_hz, N, gathered.log.findings.at(f"record {self.name}"))

    def _repair(self, gathered: GatheredChannels) -> tuple[FloatArray, int | None, float]:
        """Repair gaps and spikes; return signals, samples of their period (None without one), and their rate."""
        if self.file.purpose == "presliding_test":
            return repair_signals(gathered, self.recorded)
        log = gathered.log
        signals = bridge_gaps(gathered.signals, log, MAX_MISSING_FRACTION)
        columns = [i for i, c in enumerate(gathered.channels) if c.role == "u" or c.quantity == "position"]
        part_log = replace(log, names=tuple(log.names[i] for i in columns))
        are_motions = [gathered.channels[i].role != "u" for i in columns]
        clean = without_lone_spikes(signals[:, columns], part_log, are_motions)
        signals[:, columns] = bridge_short_gaps(clean, replace(part_log, findings=Findings()))
        return signals, None, gathered.rate_hz

    def _thermometer(self, channel: ChannelSpec, time_s: FloatArray) -> FloatArray:
        """Interpolate readings of a thermometer of any rate, (n,) in degC, at times from the first sample, linearly."""
        path = self.base / (self.file.path, *self.file.also)[channel.file - 1]
        log = LogReport(str(path), ())
        rate_hz = float(channel.rate_hz or self.recorded.known_rate_hz)
        values = read_channels(path, [channel], self.recorded.text)
        check_values([channel], [values[:, 0]], log)
        degc = link_side(channel, values[:, 0], self.robot, log)
        finite = np.flatnonzero(np.isfinite(degc))
        first = 0 if self.file.samples is None or channel.file > 1 else self.file.samples[0]
        return np.interp(first / self.recorded.known_rate_hz + time_s, finite / rate_hz, degc[finite])

    def _channels(self) -> tuple[ChannelSpec, ...]:
        return tuple(c for c in self.recorded.channels if self.file.joint in ("", _joint_of_channel(c)))

    def _joint_records(
        self, signals: Signals, rate_hz: float, period: int | None, notes: tuple[Note, ...]
    ) -> tuple[FrictionRecord, ...]:
        candidates = {joint.name: _signal(signals, "y", joint.name, "position") for joint in self.robot.driven}
        positions = {name: position for name, position in candidates.items() if position is not None}
        moving = self._moving_joints(positions, signals)
        if not moving:
            return ()
        E = self.robot.mixing
        at_rest = zip(self.robot.driven, E @ self.angles, strict=True)
        angles = [positions[joint.name].mean() if joint.name in positions else angle for joint, angle in at_rest]
        posture = Configuration(self.file.configuration or self.name, np.linalg.solve(E, angles))
        load_torque = np.zeros(len(angles))  # Nm, N: holds each driven joint, the payload at the last frame
        if self.file.load:
            model = formulate(with_point_mass(self.robot, self.payload))
            load_torque = np.abs(np.linalg.solve(E.T, equilibrium(model, model.theta, posture).u))
        holds = {_joint_of_channel(c): c.hold or self.recorded.hold for c in self.recorded.channels if c.role == "u"}
        channels = sorted(self.recorded.channels, key=lambda c: c.at.startswith("motor"))  # the motor's of two encoders
        delays = {(c.role, c.quantity == "position", _joint_of_channel(c)): c.delay for c in channels}
        path = None if self.recorded.controller is None else self.recorded.controller.reference
        command_hold: Hold = "zero-order" if path is None or path.interpolation == "hold" else "band-limited"
        return tuple(
            FrictionRecord(
                name=self.name,
                joint=joint.name,
                purpose=self.file.purpose if joint.name in holds else "commands",
                rate_hz=rate_hz,
                position=positions[joint.name],
                torque=signals.get(("u", f"motor {joint.name}", ""), np.full_like(positions[joint.name], np.nan)),
                velocity=_signal(signals, "y", joint.name, "velocity"),
                disturbance=_signal(signals, "d", joint.name),
                reference=_signal(signals, "reference", joint.name),
                # Of a link that has an encoder in addition to that of its motor.
                link_position=signals.get(("y", f"joint {joint.name}", "position"))
                if ("y", f"motor {joint.name}", "position") in signals
                else None,
                temperature=self._temperature(signals, joint.name, len(positions[joint.name])),
                speed=self.file.speed,
                load=self.file.load,
                payload=self.payload,
                load_torque=float(load_torque[self.robot.driven_names.index(joint.name)]),
                # A zero-order hold acts half a sample late on average; a torque that is logged late acts earlier.
                torque_delay_s=0.5 / rate_hz * (holds.get(joint.name) == "zero-order")
                + delays.get(("y", True, joint.name), 0.0)
                - delays.get(("u", False, joint.name), 0.0),
                period_samples=period,
                hold=holds.get(joint.name, command_hold),
                **self._command(joint, signals, rate_hz),
                # Of loops that end by sliding values hardly repeat; three times the log they do.
                resolution=step(np.tile(positions[joint.name], 3 if self.file.purpose == "presliding_loops" else 1)),
                start_s=self.start_s,
                configuration=posture,
                place=self.path,
                slides=joint.slides,
                notes=notes if joint is moving[0] else (),
            )
            for joint in moving
        )

    def _moving_joints(self, positions: Mapping[str, FloatArray], signals: Signals) -> list[Joint]:
        driving = "u" if self.recorded.controller is None or any(role == "u" for role, *_ in signals) else "reference"
        joints = [j for j in self.robot.driven if j.name in positions and (driving, f"motor {j.name}", "") in signals]
        moving = [joint for joint in joints if self._moves(joint, positions[joint.name])]
        if self.file.purpose == "warm_up" and len(moving) > 1:
            text = f"joints {', '.join(joint.name for joint in moving)} move in it and exchange work"
            advice = "Warm up one joint at a time, or name the joint that is heated: joint"
            raise DataError("friction/no-record", f"{text}. {advice}", self.path)
        return moving

    def _command(self, joint: Joint, signals: Signals, rate_hz: float) -> dict[str, Any]:
        """Return command and gains of a joint without a torque, by fields of the record; empty with a torque."""
        controller, reference = self.recorded.controller, _signal(signals, "reference", joint.name)
        if controller is None or reference is None or ("u", f"motor {joint.name}", "") in signals:
            return {}
        path = controller.reference
        is_filtered = path is not None and (path.filter_hz is not None or path.moving_average > 0)
        has_states = controller.integral_time is not None or controller.notches or controller.low_pass_hz is not None
        if has_states or is_filtered:
            text = "integral_time, notches and filters need a torque channel. Log role u, or give the gains of a PD"
            raise StudyError("study/recorded", text, "experiment.recorded.controller")
        loop, i = loop_of(controller, self.robot.n_u), self.robot.driven_names.index(joint.name)
        kp, kd, s = float(loop.kp[i]), float(loop.kd[i]), controller.velocity_feedforward
        command = kp * reference + s * kd * np.gradient(reference, 1 / rate_hz)
        delay_s = 0.5 / controller.tick_hz if controller.tick_hz else 0.0
        further_s = delay_s if controller.velocity == "difference" else 0.0
        return {"command": command, "gains": (kp, kd), "feedback_delays_s": (delay_s, further_s)}

    def _moves(self, joint: Joint, position: FloatArray) -> bool:
        min_travel = REST_TRAVEL_M if joint.slides else REST_TRAVEL_RAD
        return self.file.purpose in STILL or joint.name == self.file.joint or float(np.ptp(position)) > min_travel

    def _temperature(self, signals: Signals, joint: str, n: int) -> FloatArray | None:
        degrees = _signal(signals, "t", joint)
        if degrees is None:
            is_start = self.file.purpose == "warm_up"  # of the log, not of all its samples
            return None if is_start or self.file.temperature is None else np.full(n, float(self.file.temperature))
        if float(degrees.max()) > MAX_TEMPERATURE_DEGC:
            text = f"the temperature of joint {joint} reaches {degrees.max():.4g} degC, which is implausible"
            raise DataError("records/channels", text + ". Set the unit of that channel, K or degF", self.path)
        return degrees


def _segments(gathered: GatheredChannels) -> tuple[GatheredChannels, ...]:
    """Return the parts of a log between gaps that are too long to interpolate, without short parts; else all of it.

    The first part has the notes and findings, and one on the gaps.
    """
    has_gap = np.asarray(~np.isfinite(gathered.signals).all(axis=1))
    gaps = true_runs(has_gap, MAX_BRIDGED + 1)
    bounds = zip([0, *gaps[:, 1].tolist()], [*gaps[:, 0].tolist(), len(has_gap)], strict=True)
    min_samples, log = MIN_SEGMENT_S * gathered.rate_hz, gathered.log
    inner = [_without_ends(has_gap, first, end) for first, end in bounds]
    long = [(first, end) for first, end in inner if end - first >= min_samples]
    if not long or (not len(gaps) and long == [(0, len(has_gap))]):
        return (gathered,)
    for start in gaps[:1, 0]:
        text = f"gaps of more than {MAX_BRIDGED} samples: {len(gaps)}, the first at {log.time_of(start)}"
        log.report("logs divided at gaps", len(gaps), f"{text}; parts between them that are used: {len(long)}")
    findings = [log.findings, *(Findings() for _ in long[1:])]
    return tuple(
        replace(gathered, signals=gathered.signals[first:end], log=replace(log.after(first), findings=finding))
        for (first, end), finding in zip(long, findings, strict=True)
    )


def _without_ends(has_gap: BoolArray, first: int, end: int) -> tuple[int, int]:
    """Shrink a range until two samples at both ends are complete: an interpolation needs neighbours."""
    is_whole = ~has_gap[first:end]
    pairs = first + np.flatnonzero(is_whole[:-1] & is_whole[1:])
    return (first, first) if not len(pairs) else (int(pairs[0]), int(pairs[-1]) + 2)


def _joint_of_channel(channel: ChannelSpec) -> str:
    """Return the joint of a channel; empty for a channel at a body or a frame."""
    kind, _, name = channel.at.partition(" ")
    return name if kind in ("motor", "joint") else ""


def _signal(signals: Signals, role: str, joint: str, quantity: str = "") -> FloatArray | None:
    """Return the signal at the motor of a joint, which its friction acts on, or else at the joint."""
    at_motor, at_joint = ((role, f"{kind} {joint}", quantity) for kind in ("motor", "joint"))
    return signals.get(at_motor, signals.get(at_joint))
