r"""Accelerations of an elastic model, and their integration together with the stacked states of its friction.

.. math:: \ddot q = M(q)^{-1} [B u - P \tau_f(P^T \dot q, z) - f(q, \dot q)], \qquad \dot z = \Omega(P^T \dot q, z)

Niglis & Oberg (2015), eqs. (2.10), (2.14); with constraints: `baumgarte`. Link side, SI.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.friction.robot_friction import PlacedLaw
from elastid.friction.static import CURVE, Curve, Expression, Law
from elastid.model.drivetrain import on_the_flanks, spring_deflections
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import motions
from elastid.simulation.baumgarte import constrained_acceleration


@frozen_value(eq=False)
class Contacts:
    """Laws with their places: contact j slides at (P^T v)_j.  P (n_q, n_f).  curves (9 n_f,): see `law.CURVE`."""

    laws: tuple[PlacedLaw, ...]
    P: FloatArray

    @property
    def n_states(self) -> int:
        """Number of states of all laws."""
        return sum(placed.law.n_states for placed in self.laws)

    @property
    def curves(self) -> FloatArray:
        """The numbers (9 n_f,) without load, at the reference temperature."""
        return np.concatenate([np.zeros(0), *(placed.curve() for placed in self.laws)])

    def torque(self, v: ca.SX, z: ca.SX, curves: ca.SX) -> ca.SX:
        """P tau_f (n_q,) at velocities v (n_q,), states z (n_states,)."""
        if not self.laws:
            return ca.SX(self.P.shape[0], 1)
        torques = (law.torque(slip, state, curve) for law, slip, state, curve in self._sliding(v, z, curves))
        return ca.DM(self.P) @ ca.vertcat(*torques)

    def advanced(self, v: ca.SX, z: ca.SX, curves: ca.SX, step: Expression) -> ca.SX:
        """States after `step` s at constant v (n_q,)."""
        laws = self._sliding(v, z, curves)
        return ca.vertcat(ca.SX(0, 1), *(law.advanced(slip, state, curve, step) for law, slip, state, curve in laws))

    def steady(self, v: FloatArray, curves: FloatArray) -> FloatArray:
        """States (n_states,) of friction that has slid at v (n_q,) for long; unbent where it is at rest."""
        steady_s = 1e3  # long compared with the time in which bristles bend
        states = self.advanced(ca.SX(v), ca.SX(self.n_states, 1), ca.SX(curves), steady_s)
        return np.asarray(ca.evalf(states).full()[:, 0])

    def at_rest(self) -> tuple[FloatArray, FloatArray]:
        """Stiffness and damping (n_q, n_q) of all contacts at rest."""
        at_rest = np.array([placed.at_rest() for placed in self.laws]).reshape(-1, 2)
        stiffness, damping = ((self.P * column) @ self.P.T for column in at_rest.T)
        return stiffness, damping

    def _sliding(self, v: ca.SX, z: ca.SX, curves: ca.SX) -> Iterator[tuple[Law, ca.SX, ca.SX, Curve]]:
        """Each law with its velocity, states and curve."""
        sliding, start = ca.DM(self.P).T @ v, 0
        for j, placed in enumerate(self.laws):
            end = start + placed.law.n_states
            numbers = ca.vertsplit(curves[len(CURVE) * j : len(CURVE) * (j + 1)])
            yield placed.law, sliding[j], z[start:end], placed.symbols(numbers)
            start = end


def contacts(model: ElasticModel, laws: Sequence[PlacedLaw]) -> Contacts:
    """The laws at the coordinates of a model; a motor slides with its shaft, which gears may couple (robot.mixing)."""
    coordinates = np.eye(model.n_q)
    slides = dict(zip(model.inputs, model.robot.mixing @ model.B.T, strict=True))
    slides |= {f"gear {name[2:]}": row for name, row in spring_deflections(model.robot).items()}
    P = [slides[law.place] if law.place in slides else coordinates[model.index(law.place)] for law in laws]
    return Contacts(tuple(laws), np.array(P).reshape(len(laws), model.n_q).T)


Symbol = TypeVar("Symbol", ca.SX, ca.MX)

# |h lambda| up to which RK4 is used; it is stable to 2.785 on the negative real axis and 2.828 on the imaginary one.
MAX_STEP_RATE = 2.5


def free_acceleration(
    model: ElasticModel, alpha: float = 0.0, beta: float = 0.0, theta: ca.SX | None = None
) -> ca.Function:
    """(q, v, torque) -> q'' of shape (n_q,), for torques (n_q,) on the coordinates.

    alpha, beta: of Baumgarte's terms, where the model has constraints.  theta (n_theta,): symbols, which become a
    fourth argument; the model's own numbers by default.

    M = L D L^T is factorised in symbols with its zeros, without pivots, which a positive definite M does not need. It
    costs nothing for motors without coupling, whose rows of M are diagonal.
    """
    if model.n_c:
        return constrained_acceleration(model, alpha, beta, theta)
    q, v, torque = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q), ca.SX.sym("torque", model.n_q)
    numbers = model.theta if theta is None else theta
    D, LT, order = ca.ldl(ca.sparsify(model.mass(q, numbers)))
    a = ca.ldl_solve(torque - model.force(q, v, numbers), D, LT, order)
    return ca.Function("free_acceleration", [q, v, torque, *([] if theta is None else [theta])], [a], {"cse": True})


def runge_kutta_step(
    acceleration: Callable[[Symbol, Symbol, Symbol, Symbol], Symbol],
    advanced: Callable[[Symbol, Symbol, float], Symbol],
    q: Symbol,
    v: Symbol,
    z: Symbol,
    u: Sequence[Symbol],
    step: float,
) -> tuple[Symbol, Symbol, Symbol]:
    """(q, v, z) after one classical Runge-Kutta step, u the torque at its beginning, middle and end.

    The error is of order step^4. An oscillation at omega comes out with a relative frequency error of
    (omega step)^4 / 120 and an added damping ratio of (omega step)^5 / 144.
    acceleration(q, v, z, u).  advanced(z, v, step): z after `step` at constant v. Friction states
    advance with the velocities of q, stage by stage: bristles that stick are integrated as any other spring, and
    bristles that slip, however fast their rate sigma_0 |v| / g, by the exact update, which has no limit of stability.
    """
    a1 = acceleration(q, v, z, u[0])
    v2 = v + step / 2 * a1
    a2 = acceleration(q + step / 2 * v, v2, advanced(z, v, step / 2), u[1])
    v3 = v + step / 2 * a2
    a3 = acceleration(q + step / 2 * v2, v3, advanced(z, v2, step / 2), u[1])
    v4 = v + step * a3
    a4 = acceleration(q + step * v3, v4, advanced(z, v3, step), u[2])
    mean = (v + 2 * v2 + 2 * v3 + v4) / 6
    return q + step * mean, v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4), advanced(z, mean, step)


def fastest_rate(model: ElasticModel, contacts: Contacts, q: FloatArray) -> float:
    """|lambda| in 1/s of the fastest pole at rest in q (n_q,): the stiffest mode, or friction about zero velocity."""
    return float(pole_rates(model, contacts, q).max())


def pole_rates(model: ElasticModel, contacts: Contacts, q: FloatArray) -> FloatArray:
    """|lambda| (2 n,) in 1/s of the poles at rest in q (n_q,), friction being that about zero velocity.

    Gears with backlash count with the stiffness of their flanks.
    """
    M, D = model.mass(q, model.theta).full(), model.damping(q, model.theta).full()
    K = model.stiffness(q, np.zeros(model.n_c), on_the_flanks(model.parameters, model.theta)).full()
    stiffness, damping = contacts.at_rest()
    Z = motions(model, model.constraint_jacobian(q, model.theta).full())
    M, D, K = (Z.T @ matrix @ Z for matrix in (M, D + damping, K + stiffness))
    A = np.block([[np.zeros_like(M), np.eye(len(M))], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return np.abs(np.linalg.eigvals(A))
