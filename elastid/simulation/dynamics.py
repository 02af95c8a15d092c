r"""Equations of motion of an elastic model: its accelerations, its poles at rest, and the projection onto closed loops.

.. math:: \ddot q = M(q)^{-1} [B u - P \tau_f(P^T \dot q, z) - f(q, \dot q)], \qquad \dot z = \Omega(P^T \dot q, z)

Niglis & Oberg (2015), eqs. (2.10), (2.14). Link side, SI. Under constraints, eq. (2.34),

.. math:: \begin{bmatrix} M & \Phi^T \\ \Phi & 0 \end{bmatrix} \begin{bmatrix} \ddot q \\ \lambda \end{bmatrix} =
          \begin{bmatrix} \tau - f \\ -\dot\Phi \dot q \end{bmatrix}

and motions are projected onto the closed loops. The saddle point is not factorised, since symbols cannot pivot and M is
singular where a rod weighs nothing. The dependent coordinates are eliminated with pivots chosen beforehand, in numbers,
and Z^T M Z, which is positive definite, is factorised: q'' = a_0 + Z y'', exactly the solution of the saddle point.
"""

import casadi as ca
import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.model.closed_posture import assemble
from elastid.model.drivetrain import on_the_flanks
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import Partition, motions, partition
from elastid.simulation.contacts import Contacts


def free_acceleration(model: ElasticModel, theta: ca.SX | None = None) -> ca.Function:
    """Build (q, v, torque) -> q'' of shape (n_q,), for torques (n_q,) on the coordinates, with closed loops or without.

    theta (n_theta,): symbols, which become a fourth argument; the model's own numbers by default.

    M = L D L^T is factorised in symbols with its zeros, without pivots, which a positive definite M does not need. It
    costs nothing for motors without coupling, whose rows of M are diagonal.
    """
    q, v, torque = model.symbols("q", "v", "torque")
    numbers = model.theta if theta is None else theta
    M, load = ca.sparsify(model.mass(q, numbers)), torque - model.force(q, v, numbers)
    if model.n_c:
        Phi = model.constraint_jacobian(q, numbers)
        Z, a0 = _solve(Phi, -ca.jtimes(Phi @ v, q, v), pivots(model))
        M, load = ca.sparsify(Z.T @ M @ Z), Z.T @ (load - M @ a0)
    D, LT, order = ca.ldl(M)
    a = ca.ldl_solve(load, D, LT, order)
    arguments = [q, v, torque, *([] if theta is None else [theta])]
    return ca.Function("acceleration", arguments, [a0 + Z @ a if model.n_c else a], {"cse": True})


def poles(model: ElasticModel, contacts: Contacts, q: FloatArray) -> tuple[ComplexArray, str]:
    """Compute the poles (2 n,) in 1/s at rest in q (n_q,), and the coordinate that moves most at the fastest pole.

    Friction is linear about zero velocity; gears with backlash have their flanks' stiffness.  n: free coordinates.
    """
    M, D = model.mass(q, model.theta).full(), model.damping(q, model.theta).full()
    K = model.stiffness(q, np.zeros(model.n_c), on_the_flanks(model.parameters, model.theta)).full()
    stiffness, damping = contacts.at_rest()
    Z = motions(model, model.constraint_jacobian(q, model.theta).full())
    M, D, K = (Z.T @ matrix @ Z for matrix in (M, D + damping, K + stiffness))
    A = np.block([[np.zeros_like(M), np.eye(len(M))], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    values, vectors = np.linalg.eig(A)
    fastest = Z @ vectors[: Z.shape[1], np.argmax(np.abs(values))]
    return values.astype(complex), model.coordinates[int(np.argmax(np.abs(fastest)))]


def projection(model: ElasticModel, theta: ca.SX | None = None) -> ca.Function:
    """Build (q, v) -> (q, v) on the closed loops: the dependent coordinates by a Newton step, their rates by Z.

    theta (n_theta,): symbols, which become a third argument; the model's own numbers by default.
    """
    q, v = model.symbols("q", "v")
    numbers = model.theta if theta is None else theta
    division = pivots(model)
    _, step = _solve(model.constraint_jacobian(q, numbers), -model.constraint(q, numbers), division)
    projected = q + step
    Z, _ = _solve(model.constraint_jacobian(projected, numbers), ca.SX(model.n_c, 1), division)
    arguments = [q, v, *([] if theta is None else [theta])]
    return ca.Function("projection", arguments, [projected, Z @ v[division.independent.tolist()]], {"cse": True})


def pivots(model: ElasticModel) -> Partition:
    """Return dependent coordinates and the rows that determine them, chosen in the start posture and kept."""
    start = np.array([joint.start for joint in model.robot.driven])
    q = np.zeros(model.n_q)
    q[: model.robot.n_l] = assemble(model.robot, start)
    return partition(model, model.constraint_jacobian(q, model.theta).full())


def _solve(Phi: ca.SX, right: ca.SX, division: Partition) -> tuple[ca.SX, ca.SX]:
    """Return Z (n_q, n) with Phi Z = 0, and a (n_q,) with Phi a = right that is zero in the independent coordinates.

    Gauss and Jordan with the pivots given; zeros stay zeros.
    """
    table = ca.horzcat(Phi, right)[division.rows.tolist(), :]
    columns = division.dependent.tolist()
    rows = [ca.sparsify(table[i, :]) for i in range(len(columns))]
    for i, column in enumerate(columns):
        rows[i] = rows[i] / rows[i][column]
        for k in range(len(rows)):
            if k != i and not rows[k][column].is_zero():
                rows[k] = rows[k] - rows[k][column] * rows[i]
    n_q, independent = Phi.size2(), division.independent.tolist()
    Z, a = ca.SX(n_q, len(independent)), ca.SX(n_q, 1)
    for row, column in enumerate(independent):
        Z[column, row] = 1
    for i, column in enumerate(columns):
        for row, coordinate in enumerate(independent):
            Z[column, row] = -rows[i][coordinate]
        a[column] = rows[i][n_q]
    return ca.sparsify(Z), ca.sparsify(a)
