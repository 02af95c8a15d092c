"""Plans of moves: the best one within limits, why there is none, the shortest time; references at even times."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.robot_friction import frictions
from elastid.linear.linearise import linearise
from elastid.linear.loaded import Ports, acted_on
from elastid.linear.modes import modes
from elastid.model.elastic import ElasticModel
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward
from elastid.simulation.dynamics import contacts
from elastid.use.command.collocation import SETTINGS, Planned, plan
from elastid.use.command.equations import CommandedRobot
from elastid.use.command.moves import MotionLimits, Move, References, held

STEP = 1.25  # between durations that bracket the shortest one


def margin_of(commanded: CommandedRobot, move: Move) -> float:
    """Half a period, s, of the slowest mode with the motors held at both ends, 0.02 to 0.3 s."""
    m, halves = commanded.model, [0.0]
    for angles in move.ends:
        linear = linearise(m, Configuration("end", angles), m.theta, m.inputs, "position")
        held = modes(acted_on(linear, Ports.at_frames(linear, ()), "held", None), linear.theta_ref)
        halves += (0.5 / held.freq_hz[:1]).tolist()
    return float(np.clip(max(halves), 0.02, 0.3))


def best_plan(commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float) -> Planned:
    """The plan by Gauss-Newton; where limits hold the tool off its path, with a wider e_0.

    Of a tool far from its path the square outweighs the torque's rate, which would leave torques that chatter.
    """
    planned = plan(commanded, move, limits, margin_s, replace(SETTINGS, iterations=30))
    for _ in range(2):
        away = float(planned_error(commanded, move, planned).max())
        if planned.has_converged and away < SETTINGS.tool_m * 20:
            break
        scale = max(SETTINGS.tool_m, min(away, 1.0) / 40)
        planned = plan(commanded, move, limits, margin_s, replace(SETTINGS, tool_m=scale))
    return planned


def planned_error(commanded: CommandedRobot, move: Move, planned: Planned) -> FloatArray:
    """Distance (N,) of the tool from its path at the knots, m."""
    t = np.unique(planned.q.t)
    target = commanded.poses(commanded.rigid(move, t)[0]).position
    return np.asarray(np.linalg.norm(commanded.poses(planned.q(t)).position - target, axis=1))


def shortest(
    commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, error_m: float
) -> Move | None:
    """The move in the shortest time in which the tool stays within error_m of its path; None where none was found."""

    def can(duration: float) -> bool:
        own = move.in_time(duration)
        planned = plan(commanded, own, limits, margin_s, replace(SETTINGS, iterations=30))
        return planned.is_feasible and bool(planned_error(commanded, own, planned).max() <= error_m)

    # The rigid robot, which is not far from the elastic one, needs about this.
    duration = first_duration(commanded, move, limits)
    works = can(duration)
    step = 1 / STEP if works else STEP
    for _ in range(12):
        if can(duration * step) != works:
            break
        duration *= step
    else:
        return None
    low, high = sorted((duration, duration * step))
    while high > 1.01 * low:  # then the shortest one is known
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
    slow = commanded.torque(q, 0 * v, 0 * a)
    moving = commanded.torque(q, 0 * v, a) - slow
    room = np.maximum(limits.torque - np.abs(slow), 0.05 * limits.torque)
    times.append(float(np.sqrt((np.abs(moving) / room).max())))
    return 1.1 * max(times)


def sampled(commanded: CommandedRobot, planned: Planned, rate_hz: float, until_s: float) -> References:
    """A plan at even times up to until_s after its end, at rest there."""
    low, high = planned.q.t[0], planned.q.t[-1]
    n = int(np.ceil((high + until_s - low) * rate_hz))
    time_s = low + np.arange(n + 1) / rate_hz
    m = commanded.model
    q, v, a, jerk = (held(planned.q, time_s, order) @ m.B for order in range(4))
    state = [held(planned.q, time_s + 0.5 / rate_hz, order) for order in range(3)]
    torque = commanded.torque(*state) - commanded.planned_friction(state[1])
    torque += friction_along(commanded.robot, m, state[1] @ m.B, rate_hz)
    return References(time_s, q, v, a, jerk, torque)


def friction_along(robot: Robot, model: ElasticModel, velocity: FloatArray, rate_hz: float) -> FloatArray:
    """Dry friction (N, n_u) of the motors along their velocities (N, n_u), link side, from rest, bristles included.

    That behind a gear's spring is not here: the motion of the joint is not that of its motor.
    """
    laws = [law for law in frictions(robot) if law.place in model.inputs]
    placed = contacts(model, laws)
    if not laws:
        return np.zeros_like(velocity)
    v, z = ca.SX.sym("v", model.n_q), ca.SX.sym("z", placed.n_states)
    curves = ca.SX(placed.curves)
    step = ca.Function("friction", [z, v], [placed.advanced(v, z, curves, 1 / rate_hz), placed.torque(v, z, curves)])
    states = model.B @ velocity.T
    _, torque = step.mapaccum(len(velocity))(np.zeros(placed.n_states), states)
    return np.asarray((np.linalg.pinv(model.B) @ torque.full()).T)


def rigid_references(robot: Robot, commanded: CommandedRobot, move: Move, time_s: FloatArray) -> References:
    """The rigid robot's feedforward along a move at even times: inverse dynamics and friction of the motors."""
    rate_hz = float(1 / np.diff(time_s).mean())
    model = commanded.model
    q0 = commanded.rigid_posture(move.ends[0])
    middle = time_s + 0.5 / rate_hz
    path = [move.at(middle, order) for order in range(3)]
    torque = feed_forward(model, q0, path[0] - move.ends[0], path[1], path[2])
    torque += friction_along(robot, model, path[1], rate_hz)
    q, v, a, jerk = (move.at(time_s, order) for order in range(4))
    return References(time_s, q, v, a, jerk, torque)
