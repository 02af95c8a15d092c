r"""Accelerations of an elastic model, and their integration with its friction.

.. math:: \ddot q = M(q)^{-1} [B u - P \tau_f(P^T \dot q, z) - f(q, \dot q)], \qquad \dot z = \Omega(P^T \dot q, z)

Niglis & Oberg (2015), eqs. (2.10), (2.14). Link side, SI. Under constraints, eq. (2.34),

.. math:: \begin{bmatrix} M & \Phi^T \\ \Phi & 0 \end{bmatrix} \begin{bmatrix} \ddot q \\ \lambda \end{bmatrix} =
          \begin{bmatrix} \tau - f \\ -\dot\Phi \dot q \end{bmatrix}

and motions are projected onto the closed loops. The saddle point is not factorised, since symbols cannot pivot and M is
singular where a rod weighs nothing. The dependent coordinates are eliminated with pivots chosen beforehand, in numbers,
and Z^T M Z, which is positive definite, is factorised: q'' = a_0 + Z y'', exactly the solution of the saddle point.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from operator import add
from typing import TypeVar

import casadi as ca
import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.friction.robot_friction import PlacedLaw
from elastid.friction.static import CURVE, Curve, Expression, Law
from elastid.model.closed_posture import assemble
from elastid.model.drivetrain import on_the_flanks, spring_deflections
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import Partition, motions, partition


@frozen_value(eq=False)
class Contacts:
    """Laws with their places: contact j slides at (P^T v)_j.  P (n_q, n_f).  curves (9 n_f,): see `static.CURVE`."""

    laws: tuple[PlacedLaw, ...]
    P: FloatArray

    @property
    def n_states(self) -> int:
        """Number of states of all laws."""
        return sum(entry.law.n_states for entry in self.laws)

    @property
    def curves(self) -> FloatArray:
        """The numbers (9 n_f,) without load, at the reference temperature."""
        return np.concatenate([np.zeros(0), *(entry.curve() for entry in self.laws)])

    def torque(self, v: ca.SX, z: ca.SX, curves: ca.SX) -> ca.SX:
        """Return P tau_f (n_q,) at velocities v (n_q,), states z (n_states,)."""
        if not self.laws:
            return ca.SX(self.P.shape[0], 1)
        torques = (law.torque(slip, state, curve) for law, slip, state, curve in self._sliding(v, z, curves))
        return ca.DM(self.P) @ ca.vertcat(*torques)

    def advanced(self, v: ca.SX, z: ca.SX, curves: ca.SX, step: Expression) -> ca.SX:
        """Return states after `step` s at constant v (n_q,)."""
        laws = self._sliding(v, z, curves)
        return ca.vertcat(ca.SX(0, 1), *(law.advanced(slip, state, curve, step) for law, slip, state, curve in laws))

    def steady(self, v: FloatArray, curves: FloatArray) -> FloatArray:
        """Return states (n_states,) of friction that has slid at v (n_q,) for long; unbent where it is at rest."""
        steady_s = 1e3  # long compared with the time in which bristles bend
        states = self.advanced(ca.SX(v), ca.SX(self.n_states, 1), ca.SX(curves), steady_s)
        return np.asarray(ca.evalf(states).full()[:, 0])

    def at_rest(self) -> tuple[FloatArray, FloatArray]:
        """Return stiffness and damping (n_q, n_q) of all contacts at rest."""
        at_rest = np.array([entry.at_rest() for entry in self.laws]).reshape(-1, 2)
        stiffness, damping = ((self.P * column) @ self.P.T for column in at_rest.T)
        return stiffness, damping

    def _sliding(self, v: ca.SX, z: ca.SX, curves: ca.SX) -> Iterator[tuple[Law, ca.SX, ca.SX, Curve]]:
        sliding, start = ca.DM(self.P).T @ v, 0
        for j, entry in enumerate(self.laws):
            end = start + entry.law.n_states
            numbers = ca.vertsplit(curves[len(CURVE) * j : len(CURVE) * (j + 1)])
            yield entry.law, sliding[j], z[start:end], entry.symbols(numbers)
            start = end


def contacts(model: ElasticModel, laws: Sequence[PlacedLaw]) -> Contacts:
    """Place laws at coordinates of a model; a motor slides with its shaft, which gears may couple (robot.mixing)."""
    coordinates = np.eye(model.n_q)
    slides = dict(zip(model.inputs, model.robot.mixing @ model.B.T, strict=True))
    slides |= {f"gear {name[2:]}": row for name, row in spring_deflections(model.robot).items()}
    P = [slides[law.place] if law.place in slides else coordinates[model.index(law.place)] for law in laws]
    return Contacts(tuple(laws), np.array(P).reshape(len(laws), model.n_q).T)


Symbol = TypeVar("Symbol", ca.SX, ca.MX)

# |h lambda| of a step; classical ones are stable to 2.785 on the negative real axis and 2.828 on the imaginary one.
MAX_STEP_RATE = 2.5
# Simulations along a log unroll all substeps of a sample in one expression: more take seconds to build.
MAX_SUBSTEPS = 80


@frozen_value
class Tableau:
    """Explicit Runge-Kutta method: a_ij by rows, b_i and the nodes c_i of its stages."""

    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]

    @property
    def nodes(self) -> tuple[float, ...]:
        """c_i = sum of a_ij."""
        return tuple(sum(row) for row in self.rows)

    def amplification(self, z: ComplexArray) -> ComplexArray:
        """Evaluate stability function R(z) (...,): a step h multiplies exp(lambda t) by it, at z = h lambda (...,)."""
        stages = list[ComplexArray]()
        for row in self.rows:
            stages.append(1 + z * sum((a * k for a, k in zip(row, stages, strict=True)), np.zeros_like(z)))
        return 1 + z * sum((b * k for b, k in zip(self.weights, stages, strict=True)), np.zeros_like(z))


CLASSICAL = Tableau(((), (1 / 2,), (0, 1 / 2), (0, 0, 1)), (1 / 6, 1 / 3, 1 / 3, 1 / 6))
# Of fifth order in six stages (Butcher, Journal of the Australian Mathematical Society 4, 1964). An oscillation at
# omega comes out with a relative frequency error of 3.7e-4 (omega h)^6 and a damping ratio more by 1.7e-4 (omega h)^5.
FIFTH_ORDER = Tableau(
    ((), (1 / 4,), (1 / 8, 1 / 8), (0, -1 / 2, 1), (3 / 16, 0, 0, 9 / 16), (-3 / 7, 2 / 7, 12 / 7, -12 / 7, 8 / 7)),
    (7 / 90, 0, 32 / 90, 12 / 90, 32 / 90, 7 / 90),
)


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


def runge_kutta_step(
    acceleration: Callable[[Symbol, Symbol, Symbol, Symbol], Symbol],
    advanced: Callable[[Symbol, Symbol, float], Symbol],
    q: Symbol,
    v: Symbol,
    z: Symbol,
    u: Sequence[Symbol],
    step: float,
    method: Tableau = CLASSICAL,
) -> tuple[Symbol, Symbol, Symbol]:
    """Build (q, v, z) after one Runge-Kutta step, u the torque at each stage of the method.

    The error of the classical one is of order step^4: an oscillation at omega comes out with a relative frequency error
    of (omega step)^4 / 120 and an added damping ratio of (omega step)^5 / 144.
    acceleration(q, v, z, u).  advanced(z, v, step): z after `step` at constant v. Friction states
    advance with the velocities of q, stage by stage: bristles that stick are integrated as any other spring, and
    bristles that slip, however fast their rate sigma_0 |v| / g, by the exact update, which has no limit of stability.
    """
    velocities, accelerations, states = [v], [acceleration(q, v, z, u[0])], z
    for row, node, torque in zip(method.rows[1:], method.nodes[1:], u[1:], strict=True):
        mean = _weighted_sum(row, velocities) / node
        states = advanced(z, mean, node * step)
        v_i = v + step * _weighted_sum(row, accelerations)
        accelerations.append(acceleration(q + node * step * mean, v_i, states, torque))
        velocities.append(v_i)
    mean = _weighted_sum(method.weights, velocities)
    return q + step * mean, v + step * _weighted_sum(method.weights, accelerations), advanced(z, mean, step)


def _weighted_sum(weights: Sequence[float], values: Sequence[Symbol]) -> Symbol:
    return reduce(add, (weight * value for weight, value in zip(weights, values, strict=True) if weight))


def least_steps(poles: ComplexArray, duration: float) -> int:
    """Find the steps of FIFTH_ORDER in a duration, s, for poles (n,), rad/s: |R(z)| <= max(|exp z|, 1), |z| <= 2.5."""
    n = max(1, math.ceil(np.abs(poles).max() * duration / MAX_STEP_RATE))
    while True:
        z = poles * (duration / n)
        if np.all(np.abs(FIFTH_ORDER.amplification(z)) <= (1 + 1e-9) * np.exp(np.maximum(z.real, 0.0))):
            return int(n)
        n += 1


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
