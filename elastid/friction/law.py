r"""The contract of a friction law, and the curve of sliding friction that all laws share.

.. math:: \tau_f = h(v, z), \qquad \dot z = \Omega(v, z), \qquad
          g(v) = F_c + \delta_c\, \mathrm{sgn}\, v + (F_s - F_c) e^{-|v / \nu_s|^a} + F_l e^{-|v / \nu_l|^a}

A positive torque brakes a positive velocity: it stands on the side of M q'' + f + tau_f = B u. Viscous friction is not
here; it is linear and part of the model's force f. Sources: Niglis & Oberg (2015), eqs. (2.14) to (2.21).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import casadi as ca

Expression: TypeAlias = ca.SX | float

# Numbers of a Curve, which an experiment may change from sample to sample: load, temperature.
CURVE = ("F_c", "F_s", "inverse_nu_s", "alpha_3", "alpha_T", "F_l", "inverse_nu_l", "delta_c", "delta_v")


@dataclass(frozen=True)
class Curve:
    """F_c, F_s (Nm), 1 / nu_s (s/rad; 0 without Stribeck effect), alpha_3 of v |v|, alpha_T added to viscous friction.

    F_l (Nm), 1 / nu_l: what the load adds over a Stribeck velocity of its own.  delta_c (Nm), delta_v (Nms/rad): half
    of what F_c and viscous friction are larger at v > 0 than at v < 0.  All on the side of v, each an expression or a
    number; a part whose number is 0.0 is left out of the expressions.  exponent: a.
    """

    F_c: Expression
    F_s: Expression
    inverse_nu_s: Expression
    alpha_3: Expression = 0.0
    alpha_T: Expression = 0.0
    F_l: Expression = 0.0
    inverse_nu_l: Expression = 0.0
    delta_c: Expression = 0.0
    delta_v: Expression = 0.0
    exponent: float = 2.0

    def level(self, v: Expression) -> ca.SX:
        """g(v), Nm: torque of steady sliding at v, without the parts that grow with v."""
        level = self.F_c + (self.F_s - self.F_c) * self._falling(v * self.inverse_nu_s)
        if not is_absent(self.F_l):
            level += self.F_l * self._falling(v * self.inverse_nu_l)
        return level if is_absent(self.delta_c) else level + self.delta_c * ca.sign(v)

    def growing(self, v: Expression) -> ca.SX:
        """alpha_3 v |v| + alpha_T v + delta_v |v|, Nm."""
        growing = v * (self.alpha_3 * ca.fabs(v) + self.alpha_T)
        return growing if is_absent(self.delta_v) else growing + self.delta_v * ca.fabs(v)

    def _falling(self, x: Expression) -> ca.SX:
        """exp(-|x|^a)."""
        # 1e-12 keeps the derivative of an exponent other than 2 finite at rest.
        return ca.exp(-(x**2)) if self.exponent == 2 else ca.exp(-((x**2 + 1e-12) ** (self.exponent / 2)))


def is_absent(number: Expression) -> bool:
    """True if a number is 0 for good, and no symbol."""
    return isinstance(number, float) and number == 0


class Law(Protocol):
    """A friction law at one place, states z (n_states,); v in rad/s, torque in Nm on one side."""

    @property
    def n_states(self) -> int:
        """Number of states; 0 where the torque depends on v alone."""

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """tau_f(v, z)."""

    def rate(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """dz/dt (n_states,)."""

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """z after `step` s at constant v: exactly, or never out of the law's bounds, however long the step."""

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """d tau / d (displacement) and d tau / d v at rest, Nm/rad and Nms/rad: a bound on its rates."""


def exponential_step(z: Expression, rate: Expression, slope: Expression, step: Expression) -> ca.SX:
    """Solution of z' = rate - slope z after `step`, both constant: z e^-x + rate step phi_1(-x), x = slope step."""
    x = slope * step
    return z * ca.exp(-x) + rate * step * phi_1(x)


def phi_1(x: Expression) -> ca.SX:
    """(1 - e^-x) / x of x >= 0, by its series where x is small; correct at 0 up to the third derivative."""
    small = x < 1e-3
    divisor = ca.if_else(small, 1.0, x)
    return ca.if_else(small, 1 - x / 2 * (1 - x / 3 * (1 - x / 4)), -ca.expm1(-divisor) / divisor)
