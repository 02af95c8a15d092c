r"""Motion under constraints: accelerations with Baumgarte's terms, and projection onto the closed loops.

.. math:: \begin{bmatrix} M & \Phi^T \\ \Phi & 0 \end{bmatrix} \begin{bmatrix} \ddot q \\ \lambda \end{bmatrix} =
          \begin{bmatrix} \tau - f \\ -\dot\Phi \dot q - \alpha \Phi \dot q - \beta \varphi \end{bmatrix}, \qquad
          \ddot\varphi + \alpha \dot\varphi + \beta \varphi = 0

Niglis & Oberg (2015), eqs. (2.35) to (2.40), with their alpha and beta: Baumgarte's own are alpha / 2 and the root of
beta, critical damping is beta = alpha^2 / 4. The saddle point is not factorised, since symbols cannot pivot and M is
singular where a rod weighs nothing. The dependent coordinates are eliminated with pivots chosen beforehand, in numbers,
and Z^T M Z, which is positive definite, is factorised: q'' = a_0 + Z y'', exactly the solution of the saddle point.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.closed_posture import assembled
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import Partition, partition


def constrained_acceleration(
    model: ElasticModel, alpha: float = 0.0, beta: float = 0.0, theta: ca.SX | None = None
) -> ca.Function:
    """(q, v, torque) -> q'' of shape (n_q,), for torques (n_q,) on the coordinates of a model with loops.

    theta (n_theta,): symbols, which become a fourth argument; the model's own numbers by default.
    """
    q, v, torque = (ca.SX.sym(name, model.n_q) for name in ("q", "v", "torque"))
    numbers = model.theta if theta is None else theta
    phi, Phi = model.constraint(q, numbers), model.constraint_jacobian(q, numbers)
    rate = Phi @ v
    gamma = -ca.jtimes(rate, q, v) - alpha * rate - beta * phi
    Z, a0 = _solved(Phi, gamma, pivots(model))
    M, f = ca.sparsify(model.mass(q, numbers)), model.force(q, v, numbers)
    D, LT, order = ca.ldl(ca.sparsify(Z.T @ M @ Z))
    y = ca.ldl_solve(Z.T @ (torque - f - M @ a0), D, LT, order)
    given = [q, v, torque, *([] if theta is None else [theta])]
    return ca.Function("constrained_acceleration", given, [a0 + Z @ y], {"cse": True})


def projection(model: ElasticModel, theta: ca.SX | None = None) -> ca.Function:
    """(q, v) -> (q, v) on the closed loops: the dependent coordinates by a Newton step, their rates by Z.

    theta (n_theta,): symbols, which become a third argument; the model's own numbers by default.
    """
    q, v = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q)
    numbers = model.theta if theta is None else theta
    parts = pivots(model)
    _, step = _solved(model.constraint_jacobian(q, numbers), -model.constraint(q, numbers), parts)
    closed = q + step
    Z, _ = _solved(model.constraint_jacobian(closed, numbers), ca.SX(model.n_c, 1), parts)
    given = [q, v, *([] if theta is None else [theta])]
    return ca.Function("projection", given, [closed, Z @ v[parts.independent.tolist()]], {"cse": True})


def pivots(model: ElasticModel) -> Partition:
    """Dependent coordinates and the rows that determine them, chosen in the start posture and kept."""
    start = np.array([joint.start for joint in model.robot.driven])
    q = np.zeros(model.n_q)
    q[: len(model.robot.joints)] = assembled(model.robot, start)
    return partition(model, model.constraint_jacobian(q, model.theta).full())


def violation(model: ElasticModel, q: FloatArray) -> float:
    """max |phi| over a trajectory q (n, n_q): the gap of a loop in m, or in rad where a direction is constrained."""
    return float(np.abs(model.constraint.map(len(q))(q.T, model.theta).full()).max(initial=0.0)) if model.n_c else 0.0


def energy(model: ElasticModel, q: FloatArray, v: FloatArray) -> FloatArray:
    """T + V (n,) in J along a trajectory q, v (n, n_q)."""
    x, w = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q)
    total = w.T @ model.mass(x, model.theta) @ w / 2 + model.potential(x, model.theta)
    return np.array(ca.Function("energy", [x, w], [total]).map(len(q))(q.T, v.T).full()[0])


def _solved(Phi: ca.SX, right: ca.SX, parts: Partition) -> tuple[ca.SX, ca.SX]:
    """Z (n_q, n) with Phi Z = 0, and a (n_q,) with Phi a = right that is zero in the independent coordinates.

    Gauss and Jordan with the pivots given; zeros stay zeros.
    """
    table = ca.horzcat(Phi, right)[parts.rows.tolist(), :]
    columns = parts.dependent.tolist()
    rows = [ca.sparsify(table[i, :]) for i in range(len(columns))]
    for i, column in enumerate(columns):
        rows[i] = rows[i] / rows[i][column]
        for k in range(len(rows)):
            if k != i and not rows[k][column].is_zero():
                rows[k] = rows[k] - rows[k][column] * rows[i]
    n_q, independent = Phi.size2(), parts.independent.tolist()
    Z, a = ca.SX(n_q, len(independent)), ca.SX(n_q, 1)
    for place, column in enumerate(independent):
        Z[column, place] = 1
    for i, column in enumerate(columns):
        for place, other in enumerate(independent):
            Z[column, place] = -rows[i][other]
        a[column] = rows[i][n_q]
    return ca.sparsify(Z), ca.sparsify(a)
