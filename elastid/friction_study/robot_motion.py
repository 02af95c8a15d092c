r"""Friction of several axes from a motion in which they move together, jointly with the rigid body that they carry.

.. math:: u = Y(q, \dot q, \ddot q)\, \pi + J_m \ddot q + o + f \dot q + F_c\, \mathrm{sgn}\, \dot q

Y is the regressor of the robot's geometry; masses, inertias, rotors and offsets pi are taken out without having to be
known (Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, chapter 12). Torques that the rigid
body lacks (springs, counterbalances, couplings of gears) stay in the residuals: friction is known only as well as they
are small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.linalg import qr
from scipy.special import ndtr

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_study.laws import Held
from elastid.friction_study.least_squares import FALSE_ALARM, RANK_TOLERANCE, Equations, Regression, Solution, solve
from elastid.friction_study.motion import MotionFriction, parts_held, refuse_driving
from elastid.friction_study.motion_signals import Motion, MotionSignals
from elastid.model.rigid_body import inverse_dynamics, regressor
from elastid.robot import Robot

# Below the first resonance of a robot, so that it is rigid, and above the frequencies of its motions.
ROBOT_PASSBAND_HZ = 10.0
GRAVITY_HIDES = "Coulomb friction that differs between the directions cannot be distinguished from offset and gravity"


@dataclass(frozen=True)
class RobotLog:
    """A log of joints that move together: motions by joint, and the angles of the joints that rest."""

    motions: Mapping[str, Motion]
    resting: Mapping[str, float]


@dataclass(frozen=True)
class RobotMotion:
    """Friction by joint; and of each log the motions by joint without the torque of what is no friction."""

    friction: Mapping[str, MotionFriction]
    alone: tuple[Mapping[str, Motion], ...]


def regress_robot_motion(robot: Robot, logs: Sequence[RobotLog], passband_hz: float = ROBOT_PASSBAND_HZ) -> RobotMotion:
    """Friction of the joints that all logs move; DataError for short logs, robots with loops, friction that drives."""
    if robot.loops:
        raise DataError(
            f"robot {robot.name} has loops, and the rigid body of joints that move together is known of open chains "
            "only; record a motion of one joint at a time"
        )
    joints = tuple(logs[0].motions)
    signals = [{joint: MotionSignals.of(log.motions[joint], passband_hz) for joint in joints} for log in logs]
    rigid = _rigid_columns(robot, logs, signals)
    rate_hz = signals[0][joints[0]].kept_hz
    solutions = [
        solve([_equations(each, columns, apart) for each, columns in zip(signals, rigid, strict=True)], rate_hz)
        for apart in (False, True)
    ]
    torques = [columns @ solutions[0].pi for columns in rigid]
    alone = tuple(
        {
            joint: replace(log.motions[joint], torque=log.motions[joint].torque - torque[:, i])
            for i, joint in enumerate(joints)
        }
        for log, torque in zip(logs, torques, strict=True)
    )
    friction = {
        joint: _of_joint([(log[joint], each[joint]) for log, each in zip(alone, signals, strict=True)], i, *solutions)
        for i, joint in enumerate(joints)
    }
    return RobotMotion(friction, alone)


def torques_in_file(robot: Robot, log: RobotLog, passband_hz: float = ROBOT_PASSBAND_HZ) -> dict[str, FloatArray]:
    """The torque (n,) of rigid body and rotor by joint, with the masses of the robot's file."""
    names = [joint.name for joint in robot.joints]
    signals = {joint: MotionSignals.of(motion, passband_hz) for joint, motion in log.motions.items()}
    state = _states(names, log, signals)
    theta = np.array([[value] for value, _ in robot.parameters().values()])
    tau = np.asarray(inverse_dynamics(robot)(*state, np.tile(theta, state.shape[2])).full())
    rotors = {j.name: j.motor.inertia * j.motor.ratio**2 for j in robot.driven if j.motor is not None}
    return {joint: tau[names.index(joint)] + rotors[joint] * each.acceleration for joint, each in signals.items()}


def _rigid_columns(
    robot: Robot, logs: Sequence[RobotLog], signals: Sequence[Mapping[str, MotionSignals]]
) -> list[FloatArray]:
    """All columns but those of friction, at full rate (n, m, n_r) of each log: rigid body, rotors, offsets."""
    names = [joint.name for joint in robot.joints]
    rows = [names.index(joint) for joint in signals[0]]
    Y = regressor(robot)
    states = [_states(names, log, each) for log, each in zip(logs, signals, strict=True)]
    few = [state[:, :, :: max(1, state.shape[2] // 500)] for state in states]  # instants for the rank alone
    sample = np.concatenate([_values(Y, state)[:, rows].reshape(-1, Y.size2_out(0)) for state in few])
    chosen = _independent(sample)
    q, v, a = (ca.SX.sym(name, len(names)) for name in "qva")
    part = ca.Function("part", [q, v, a], [Y(q, v, a)[rows, chosen]])
    m = len(rows)
    columns = []
    for state in states:
        own = np.zeros((state.shape[2], m, 2 * m))
        for i, row in enumerate(rows):
            own[:, i, i], own[:, i, m + i] = state[2, row], 1.0
        columns.append(np.concatenate([_values(part, state), own], axis=2))
    return columns


def _states(names: Sequence[str], log: RobotLog, signals: Mapping[str, MotionSignals]) -> FloatArray:
    """q, v, a (3, n_l, n) of all joints of the robot."""
    state = np.zeros((3, len(names), len(next(iter(signals.values())).position)))
    for joint, angle in log.resting.items():
        state[0, names.index(joint)] = angle
    for joint, each in signals.items():
        state[:, names.index(joint)] = each.position, each.velocity, each.acceleration
    return state


def _values(function: ca.Function, state: FloatArray) -> FloatArray:
    """A matrix (rows, columns) at n states, as (n, rows, columns)."""
    flat = np.asarray(ca.DM(function(*state)))
    return flat.reshape(len(flat), state.shape[2], -1).swapaxes(0, 1)


def _independent(columns: FloatArray) -> list[int]:
    """Places of columns (n, n_c) that span all of them: the base parameters."""
    size = np.linalg.norm(columns, axis=0)
    moving = np.flatnonzero(size > 0)
    if not len(moving):
        return []
    _, R, order = qr(columns[:, moving] / size[moving], mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    return sorted(moving[order[: int(np.sum(diagonal > RANK_TOLERANCE * diagonal[0]))]].tolist())


def _equations(signals: Mapping[str, MotionSignals], rigid: FloatArray, apart: bool) -> Equations:
    """Each joint has columns of its own: viscous and Coulomb friction, and what is viscous in one direction more."""
    first = next(iter(signals.values()))
    parts = [
        np.stack([each.velocity, each.direction, *([np.abs(each.velocity)] if apart else [])], axis=1)
        for each in signals.values()
    ]
    n, width = parts[0].shape
    X = np.zeros((n, len(parts), width * len(parts)))
    for i, own in enumerate(parts):
        X[:, i, i * width : (i + 1) * width] = own
    torque = np.stack([each.torque for each in signals.values()], axis=1)
    states = np.zeros((len(first.filtered(torque)), 0))
    return Equations(first.filtered(X), first.filtered(rigid), first.filtered(torque), states)


def _of_joint(
    logs: Sequence[tuple[Motion, MotionSignals]], i: int, alike_fit: Solution, apart_fit: Solution
) -> MotionFriction:
    """The i-th joint's numbers; logs: its motions without the rigid body, and their signals."""
    motion, signals = logs[0][0], [each for _, each in logs]
    shared = alike_fit.of_joint(i, range(2 * i, 2 * i + 2), ("viscous", "coulomb"))
    directed = apart_fit.of_joint(i, range(3 * i, 3 * i + 3), ("viscous", "coulomb", "directions.viscous"))
    refuse_driving(motion.place, shared)
    chance = float(2 * ndtr(-abs(directed["directions.viscous"]) / max(directed.std("directions.viscous"), 1e-300)))
    plateaus = tuple(plateau for each in signals for plateau in each.plateaus)
    held = (*parts_held(plateaus, motion.slides), Held("directions.coulomb", GRAVITY_HIDES))
    notes = (_rigid_body_note(motion.place, signals, shared),)
    inside = sum((each.kept.stop - each.kept.start) / each.rate_hz for each in signals)
    return MotionFriction(
        motion,
        shared,
        directed,
        chance < FALSE_ALARM,
        chance,
        plateaus,
        held,
        signals[0].passband_hz,
        notes,
        {"used": inside, "ends of the log": sum(len(each.position) / each.rate_hz for each in signals) - inside},
    )


def _rigid_body_note(place: str, signals: Sequence[MotionSignals], fit: Regression) -> Note:
    """The share of the torque that rigid body and friction leave, and its effect on the numbers."""
    v = np.concatenate([each.filtered(each.velocity) for each in signals])
    s = np.concatenate([each.filtered(each.direction) for each in signals])
    friction = float(np.linalg.norm(fit["viscous"] * v + fit["coulomb"] * s))
    share = float(np.sqrt(fit.sum_of_squares)) / max(friction, 1e-300)
    independent = len(v) * (1 - fit.correlation) / (1 + fit.correlation)
    dominates = share > 0.1  # of the torque of friction, above which residuals dominate the error of its numbers
    text = (
        f"{fit.relative_error:.1%} of its torque is left by rigid body and friction, {share:.0%} of what friction "
        f"takes, correlated so that {len(v)} samples are {independent:.0f} independent ones"
    )
    advice = (
        ": the error of the rigid-body model (counterbalance, springs, couplings of gears) is larger than noise, and "
        "the numbers of friction hold only together with it; passes of this joint alone do not depend on it"
    )
    return Note(
        "rigid-body-error", text + (advice if dominates else ""), f"motion of {place}",
        "warning" if dominates else "information",
    )  # fmt: skip
