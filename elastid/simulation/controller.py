r"""The sampled joint controller that keeps the robot in its configuration, or on a slow movement about it.

.. math:: u_k = u_{ff,k} + e_k + k_i T_s \sum_{j<k} e_j + r_k, \qquad
          e_k = k_p (q_{ref,k} - y_k) + k_d (\dot q_{ref,k} - (y_k - y_{k-1}) / T_s)

y: reading of the motor encoder, u_ff: torque of the rigid robot on its reference, r: the injected multisine. u_k is
computed from the reading of the same sample and held until the next: there is no delay but that of the hold. With k_i
this is the cascade of robot controllers: a proportional loop of position, k_p / k_d, around a loop of velocity with
proportional gain k_d and integral time 1 / k_i.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from elastid.arrays import FloatArray, frozen
from elastid.model.elastic import ElasticModel


@dataclass(frozen=True)
class Gains:
    """Feedback of motor position and velocity: kp (n_u,) in Nm/rad, kd (n_u,) in Nm s/rad, link side, ki (n_u,) in 1/s.

    ki: 0 without integral action.
    """

    kp: FloatArray
    kd: FloatArray
    ki: FloatArray = field(default_factory=lambda: np.zeros(1))

    def __post_init__(self) -> None:
        """Freeze the gains."""
        for name in ("kp", "kd", "ki"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def rigid_motion(model: ElasticModel) -> FloatArray:
    """T (n_q, n_u) with q' = T q_a': how the robot moves where no spring gives, motor and joint together."""
    T: FloatArray = np.array(model.B)
    for column, place in enumerate(model.inputs):
        T[model.index(place.replace("motor ", "joint ", 1)), column] = 1.0
    return T


def tuned(
    model: ElasticModel, q: FloatArray, bandwidth_hz: float, damping_ratio: float, integral_time: float | None = None
) -> Gains:
    """Gains that give the rigid robot, each axis on its own, a loop of this bandwidth and damping ratio in q (n_q,).

    kp = J omega^2, kd = 2 zeta omega J with J = diag(T^T M(q) T), links and motor together.  integral_time: of the
    velocity loop of a cascade, in s; without it there is no integral.
    """
    T = rigid_motion(model)
    inertia = np.diag(T.T @ model.mass(q, model.theta).full() @ T)
    omega = 2 * np.pi * bandwidth_hz
    ki = np.full(model.n_u, 0.0 if integral_time is None else 1 / integral_time)
    return Gains(inertia * omega**2, 2 * damping_ratio * omega * inertia, ki)


def feed_forward(
    model: ElasticModel, q0: FloatArray, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Torque (n, n_u) of the rigid robot, u = T^T (M T q_a'' + f(q, T q_a')), at q = q0 + T q_a.

    position, velocity, acceleration (n, n_u): q_a and its derivatives, about the equilibrium q0 (n_q,). At rest in the
    equilibrium this is the holding torque, since T^T B = 1. Springs do not enter, they act within; viscous friction
    does.
    """
    T = rigid_motion(model)
    q, v = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q)
    a = ca.SX.sym("a", model.n_q)
    torque = ca.DM(T.T) @ (model.mass(q, model.theta) @ a + model.force(q, v, model.theta))
    inverse = ca.Function("feed_forward", [q, v, a], [torque]).map(len(position))
    held = inverse(q0[:, None] + T @ position.T, T @ velocity.T, T @ acceleration.T)
    return np.array(held.full().T)


def feedback(
    reading: ca.SX, last: ca.SX, position: ca.SX, velocity: ca.SX, kp: ca.SX, kd: ca.SX, rate_hz: float
) -> ca.SX:
    """k_p (q_ref - y_k) + k_d (q_ref' - (y_k - y_{k-1}) / T_s) as an expression."""
    return kp * (position - reading) + kd * (velocity - (reading - last) * rate_hz)
