"""All friction contacts of a robot as one: their torques and states stacked, and the coordinates that they act on."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.friction.law import CURVE, Curve, Expression, Law
from elastid.friction.robot_friction import PlacedLaw
from elastid.model.elastic import ElasticModel

# s: long against the time in which bristles bend.
STEADY_S = 1e3


@frozen_value(eq=False)
class Contacts:
    """Laws with their places: contact j slides at (P^T v)_j.  P (n_q, n_f).  curves (9 n_f,): see `law.CURVE`."""

    laws: tuple[PlacedLaw, ...]
    P: FloatArray

    @property
    def n_states(self) -> int:
        """Number of states of all laws."""
        return sum(self._sizes)

    @property
    def curves(self) -> FloatArray:
        """The numbers (9 n_f,) without load, at the reference temperature."""
        return np.concatenate([np.zeros(0), *(one.curve() for one in self.laws)])

    def torque(self, v: ca.SX, z: ca.SX, curves: ca.SX) -> ca.SX:
        """P tau_f (n_q,) at velocities v (n_q,), states z (n_states,)."""
        if not self.laws:
            return ca.SX(self.P.shape[0], 1)
        each = self._each(v, z, curves)
        return ca.DM(self.P) @ ca.vertcat(*(law.torque(slip, state, curve) for law, slip, state, curve in each))

    def advanced(self, v: ca.SX, z: ca.SX, curves: ca.SX, step: Expression) -> ca.SX:
        """States after `step` s at constant v (n_q,)."""
        each = self._each(v, z, curves)
        return ca.vertcat(ca.SX(0, 1), *(law.advanced(slip, state, curve, step) for law, slip, state, curve in each))

    def steady(self, v: FloatArray, curves: FloatArray) -> FloatArray:
        """States (n_states,) of friction that has slid at v (n_q,) for long; unbent where it is at rest."""
        return np.asarray(
            ca.evalf(self.advanced(ca.SX(v), ca.SX(self.n_states, 1), ca.SX(curves), STEADY_S)).full()[:, 0]
        )

    def at_rest(self) -> tuple[FloatArray, FloatArray]:
        """Stiffness and damping (n_q, n_q) of all contacts at rest."""
        found = np.array([one.at_rest() for one in self.laws]).reshape(-1, 2)
        stiffness, damping = ((self.P * column) @ self.P.T for column in found.T)
        return stiffness, damping

    @property
    def _sizes(self) -> list[int]:
        return [one.law.n_states for one in self.laws]

    def _each(self, v: ca.SX, z: ca.SX, curves: ca.SX) -> list[tuple[Law, ca.SX, ca.SX, Curve]]:
        sliding = ca.DM(self.P).T @ v
        ends = np.cumsum([0, *self._sizes])
        numbers = [
            one.symbols(ca.vertsplit(curves[len(CURVE) * j : len(CURVE) * (j + 1)])) for j, one in enumerate(self.laws)
        ]
        return [
            (one.law, sliding[j], z[int(ends[j]) : int(ends[j + 1])], numbers[j]) for j, one in enumerate(self.laws)
        ]


def contacts(model: ElasticModel, laws: Sequence[PlacedLaw]) -> Contacts:
    """The laws at the coordinates of a model; a motor slides with its shaft, which gears may couple (robot.mixing)."""
    coordinates = np.eye(model.n_q)
    slides = dict(zip(model.inputs, model.robot.mixing @ model.B.T, strict=True))
    P = [slides[one.place] if one.place in slides else coordinates[model.index(one.place)] for one in laws]
    return Contacts(tuple(laws), np.array(P).reshape(len(laws), model.n_q).T)
