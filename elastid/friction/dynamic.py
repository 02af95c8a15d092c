r"""Dynamic friction: bristles that bend before they slide.

.. math::
   \text{Dahl, LuGre:} &\quad \dot z = v - \frac{\sigma_0 |v|}{g(v)} z, \qquad
        \tau_f = \sigma_0 z + \sigma_1(v)\, \dot z \\
   \text{generalised Maxwell slip:} &\quad \dot z_i = v \text{ (sticks)}, \quad
        \dot z_i = C_i (\mathrm{sgn}(v) - z_i / \bar z_i) \text{ (slips)}, \qquad
        \tau_f = \sum_i \sigma_{0i} z_i + \sigma_{1i} \dot z_i

with zbar_i = nu_i g(v) / sigma_0i > 0 and C_i = C nu_i / sigma_0i; Niglis & Oberg (2015), eqs. (2.16), (2.18) to
(2.21), with their signs. The sign of the velocity stands before the 1 and not before the bracket: sgn(v) (1 - z / zbar)
runs away for v < 0. |v| and sgn(v) are not smoothed: a smoothed |v| lets the bristles of a joint at rest relax, so that
it creeps under load; at v = 0 both have the derivative 0, which is that of the equilibrium branch (a spring sigma_0).
"""

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from elastid.friction.static import Curve, Expression, exponential_step, is_absent


@dataclass(frozen=True)
class Bristle:
    """LuGre, sigma_1(v) = sigma_1 exp(-(v / v_d)^2); Dahl without sigma_1 and F_s. inverse_v_d: 0 for a constant.

    Each a number, or an expression where it is to be identified.
    """

    sigma_0: Expression
    sigma_1: Expression = 0.0
    inverse_v_d: Expression = 0.0
    n_states: ClassVar[int] = 1  # the mean deflection z of the bristles, rad

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return sigma_0 z + sigma_1(v) dz/dt, and the parts that grow with v."""
        torque = self.sigma_0 * z + curve.growing(v)
        if not is_absent(self.sigma_1):
            is_constant = is_absent(self.inverse_v_d)
            damping = self.sigma_1 if is_constant else self.sigma_1 * ca.exp(-((v * self.inverse_v_d) ** 2))
            torque += damping * self.rate(v, z, curve)
        return torque

    def rate(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return v - sigma_0 |v| z / g(v)."""
        return v - self.sigma_0 * ca.fabs(v) * z / curve.torque(v)

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """Return z e^-a + v step phi_1(-a), a = sigma_0 |v| step / g: exact at constant v, |z| <= F_s / sigma_0."""
        return exponential_step(z, v, self.sigma_0 * ca.fabs(v) / curve.torque(v), step)

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """Return stiffness and damping to ground at rest, sigma_0 and sigma_1, of numeric parameters."""
        return float(self.sigma_0), float(self.sigma_1)


@dataclass(frozen=True)
class Stop:
    """A spring sigma_0 that slides at F_c: the stop operator, one Prandtl element, sharp where `Bristle` is round."""

    sigma_0: float
    n_states: ClassVar[int] = 1  # its deflection z, rad

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return sigma_0 z."""
        return self.sigma_0 * z

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """Return z + v step, at most F_c / sigma_0: exact at constant v."""
        limit = curve.torque(v) / self.sigma_0
        return ca.fmax(-limit, ca.fmin(limit, z + v * step))

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """Return stiffness and damping to ground at rest: sigma_0 and none."""
        return self.sigma_0, 0.0


@dataclass(frozen=True)
class MaxwellElements:
    """Sticking until z_i sgn(v) reaches zbar_i, then slipping until v changes its sign.

    sigma_0, nu, sigma_1 (n,); C: attraction, Nm/s.
    States: z_i, then for each element the direction in which it slips, 0 where it sticks.
    """

    sigma_0: tuple[float, ...]
    nu: tuple[float, ...]
    sigma_1: tuple[float, ...]
    C: float

    @property
    def n_states(self) -> int:
        """Two an element."""
        return 2 * len(self.nu)

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return sum sigma_0i z_i + sigma_1i dz_i/dt, and the parts that grow with v."""
        n = len(self.nu)
        damping = ca.dot(ca.DM(self.sigma_1), self.rate(v, z, curve)[:n])
        return ca.dot(ca.DM(self.sigma_0), z[:n]) + damping + curve.growing(v)

    def rate(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return dz_i/dt of the deflections, zeros for the directions: they jump."""
        deflection, slips, limit, sign, slope = self._slipping(v, z, curve)
        return ca.vertcat(ca.if_else(slips, slope * (limit * sign - deflection), v), ca.SX.zeros(len(self.nu)))

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """Return the exact state if an element slips or sticks all the time; one that reaches its bound stays there."""
        deflection, slips, limit, sign, slope = self._slipping(v, z, curve)
        slid = exponential_step(deflection, slope * limit * sign, slope, step)
        trial = deflection + v * step
        arrives = sign * trial >= limit
        stuck = ca.if_else(arrives, sign * limit, trial)
        direction = ca.if_else(ca.logic_or(slips, arrives), sign, 0.0)
        return ca.vertcat(ca.if_else(slips, slid, stuck), ca.if_else(sign == 0, z[len(self.nu) :], direction))

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """Return stiffness and damping to ground at rest, where all elements stick."""
        return sum(self.sigma_0), sum(self.sigma_1)

    def _slipping(self, v: Expression, z: ca.SX, curve: Curve) -> tuple[ca.SX, ...]:
        """Return deflections, true where they slip at v, their bounds zbar > 0, sgn(v), C / g(v)."""
        n = len(self.nu)
        deflection, direction, sign = z[:n], z[n:], ca.sign(v)
        torque = curve.torque(v)
        limit = ca.DM(np.divide(self.nu, self.sigma_0)) * torque
        is_sliding = ca.logic_and(sign != 0, sign * deflection >= limit)
        slips = ca.logic_or(ca.logic_and(direction != 0, direction == sign), is_sliding)
        return deflection, slips, limit, sign, self.C / torque
