"""Robots under held torque and Coulomb friction, integrated step by step: what a closed loop is compared with."""

import casadi as ca
import numpy as np

from elastid.friction.static import SLIDING_VELOCITY
from elastid.model.elastic import ElasticModel
from elastid.simulation.dynamics import free_acceleration
from elastid.simulation.runge_kutta import CLASSICAL, Tableau, runge_kutta_step


def acceleration(model: ElasticModel, coulomb: np.ndarray) -> ca.Function:
    """(q, v, u) -> q'' of shape (n_q,), for torques u (n_u,) and Coulomb levels (n_u,) of the motors in Nm."""
    q, v, u = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q), ca.SX.sym("u", model.n_u)
    B, shafts = ca.DM(model.B), ca.sparsify(ca.DM(model.robot.mixing @ model.B.T))
    torque = B @ u - shafts.T @ (ca.DM(coulomb) * ca.tanh(shafts @ v / SLIDING_VELOCITY))
    return ca.Function("acceleration", [q, v, u], [free_acceleration(model)(q, v, torque)], {"cse": True})


def runge_kutta(acceleration: ca.Function, step: float, steps: int, method: Tableau = CLASSICAL) -> ca.Function:
    """(q, v, u) -> (q, v) after `steps` Runge-Kutta steps of `step` s at constant torque u."""
    n, n_u = acceleration.size1_in(0), acceleration.size1_in(2)
    q0, v0, u = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("u", n_u)
    q, v, z, torques = q0, v0, ca.SX(0, 1), (u,) * len(method.weights)
    for _ in range(steps):
        q, v, z = runge_kutta_step(
            lambda q, v, z, u: acceleration(q, v, u), lambda z, v, step: z, q, v, z, torques, step, method
        )
    return ca.Function("runge_kutta", [q0, v0, u], [q, v])


def energy(model: ElasticModel, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """T + V (n,) in J along a trajectory q, v (n, n_q)."""
    x, w = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q)
    total = w.T @ model.mass(x, model.theta) @ w / 2 + model.potential(x, model.theta)
    return np.array(ca.Function("energy", [x, w], [total]).map(len(q))(q.T, v.T).full()[0])
