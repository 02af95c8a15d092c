r"""Sliding friction of each joint from a friction study: constant-velocity runs and regressions of motions.

A joint that moved alone is regressed with its inertia and gravity. Joints that moved together are regressed jointly
with the rigid body that they carry; their constant-velocity runs do not depend on this rigid body.

If a motor angle or motor torque is taken for a joint quantity, rigid-body torques are wrong by the gear ratio or its
square.

Friction also follows from coast-down tests: a joint coasts in one direction until it stops. The torque of its rigid
body, rotor and payload in the robot model is subtracted from the logged torque, which is 0 if the drive is off. The
remainder is regressed like any motion. A motion in one direction cannot distinguish an offset of the torque from
Coulomb friction, or an error of the inertia from a common factor of all friction.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from elastid.base.arrays import FloatArray
from elastid.base.display import digits, number
from elastid.base.errors import DataError, Note, notes_of
from elastid.base.execution import Progress, no_progress
from elastid.base.statistics import QUANTILE_95, identifiable_combinations
from elastid.friction_record import FrictionRecord, FrictionRecords, Purpose
from elastid.friction_study.commanded import DELAY, CommandedJoint, CommandedLog, equivalent_gains
from elastid.friction_study.commanded_fit import fit_commanded, simulate_commanded, smoothed_motion
from elastid.friction_study.constant_velocity import estimate_friction_curve, passes_of
from elastid.friction_study.inverse_dynamics_regression import (
    PASSBAND_HZ,
    ROBOT_PASSBAND_HZ,
    MotionFriction,
    regress_motion,
    regress_robot_motion,
    torque_components,
)
from elastid.friction_study.least_squares import FALSE_ALARM
from elastid.friction_study.motion_signals import MAX_STEADY_CHANGE, Motion, MotionLog, MotionSignals, detect_passes
from elastid.friction_study.regressor import full_rate_columns
from elastid.friction_study.result import RIGID_TERMS, SlidingFriction, attempt, joint_spring
from elastid.friction_study.rigid_body_columns import rigid_torque, torques_in_file
from elastid.friction_study.static_model_fit import MIN_SPEEDS, TEMPERATURE_STEP_K
from elastid.record import Configuration
from elastid.robot import Joint, Robot
from elastid.robot.friction_numbers import TERMS
from elastid.robot.simplified import with_point_mass

# Largest relative std of a parameter that is stated alone; above, its combination is stated.
MAX_RELATIVE_STD = 0.1
# Sweeps of the coupling of joints in a simulation, and the change of positions over their extent at which they end.
MAX_SWEEPS, SWEEP_TOLERANCE = 20, 1e-4
# Purposes of records of a joint that does not slide.
STILL = ("presliding_loops", "presliding_test")


def identify_sliding_friction(
    robot: Robot, joints: Sequence[Joint], measured: FrictionRecords, progress: Progress = no_progress
) -> tuple[SlidingFriction, ...]:
    """Identify friction curve and motion of each joint; DataError for a joint without a usable record."""
    progress(0, 1 + len(joints))
    motions, commanded = _motions(robot, joints, measured), _commanded_joints(robot, measured)
    fits = []
    for n_done, joint in enumerate(joints, start=1):
        progress(n_done, 1 + len(joints))
        if joint.name in commanded:
            fits.append(_commanded_friction(joint, commanded[joint.name], measured))
        else:
            fits.append(_joint_friction(robot, joint, measured, motions.get(joint.name, JointMotion())))
    return tuple(fits)


GAINS_EXACT = (
    "the gains of the controller are assumed exact. Inertia, Coulomb friction and the sum of viscous friction and "
    "velocity gain scale with the position gain. An error of the velocity gain causes the opposite error of the "
    "viscous friction"
)


def _commanded_friction(joint: Joint, fit: CommandedJoint, measured: FrictionRecords) -> SlidingFriction:
    records = measured.of(joint.name, "commands")
    notes, text = notes_of(records), GAINS_EXACT
    if not records[0].feedback_delays_s[0]:
        viscous = (records[0].gains or (0.0, 0.0))[0] / 2000
        unit = "N*s/m" if joint.slides else "N*m*s/rad"
        text += (
            f". The controller is modelled as continuous. For a period of 1 ms, add {viscous:.2g} {unit} to the "
            "viscous friction, or state controller.reference.cycle and controller.ticks"
        )
    gains = Note("friction/gains", text, f"joint {joint.name}", severity="information")
    return SlidingFriction(
        joint.name, joint.slides, notes=(*notes, gains, *_combination_notes(joint, fit, measured)), commanded=fit
    )


# Parameters, minimum number of them in a combination, and the motion that separates them. The first match counts.
SEPARATING = (
    (("offset", "gravity.cos", "gravity.sin"), 2, "a larger range of the angle, or another posture"),
    (("coulomb", "viscous"), 2, "speeds in a wider range"),
    ((DELAY, "inertia", "viscous"), 1, "power of the commands above {hz:.2g} Hz"),
)


def _combination_notes(joint: Joint, fit: CommandedJoint, measured: FrictionRecords) -> Iterator[Note]:
    """Yield a note for each combination of unidentifiable parameters, with a motion that separates them."""
    kp, kd = measured.of(joint.name, "commands")[0].gains or (1.0, 1.0)
    # Below it the lag of friction is a delay, (f + k_d) / k_p.
    hz = kp / (2 * math.pi * (kd + max(0.0, fit["viscous"])))
    terms, last = {**TERMS, **RIGID_TERMS}, [*range(-1, len(fit.names) - 1)]  # the delay, then the others
    std, last_names = np.sqrt(np.diag(fit.covariance))[last], [fit.names[i] for i in last]
    for combination in identifiable_combinations(fit.values[last], fit.covariance[np.ix_(last, last)]):
        names = [last_names[i] for i in combination.members]
        relative = [float(std[i] / max(abs(fit.values[last][i]), 1e-300)) for i in combination.members]
        if max(relative) < MAX_RELATIVE_STD:
            continue
        pairs = list(zip(combination.weights, (terms[name].symbol for name in names), strict=True))
        rest = (f"{'-' if w < 0 else '+'} {abs(w):.2g} {symbol}" for w, symbol in pairs[1:])
        sentence = " ".join([pairs[0][1], *rest])
        n_digits = digits(combination.value, combination.std)
        interval = f"{number(combination.value, n_digits)} +- {number(QUANTILE_95 * combination.std, 2)}"
        unit = terms[names[0]].unit_at(joint.slides)
        advice = next((text for of, n_min, text in SEPARATING if len({*of} & {*names}) >= n_min), "another motion")
        text = (
            f"{sentence} = {interval} {unit} (95 %) is identified, its members only with stds of "
            f"{', '.join(f'{x:.0%}' for x in relative)}. To separate them, record {advice.format(hz=hz)}"
        )
        yield Note("friction/combination", text, f"joint {joint.name}", severity="information")


def _commanded_joints(robot: Robot, measured: FrictionRecords) -> dict[str, CommandedJoint]:
    """Estimate each joint with commands and without torque from all its logs; joints of a log share one delay."""
    logs = motion_logs(measured, "commands")
    if not logs:
        return {}
    commanded_logs = [commanded_log(robot, log) for log in logs]
    fits = fit_commanded(commanded_logs)
    if any(np.any(log.coupled_inertia) for log in commanded_logs):  # loads of smoothed measured positions are biased
        motions = [interpolated_motion(simulated_commands(robot, log, fits), log) for log in logs]
        loads = [rigid_loads(robot, [*log.values()], motion)[0] for log, motion in zip(logs, motions, strict=True)]
        fits = fit_commanded([replace(log, load=load) for log, load in zip(commanded_logs, loads, strict=True)], fits)
    inertia = {j: c for log in commanded_logs for j, c in zip(log.joints, log.coupled_inertia.tolist(), strict=True)}
    return {
        joint: _with_record_statistics(fit, measured.of(joint, "commands"), inertia[joint])
        for joint, fit in fits.items()
    }


def _with_record_statistics(fit: CommandedJoint, records: Sequence[FrictionRecord], inertia: float) -> CommandedJoint:
    """Add to an estimate the statistics of its records and the inertia of the rigid body."""
    position = np.concatenate([record.position - record.position.mean() for record in records])
    speed = np.concatenate([np.abs(np.gradient(record.position, 1 / record.rate_hz)) for record in records])
    (low, high), std = np.quantile(speed, [0.05, 0.99]).tolist(), float(np.std(position))
    seconds, speeds = sum(record.duration_s for record in records), (low, high)
    return replace(fit, position_std=std, speeds=speeds, coupled_inertia=inertia, logs=len(records), seconds=seconds)


def commanded_log(robot: Robot, log: Mapping[str, FrictionRecord]) -> CommandedLog:
    """Return commands and positions of the joints of a log, and the torque of the rigid body that couples them, if any.

    DataError for a robot with loops.
    """
    records, joints = list(log.values()), {joint.name: joint for joint in robot.driven}
    if robot.loops:
        text = "commands without torques identify no robot with closed loops. Log a torque (role u)"
        raise DataError("friction/rigid-body", text, records[0].place)
    position = np.stack([record.position for record in records], axis=1)
    load, inertia = rigid_loads(robot, records, smoothed_motion(position, records[0].rate_hz)[0])
    kp, kd = np.array([record.gains for record in records]).T
    kd, delay_inertia = equivalent_gains(kp, kd, *np.array([record.feedback_delays_s for record in records]).T)
    pairs = zip(records, inertia.tolist(), strict=True)
    has_gravity = [not c and turns_against_gravity(robot, joints[r.joint], r.configuration) for r, c in pairs]
    return CommandedLog(
        records[0].name, tuple(log), records[0].rate_hz, position,
        np.stack([record.command for record in records if record.command is not None], axis=1), kp, kd,
        np.array([_first_velocity(record) for record in records]), np.array(has_gravity), load, inertia, delay_inertia,
        records[0].hold == "zero-order"
    )  # fmt: skip


def interpolated_motion(position: FloatArray, log: Mapping[str, FrictionRecord]) -> list[FloatArray]:
    """Return noise-free positions (n, m), and their velocities and accelerations by cubic splines."""
    time_s = np.arange(len(position)) / next(iter(log.values())).rate_hz
    spline = CubicSpline(time_s, position)
    return [np.asarray(spline(time_s, order)) for order in range(3)]


def rigid_loads(
    robot: Robot, records: Sequence[FrictionRecord], motion: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return torque (n, m) of the rigid body along a motion, without its mean inertia, and this inertia (m,).

    motion: positions, velocities and accelerations (n, m).  Both results are zero if the robot model couples none of
    these joints; inertia and gravity of each are then estimated.
    """
    indices = [robot.driven_indices[robot.driven_names.index(record.joint)] for record in records]
    q, v, a = motion
    n, m = q.shape
    states = np.zeros((3, robot.n_l, n))
    states[0, list(robot.driven_indices)] = (robot.mixing @ records[0].angles(robot.n_u))[:, None]
    for signals, values in zip(states, (q, v, a), strict=True):
        signals[indices] = values.T
    torque = rigid_torque(robot)
    sample = states[0][:, :: max(1, n // 20)]
    units = np.eye(robot.n_l)[indices]
    # Columns of the mass matrix at some instants, (m, m, k).
    M = np.array([torque(sample, 0 * sample, 0 * sample + unit[:, None])[indices] for unit in units])
    M -= torque(sample, 0 * sample, 0 * sample)[indices]
    diagonal = np.mean(M[range(m), range(m)], axis=1)
    coupling = np.max(np.abs(M), axis=2) * ~np.eye(m, dtype=bool)
    if not np.any(coupling > 1e-9 * np.sqrt(np.outer(diagonal, diagonal))):
        return np.zeros_like(q), np.zeros(m)
    return torque(*states)[indices].T - a * diagonal, diagonal


def simulated_commands(
    robot: Robot, log: Mapping[str, FrictionRecord], joints: Mapping[str, CommandedJoint]
) -> FloatArray:
    """Return positions (n, m) of the joints of a log from its commands alone, by waveform relaxation of their coupling.

    Each sweep takes the torque of the coupling from the positions of the sweep before (Lelarasmee, Ruehli and
    Sangiovanni-Vincentelli, IEEE Trans. CAD 1, 1982).
    """
    commanded, records = commanded_log(robot, log), list(log.values())
    positions = simulate_commanded(commanded, joints)
    for _ in range(MAX_SWEEPS if np.any(commanded.coupled_inertia) else 0):
        last_positions, (load, inertia) = positions, rigid_loads(robot, records, interpolated_motion(positions, log))
        positions = simulate_commanded(replace(commanded, load=load, coupled_inertia=inertia), joints)
        if np.max(np.abs(positions - last_positions)) < SWEEP_TOLERANCE * float(np.ptp(positions)):
            break
    return positions


def _first_velocity(record: FrictionRecord) -> float:
    """Return the velocity at the first sample, measured or by the slope of the first samples."""
    if record.velocity is not None:
        return float(record.velocity[0])
    return float(np.polyfit(np.arange(5) / record.rate_hz, record.position[:5], 1)[0])


def _joint_friction(robot: Robot, joint: Joint, measured: FrictionRecords, motion: "JointMotion") -> SlidingFriction:
    # Test passes of a warm-up identify the effect of temperature; without a thermometer their conditions are unknown.
    runs = measured.of(joint.name, "constant_velocity")
    planned_runs = [r for r in runs if not r.is_warm_up or np.isfinite(r.mean_temperature)]
    logs, warm_joints = [r for r in measured.records if r.joint == joint.name], [log.joint for log in measured.warm_ups]
    notes, curve = [*notes_of(logs), *motion.notes], None
    if records := [*planned_runs, *motion.passes]:
        # The passes of joints that moved together are free of the rigid body.
        is_free = not planned_runs and motion.friction is not None and motion.friction.rigid_body is not None
        against = not is_free and turns_against_gravity(robot, joint, records[0].configuration)
        passes = [run for record in records for run in passes_of(record)]
        curve = estimate_friction_curve(passes, against, _turn(joint))
        notes += curve.notes
    elif not (motion.friction or joint.name in warm_joints or any(r.purpose in STILL for r in logs)):
        raise DataError(
            "friction/no-record",
            "neither passes nor a motion were recorded; leave it out of friction.joints, or record them",
            f"joint {joint.name}",
        )
    return SlidingFriction(joint.name, joint.slides, curve, motion.friction, tuple(notes))


def _turn(joint: Joint) -> float:
    """Return turn of the joint for one of its motor; 0 without a motor."""
    return 0.0 if joint.motor is None else 2 * np.pi / abs(joint.motor.ratio)


def _coasting(robot: Robot, joint: Joint, records: Sequence[FrictionRecord]) -> "JointMotion":
    """Regress the coast-down tests of one joint; DataError if they are too short, or friction accelerates it."""
    motions = []
    for record in records:
        log = motion_log(robot, {joint.name: record}, PASSBAND_HZ)
        rigid, slides = torques_in_file(with_point_mass(robot, record.payload), log)[joint.name], log.first.slides
        # What it does at rest is no sliding, however long.
        n = len(slides) - int(np.argmax(slides[::-1])) + round(6.0 / PASSBAND_HZ * record.rate_hz)
        motion, torque = log.first.motion, record.torque - rigid
        position = motion.position[:n]
        motions.append(replace(motion, position=position, torque=torque[:n], temperature=None, is_run_down=True))
    text = (
        "its run-downs give friction relative to the inertia of the robot's file: 1 % of it is 1 % of friction, and an "
        "offset of the torque is part of Coulomb friction unless they go both ways: no interval has that in it"
    )
    note = Note("friction/inertia", text, f"joint {joint.name}", severity="information")
    return JointMotion(regress_motion(*motions), notes=(note,))


@dataclass(frozen=True)
class JointMotion:
    """Motion of one joint: regression (None if its logs do not identify it), constant-velocity runs, and notes."""

    friction: MotionFriction | None = None
    passes: tuple[FrictionRecord, ...] = ()
    notes: tuple[Note, ...] = ()


def _motions(robot: Robot, joints: Sequence[Joint], measured: FrictionRecords) -> Mapping[str, JointMotion]:
    """Return the motions of each joint that has some; where it moved alone and with others, alone counts."""
    logs = motion_logs(measured)
    motions = _joint_group_motion(robot, [log for log in logs if len(log) > 1])
    for joint in joints:
        records_alone = [log[joint.name] for log in logs if len(log) == 1 and joint.name in log]
        if records_alone:
            motions[joint.name] = _single_joint_motion(robot, joint, records_alone)
        elif run_downs := measured.of(joint.name, "coast_down"):
            motions[joint.name] = _coasting(robot, joint, run_downs)
    return motions


def motion_logs(measured: FrictionRecords, purpose: Purpose = "motion") -> list[dict[str, FrictionRecord]]:
    """Return the logs of motions in order, each with the records of the joints that moved in it."""
    logs: dict[str, dict[str, FrictionRecord]] = {}
    for record in measured.records:
        if record.purpose == purpose:
            logs.setdefault(record.name, {})[record.joint] = record
    return list(logs.values())


def _single_joint_motion(robot: Robot, joint: Joint, records: Sequence[FrictionRecord]) -> JointMotion:
    records, notes = sorted(records, key=lambda record: record.payload), list[Note]()
    against, code = turns_against_gravity(robot, joint, records[0].configuration), "friction/no-record"
    detected = [attempt(notes, code, detect_passes, record, against) or () for record in records]
    passes = _sufficient_runs([part for components in detected for part in components])
    friction = attempt(notes, code, _regress, robot, joint, records, against)
    if friction is None and not passes:
        raise DataError(code, str(notes[0]))
    if friction is not None and not robot.loops and friction.regression.chance("inertia", 1) < FALSE_ALARM:
        log, signals = motion_log(robot, {joint.name: records[0]}, PASSBAND_HZ), friction.motion
        columns = full_rate_columns(MotionSignals.of(signals, PASSBAND_HZ), friction.terms)
        components = torque_components(friction.regression, columns)
        rigid = {joint.name: components["inertia"] + components.get("gravity", 0.0)}
        check_torques(robot, rigid, torques_in_file(robot, log), records[0].place)
    return JointMotion(friction, passes, (*(friction.notes if friction is not None else ()), *notes))


def _regress(robot: Robot, joint: Joint, records: Sequence[FrictionRecord], against: bool) -> MotionFriction:
    spring = joint_spring(robot, records[0])
    motions = [replace(_motion(record, against, _turn(joint)), spring=spring) for record in records]
    if len({record.payload for record in records}) > 1:
        # The torque that a mass at the last frame adds, by the robot's geometry.
        for i, (motion, record) in enumerate(zip(motions, records, strict=True)):
            log, mass = motion_log(robot, {joint.name: record}, PASSBAND_HZ), record.payload - records[0].payload
            loaded, empty = (torques_in_file(r, log)[joint.name] for r in (with_point_mass(robot, mass), robot))
            motions[i] = replace(motion, payload_torque=loaded - empty)
    return regress_motion(*motions)


def _joint_group_motion(robot: Robot, logs: Sequence[Mapping[str, FrictionRecord]]) -> dict[str, JointMotion]:
    groups: dict[tuple[str, ...], list[Mapping[str, FrictionRecord]]] = {}
    for log in logs:
        groups.setdefault(tuple(log), []).append(log)
    evaluated = {}
    for joints, members in groups.items():
        robot_logs = [motion_log(robot, log, ROBOT_PASSBAND_HZ) for log in members]
        for log, motions in zip(members, robot_logs, strict=True):
            measured = {joint: record.torque for joint, record in log.items()}
            check_torques(robot, measured, torques_in_file(robot, motions), next(iter(log.values())).place)
        friction, rigid_motions = regress_robot_motion(robot, robot_logs)
        for joint in joints:
            pairs = zip(members, rigid_motions, strict=True)
            records = [replace(log[joint], torque=rigid[joint].motion.torque) for log, rigid in pairs]
            passes = [run for record in records for run in detect_passes(record, has_gravity=False)]
            evaluated[joint] = JointMotion(friction[joint], _sufficient_runs(passes), friction[joint].notes)
    return evaluated


def _sufficient_runs(passes: Sequence[FrictionRecord]) -> tuple[FrictionRecord, ...]:
    numbers = ((run, np.log(run.speed or 1.0), np.nan_to_num(run.mean_temperature)) for run in passes)
    conditions = {
        (round(log / MAX_STEADY_CHANGE), run.load, round(degc / TEMPERATURE_STEP_K)) for run, log, degc in numbers
    }
    return tuple(passes) if len(conditions) >= MIN_SPEEDS else ()


def motion_log(robot: Robot, log: Mapping[str, FrictionRecord], passband_hz: float) -> MotionLog:
    """Return the signals of a log, and the angles of the joints that rest in it."""
    first = next(iter(log.values()))
    angles = zip(robot.driven_names, (robot.mixing @ first.angles(robot.n_u)).tolist(), strict=True)
    resting = {joint: angle for joint, angle in angles if joint not in log}
    return MotionLog.of({joint: _motion(record, False) for joint, record in log.items()}, resting, passband_hz)


def _motion(record: FrictionRecord, against_gravity: bool, turn: float = 0.0) -> Motion:
    location, degc = f"joint {record.joint}", record.temperature
    is_measured = np.zeros(0, bool) if degc is None else np.isfinite(degc)
    if degc is not None and is_measured.any():
        degc = np.interp(np.arange(len(degc)), np.flatnonzero(is_measured), degc[is_measured])
    return Motion(
        location, record.rate_hz, record.position, record.torque, record.slides, against_gravity, turn,
        record.load_torque, degc if is_measured.any() else None, record.torque_delay_s
    )  # fmt: skip


# Ratio of a gear below which masses may be wrong by as much as its sides differ; factor between torques and a power of
# the ratio; correlation with the torque of the robot's file below which friction or errors dominate.
MIN_RATIO, CLOSE_FACTOR, MIN_CORRELATION = 10.0, 4.0, 0.5


def check_torques(
    robot: Robot, measured: Mapping[str, FloatArray], expected: Mapping[str, FloatArray], location: str
) -> None:
    """Raise DataError if torques (n,) by joint that follow the expected ones are, in the median, of the other side."""
    powers, ratios = list[float](), list[float]()
    for joint, torque in measured.items():
        model, size = expected[joint], max(float(np.linalg.norm(expected[joint])), 1e-300)
        ratio, along = abs(robot.ratio(joint)), float(torque @ model)
        if along > MIN_CORRELATION * size * np.linalg.norm(torque) and ratio >= MIN_RATIO:
            powers.append(math.log(along / size**2) / math.log(ratio))
            ratios.append(ratio)
    power, ratio = float(np.median(powers or [0.0])), float(np.median(ratios or [1.0]))
    if round(power) == 0 or abs(power - round(power)) * math.log(ratio) > math.log(CLOSE_FACTOR):
        return
    advice = "of the motors: give their channels side: motor" if power < 0 else "of the joints: leave side: motor out"
    text = (
        f"torques are {ratio**power:.3g} times those of the robot's file, and the ratio of the gear is {ratio:.4g}: "
        f"torques or angles are {advice}, or correct their unit"
    )
    raise DataError("friction/rigid-body", text, location)


def turns_against_gravity(robot: Robot, joint: Joint, posture: Configuration | None) -> bool:
    """Return True if gravity at a motor changes with its angle, the others fixed; true of a robot with loops."""
    if joint.slides or robot.loops:
        return not joint.slides
    index, q = [link.name for link in robot.joints].index(joint.name), np.zeros((robot.n_l, 3))
    if posture is not None:
        q[list(robot.driven_indices)] = (robot.mixing @ posture.angles)[:, None]
    q[index] += (0.0, 1.1, 2.3)  # the gravity torque differs between these angles for any phase
    torques = rigid_torque(robot)(q, 0 * q, 0 * q)[index]
    return bool(np.ptp(torques) > 1e-9 * max(1.0, float(np.abs(torques).max())))
