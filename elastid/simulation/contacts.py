"""Friction of a robot at its contacts: a joint, a motor shaft or a gear, each with a friction law of its own."""

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.friction.robot_friction import PlacedLaw
from elastid.friction.static import CURVE, Curve, Expression, Law
from elastid.model.drivetrain import spring_deflections
from elastid.model.elastic import ElasticModel


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
