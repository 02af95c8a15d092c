r"""Friction of several axes from a motion in which they move together, jointly with the rigid body that they carry.

.. math:: u = Y(q, \dot q, \ddot q)\, \pi + J_m \ddot q + o + f \dot q + F_c\, \mathrm{sgn}\, \dot q

Y is the regressor of the robot's geometry; masses, inertias, rotors and offsets pi are taken out without having to be
known (Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, chapter 12). Torques that the rigid
body lacks (springs, counterbalances, couplings of gears) stay in the residuals: friction is known only as well as they
are small. The base parameters, with the columns that they belong to, give the rigid body's torque along other logs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.linalg import qr

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, Note, Severity
from elastid.friction_study.laws import Held
from elastid.friction_study.least_squares import (
    FALSE_ALARM,
    RANK_TOLERANCE,
    Equations,
    Regression,
    Solution,
    solve,
)
from elastid.friction_study.motion import (
    LIMITS,
    ONE_LOAD,
    MotionFriction,
    Moved,
    RigidBody,
    judged,
    moved_numbers,
    too_few_speeds,
)
from elastid.friction_study.motion_signals import MotionLog, MotionSignals, both_bands
from elastid.friction_study.motion_terms import MotionTerms, equations_of
from elastid.model.rigid_body import inverse_dynamics, regressor
from elastid.robot import Robot

# Below the first resonance of a robot, so that it is rigid, and above the frequencies of its motions.
ROBOT_PASSBAND_HZ = 10.0
# Numbers of a joint's frame in the order of the regressor's columns, with their units.
_OF_FRAME = {"m": "kg"} | dict.fromkeys(("mcx", "mcy", "mcz"), "kg*m")
_OF_FRAME |= dict.fromkeys(("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"), "kg*m^2")
# Part of a column that is no combination of the base columns, above which other motions have not identified it.
MAX_UNIDENTIFIED = 1e-3
# Of columns of unit length: numbers that logs barely excite are large, of either sign, and predict no other motion
# (Hoerl and Kennard, Technometrics 12, 1970).
RIDGES = (0.0, 0.03, 0.1, 0.3, 1.0)
ALONE = "joints that move together are regressed without; record this joint alone, cold and warm"
GRAVITY_HIDES = "Coulomb friction that differs between the directions cannot be distinguished from offset and gravity"


def regress_robot_motion(
    robot: Robot, logs: Sequence[MotionLog]
) -> tuple[dict[str, MotionFriction], list[dict[str, MotionSignals]]]:
    """Friction of the joints that all logs move, and of each log their signals without the torque of the rigid body.

    DataError for robots with loops, and friction that drives.
    """
    _refuse_loops(robot)
    joints = tuple(logs[0].of_joints)
    chosen, regrouped = _base_columns(robot, joints, logs)
    rigid = [_columns(robot, joints, joints, each, chosen) for each in logs]

    def equations(terms: Mapping[str, MotionTerms], sliding: bool = True) -> list[Equations]:
        return [equations_of(log, terms, own, sliding) for log, own in zip(logs, rigid, strict=True)]

    terms, rate_hz = dict.fromkeys(joints, MotionTerms(friction_only=True)), logs[0].first.kept_hz
    every = solve(equations(terms), rate_hz)
    terms = {
        joint: replace(own, apart=every.at(joint).chance("directions.viscous", 0) < FALSE_ALARM)
        for joint, own in terms.items()
    }
    least = solve(equations(terms), rate_hz)
    moved = moved_numbers(
        both_bands(logs, LIMITS.narrow),
        lambda log: equations_of(log, terms, _columns(robot, joints, joints, log, chosen)),
    )
    names, units = zip(*_numbers(robot, joints), strict=True)
    # Near reversals friction is not as the regression has it, but a rigid body that they contradict predicts none.
    shrunk, own = (_rigid_numbers(equations(terms, False), least, ridges) for ridges in (RIDGES, RIDGES[:1]))
    of_base = tuple(units[i] for i in chosen)
    body = RigidBody(joints, of_base, least.pi, least.pi_std, shrunk, chosen, regrouped, names)
    alone = [_without(each, columns @ own) for each, columns in zip(logs, rigid, strict=True)]
    friction = {
        joint: replace(_of_joint([each[joint] for each in alone], least.at(joint), own, moved, joint), rigid_body=body)
        for joint, own in terms.items()
    }
    return friction, alone


def _refuse_loops(robot: Robot) -> None:
    if robot.loops:
        text = "it has loops, and the rigid body along a log is known of open chains; record one joint there and back"
        raise DataError("friction/rigid-body", text, f"robot {robot.name}")


def _states(robot: Robot, log: MotionLog) -> FloatArray:
    """q, v, a (3, n_l, n) of all joints of the robot."""
    names = [joint.name for joint in robot.joints]
    state = np.zeros((3, len(names), len(log.first.position)))
    for joint, angle in log.resting.items():
        state[0, names.index(joint)] = angle
    for joint, each in log.of_joints.items():
        state[:, names.index(joint)] = each.position, each.velocity, each.acceleration
    return state


def _without(log: MotionLog, torque: FloatArray) -> dict[str, MotionSignals]:
    """Signals by joint, less a torque (n, m)."""
    pairs = zip(log.of_joints.items(), torque.T, strict=True)
    return {
        joint: replace(each, motion=replace(each.motion, torque=each.motion.torque - own))
        for (joint, each), own in pairs
    }


def torques_in_file(robot: Robot, log: MotionLog) -> dict[str, FloatArray]:
    """The torque (n,) of rigid body and rotor by joint, with the masses of the robot's file; DataError with loops."""
    _refuse_loops(robot)
    names, state = [joint.name for joint in robot.joints], _states(robot, log)
    theta = np.array([[value] for value, _ in robot.parameters().values()])
    tau = np.asarray(inverse_dynamics(robot)(*state, np.tile(theta, state.shape[2])).full())
    rotors = {j.name: j.motor.inertia * j.motor.ratio**2 for j in robot.driven if j.motor is not None}
    return {joint: tau[names.index(joint)] + rotors[joint] * each.acceleration for joint, each in log.of_joints.items()}


def rigid_body_torques(robot: Robot, body: RigidBody, log: MotionLog) -> dict[str, FloatArray]:
    """The torque (n,) of the identified rigid body along a log, of each joint of both; empty where there is none.

    DataError where its motion takes numbers that the motions behind `body` have not identified.
    """
    rows = tuple(joint for joint in log.of_joints if joint in body.joints)
    if not rows:
        return {}
    sample = _columns(robot, body.joints, rows, log).reshape(-1, len(body.columns))
    left = np.linalg.norm(sample - sample[:, body.chosen] @ body.regrouped, axis=0)
    lacking = left / _sizes(sample) > MAX_UNIDENTIFIED
    if lacking.any():
        first = ", ".join(body.columns[i] for i in np.flatnonzero(lacking)[:3])
        raise DataError(
            "friction/rigid-body",
            f"its motion takes numbers of the rigid body that those behind the result have not identified ({first}"
            f"{', ...' if lacking.sum() > 3 else ''}); identify from a log in which the same joints move",
        )
    torques = _columns(robot, body.joints, rows, log, body.chosen) @ body.predicting
    return {joint: torques[:, i] for i, joint in enumerate(rows)}


def _numbers(robot: Robot, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Name and unit of the number of each column: of all frames, then rotors and offsets of the joints."""
    of_frames = [(f"{name}_{joint.name}", unit) for joint in robot.joints for name, unit in _OF_FRAME.items()]
    slides = {joint.name: joint.slides for joint in robot.joints}
    rotors = [(f"Jm_{joint}", "kg" if slides[joint] else "kg*m^2") for joint in joints]
    return [*of_frames, *rotors, *((f"o_{joint}", "N" if slides[joint] else "N*m") for joint in joints)]


def _base_columns(robot: Robot, joints: tuple[str, ...], logs: Sequence[MotionLog]) -> tuple[IntArray, FloatArray]:
    """Places (n_b,) of columns that span all of those of friction's rest, and these as combinations of them (n_b, n_c).

    All columns: rigid body (10 n_l), rotors (m) and offsets (m).
    """
    sample = np.vstack([column for each in logs for column in _columns(robot, joints, joints, each)])
    size = _sizes(sample)
    _, R, order = qr(sample / size, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    chosen = np.sort(order[: int(np.sum(diagonal > RANK_TOLERANCE * diagonal[0]))]).astype(np.int64)
    regrouped = np.linalg.lstsq(sample[:, chosen] / size[chosen], sample, rcond=None)[0] / size[chosen, None]
    return chosen, np.asarray(regrouped)


def _sizes(sample: FloatArray) -> FloatArray:
    """Norms (n_c,) of columns; infinite of one that is zero but for rounding, whose number no motion shows."""
    size = np.linalg.norm(sample, axis=0)
    return np.where(size > 1e-9 * size.max(), size, np.inf)


def _columns(
    robot: Robot, joints: Sequence[str], rows: Sequence[str], log: MotionLog, chosen: IntArray | None = None
) -> FloatArray:
    """Chosen columns of all but friction (n, m, n_b), m the joints of `rows`; all for None, at some 500 instants."""
    names, state = [joint.name for joint in robot.joints], _states(robot, log)
    if chosen is None:
        chosen, state = np.arange(10 * len(names) + 2 * len(joints)), state[:, :, :: max(1, state.shape[2] // 500)]
    n, n_l, places, m = state.shape[2], len(names), [names.index(joint) for joint in rows], len(joints)
    q, v, a = (ca.SX.sym(name, n_l) for name in "qva")
    of_frames = chosen[chosen < 10 * n_l].tolist()
    Y = ca.Function("part", [q, v, a], [regressor(robot)(q, v, a)[places, of_frames]])
    own = np.zeros((n, len(rows), 2 * m))
    for i, (joint, place) in enumerate(zip(rows, places, strict=True)):
        k = list(joints).index(joint)
        own[:, i, k], own[:, i, m + k] = state[2, place], 1.0
    of_rigid_body = np.asarray(ca.DM(Y(*state))).reshape(len(rows), n, -1).swapaxes(0, 1)
    return np.concatenate([of_rigid_body, own[:, :, chosen[chosen >= 10 * n_l] - 10 * n_l]], axis=2)


def _rigid_numbers(logs: Sequence[Equations], solution: Solution, ridges: Sequence[float]) -> FloatArray:
    """The numbers (n_b,) of the rigid body by ridge regression on the torque of these logs without friction.

    By that of the ridges with which fifths of the record are predicted best by the rest of it.
    """
    weight = 1 / np.maximum(np.sqrt(solution.sum_of_squares), 1e-300)
    R = np.concatenate([weight[:, None] * log.R for log in logs])
    target = np.concatenate([weight * (log.y - log.X @ solution.beta) for log in logs])
    size, n_b = np.maximum(np.linalg.norm(R, axis=(0, 1)), 1e-300), R.shape[2]
    fifths = [
        (own.reshape(-1, n_b), y.ravel())
        for own, y in zip(np.array_split(R / size, 5), np.array_split(target, 5), strict=True)
    ]

    def numbers(parts: Sequence[tuple[FloatArray, FloatArray]], ridge: float) -> FloatArray:
        flat = np.concatenate([*(own for own, _ in parts), ridge * np.eye(n_b)])
        y = np.concatenate([*(y for _, y in parts), np.zeros(n_b)])
        return np.asarray(np.linalg.lstsq(flat, y, rcond=RANK_TOLERANCE)[0])

    def error(ridge: float) -> float:
        left = (y - own @ numbers([*fifths[:i], *fifths[i + 1 :]], ridge) for i, (own, y) in enumerate(fifths))
        return float(sum(np.sum(e**2) for e in left))

    best = ridges[0] if len(ridges) == 1 else min(ridges, key=error)
    return np.asarray(numbers(fifths, best) / size)


def _of_joint(
    signals: Sequence[MotionSignals], regression: Regression, terms: MotionTerms, moved: Moved, joint: str
) -> MotionFriction:
    """A joint's numbers, judged; signals: of its motions without the rigid body."""
    advice = (
        "the rigid body and its friction do not explain the torque; measure passes of this joint alone, which do not "
        "depend on the rigid body"
    )
    fit, motion = MotionFriction.of(signals, regression, terms), signals[0].motion
    reasons = {"stribeck": too_few_speeds(fit.plateaus), "temperature": ALONE}
    held = [Held(part, reason) for part, reason in reasons.items() if reason]
    held += [ONE_LOAD, Held("directions.coulomb", GRAVITY_HIDES)]
    chosen, misfit = judged(regression, joint, moved, fit.passband_hz, advice)
    notes = (_rigid_body_note(motion.place, signals, regression),)
    return replace(fit, chosen=chosen, misfit=misfit, held=tuple(held), notes=notes)


def _rigid_body_note(place: str, signals: Sequence[MotionSignals], fit: Regression) -> Note:
    """The share of the torque that rigid body and friction leave, and its effect on the numbers."""
    v = np.concatenate([each.filtered(each.velocity)[each.used] for each in signals])
    s = np.concatenate([each.filtered(each.direction)[each.used] for each in signals])
    friction = float(np.linalg.norm(fit["viscous"] * v + fit["coulomb"] * s))
    share = float(np.sqrt(fit.sum_of_squares)) / max(friction, 1e-300)
    dominates = share > 0.1  # of the torque of friction, above which residuals dominate the error of its numbers
    text = (
        f"{fit.relative_error:.1%} of its torque is left by rigid body and friction, {share:.0%} of what friction takes"
    )
    if dominates:
        text += (
            ": the error of the rigid-body model (counterbalance, springs, couplings of gears) is larger than noise, "
            "and the numbers of friction hold only together with it; passes of this joint alone do not depend on it"
        )
    severity: Severity = "warning" if dominates else "information"
    return Note("friction/rigid-body", text, f"motion of {place}", severity)
