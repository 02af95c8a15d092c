"""References of the motors at even times: of a plan, and of rigid feedforward; friction along their motion."""

from __future__ import annotations

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.robot_friction import frictions
from elastid.model.elastic import ElasticModel
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward
from elastid.simulation.dynamics import contacts
from elastid.use.command.collocation import Planned
from elastid.use.command.equations import CommandedRobot
from elastid.use.command.limits import References
from elastid.use.command.moves import Move


def sampled(commanded: CommandedRobot, planned: Planned, rate_hz: float, until_s: float) -> References:
    """A plan at even times up to until_s after its end, at rest there."""
    low, high = planned.q.t[0], planned.q.t[-1]
    n = int(np.ceil((high + until_s - low) * rate_hz))
    time_s = low + np.arange(n + 1) / rate_hz
    m = commanded.model
    q, v, a, jerk = (_held(planned, time_s, order) @ m.B for order in range(4))
    middle = time_s + 0.5 / rate_hz
    state = [_held(planned, middle, order) for order in range(3)]
    torque = torque_of(commanded, *state)
    smooth = state[1] @ m.B
    torque += friction_along(commanded.robot, m, smooth, rate_hz) - commanded.planned_friction(state[1])
    return References(time_s, q, v, a, jerk, torque)


def _held(planned: Planned, t: FloatArray, order: int) -> FloatArray:
    low, high = planned.q.t[0], planned.q.t[-1]
    values = np.asarray(planned.q(np.clip(t, low, high), order))
    if order:
        values[(t < low) | (t > high)] = 0.0
    return values


def torque_of(commanded: CommandedRobot, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """u (N, n_u) that a motion (N, n_q) takes; the forces in loops are those of least squares."""
    m, n = commanded.model, len(q)
    none = np.zeros((len(commanded.rows), n))
    force, _, _, Phi = (part.full() for part in commanded.balance.map(n)(q.T, v.T, a.T, none))
    if not commanded.rows:
        return np.asarray(force.T @ np.linalg.pinv(m.B).T)
    Phi = Phi.reshape(len(commanded.rows), n, m.n_q).transpose(1, 2, 0)
    columns = np.concatenate([np.broadcast_to(m.B, (n, *m.B.shape)), -Phi], axis=2)
    return np.asarray((np.linalg.pinv(columns) @ force.T[:, :, None])[:, : m.n_u, 0])


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
