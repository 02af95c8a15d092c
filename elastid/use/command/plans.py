"""Plans of moves: the best one within limits, why there is none, and the shortest time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.linear.equilibrium import free_coordinates
from elastid.use.command.collocation import SETTINGS, Planned, plan
from elastid.use.command.equations import CommandedRobot
from elastid.use.command.limits import MotionLimits, nearest_limit
from elastid.use.command.moves import Move
from elastid.use.command.references import sampled, torque_of

STEP = 1.25  # between durations that bracket the shortest one
CLOSE = 1.01  # ratio of durations between which the shortest one is known
TRIES = 12
_HOPELESS = 50.0  # of the error that is allowed, from which on no further steps would bring it there


def margin_of(commanded: CommandedRobot, move: Move) -> float:
    """Half a period, s, of the slowest mode with the motors held at both ends, 0.02 to 0.3 s."""
    m, free = commanded.model, free_coordinates(commanded.model)
    slowest = np.inf
    for angles in move.ends:
        q = commanded.rigid_posture(angles)
        K = m.stiffness(q, np.zeros(m.n_c), m.theta).full()[np.ix_(free, free)]
        M = m.mass(q, m.theta).full()[np.ix_(free, free)]
        compliance, _ = commanded.statics(q)
        squares = (
            1 / np.linalg.eigvals(compliance[np.ix_(free, free)] @ M).real.max(initial=1e-12) if K.size else np.inf
        )
        slowest = min(slowest, float(np.sqrt(squares)))
    return float(np.clip(np.pi / slowest, 0.02, 0.3))


def best_plan(commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float) -> Planned:
    """The plan by Gauss-Newton; where limits hold the tool off its path, by exact second derivatives and a wider e_0.

    Of a tool far from its path the square outweighs the torque's rate, which would leave torques that chatter.
    """
    planned = plan(commanded, move, limits, margin_s, replace(SETTINGS, iterations=30))
    for _ in range(2):
        away = float(planned_error(commanded, move, planned).max())
        if planned.has_converged and away < SETTINGS.tool_m * 20:
            break
        scale = max(SETTINGS.tool_m, min(away, 1.0) / 40)
        planned = plan(commanded, move, limits, margin_s, replace(SETTINGS, tool_m=scale, is_exact=True))
    return planned


def planned_error(commanded: CommandedRobot, move: Move, planned: Planned) -> FloatArray:
    """Distance (N,) of the tool from its path at the knots, m."""
    t = np.unique(planned.q.t)
    target = commanded.poses(commanded.rigid(move, t)[0]).position
    return np.asarray(np.linalg.norm(commanded.poses(planned.q(t)).position - target, axis=1))


def require_ends(commanded: CommandedRobot, move: Move, limits: MotionLimits) -> None:
    """DataError where an end of a move cannot be held within the limits, with the joint and its limit."""
    still = np.zeros((1, commanded.model.n_q))
    for end, angles in zip(("start", "end"), move.ends, strict=True):
        q = commanded.rest(angles)
        torque, at = torque_of(commanded, q[None], still, still)[0], commanded.model.B.T @ q
        for i, joint in enumerate(commanded.robot.driven):
            low, high = limits.angle[i]
            if not low <= at[i] <= high:
                raise DataError(
                    f"the move cannot be made: at its {end} the motor of joint {joint.name} stands at {at[i]:.4g} "
                    f"{joint.unit}, deflection included, and may be within [{low:.4g}, {high:.4g}]; move the path"
                )
            if not abs(torque[i]) <= limits.torque[i]:
                unit = "N" if joint.slides else "N*m"
                raise DataError(
                    f"the move cannot be made: at its {end} gravity takes {abs(torque[i]):.4g} {unit} of joint "
                    f"{joint.name}, whose limit is {limits.torque[i]:.4g} {unit}; choose a posture with less load, or "
                    "correct robot.bodies.joints.limits.torque"
                )


def obstacle(
    commanded: CommandedRobot, move: Move, limits: MotionLimits, planned: Planned, error: FloatArray, rate_hz: float
) -> str:
    """Where a plan leaves its path most, and the limit that is nearest there; error (N,): at its samples."""
    references = sampled(commanded, planned, rate_hz, 0.0)
    error = error[: len(references.time_s)]
    worst = int(np.argmax(error))
    around = np.flatnonzero(error >= 0.5 * error[worst])
    near = nearest_limit(commanded.robot, limits, references, slice(int(around[0]), int(around[-1]) + 1))
    why = "" if near is None else f", where {near}"
    where = ", ".join(f"{c:.3f}" for c in commanded.poses(planned.q(references.time_s[worst : worst + 1])).position[0])
    return (
        f"the tool leaves its path by {1e3 * error[worst]:.3g} mm {references.time_s[worst]:.3g} s after the start, at "
        f"({where}) m{why}"
    )


def shortest(
    commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, error_m: float
) -> Move | None:
    """The move in the shortest time in which the tool stays within error_m of its path; None where none was found."""

    def can(duration: float) -> bool:
        own = move.in_time(duration)
        for settings in (replace(SETTINGS, iterations=20), replace(SETTINGS, iterations=40, is_exact=True)):
            planned = plan(commanded, own, limits, margin_s, settings)
            away = planned_error(commanded, own, planned).max()
            if planned.is_feasible and away <= error_m:
                return True
            if away > _HOPELESS * error_m:
                return False
        return False

    # The rigid robot, which is not far from the elastic one, needs about this.
    move = move.in_time(max(move.duration, 0.9 * first_duration(commanded, move, limits)))
    duration, works = move.duration, can(move.duration)
    step = 1 / STEP if works else STEP
    for _ in range(TRIES):
        if can(duration * step) != works:
            break
        duration *= step
    else:
        return None
    low, high = sorted((duration, duration * step))
    while high > CLOSE * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if can(middle) else (middle, high)
    return move.in_time(high)


def first_duration(commanded: CommandedRobot, move: Move, limits: MotionLimits) -> float:
    """A duration, s, in which the rigid robot keeps the limits; 0 for a robot without any."""
    t = np.linspace(0, 1, 201)
    unit = move.in_time(1.0)
    parts = [np.abs(unit.at(t, order)).max(axis=0) for order in (1, 2, 3)]
    bounds = limits.velocity, limits.acceleration, limits.jerk
    times = [
        float((part / bound).max() ** (1 / (i + 1))) for i, (part, bound) in enumerate(zip(parts, bounds, strict=True))
    ]
    q, v, a = commanded.rigid(unit, t)
    slow = torque_of(commanded, q, 0 * v, 0 * a)
    moving = torque_of(commanded, q, 0 * v, a) - slow
    room = np.maximum(limits.torque - np.abs(slow), 0.05 * limits.torque)
    times.append(float(np.sqrt((np.abs(moving) / room).max())))
    return 1.1 * max(times)
