r"""Static friction: a torque that depends on the sliding velocity alone.

.. math:: \tau_f = F_c \tanh(v / v_s)

Coulomb's F_c sgn(v), smoothed over v_s: eq. (2.15) of Niglis & Oberg (2015) as v_s -> 0. The sign is that of the
velocity, and the torque stands on the side of M q'' + f + tau_f = B u: friction brakes. Viscous friction is not here;
it is linear and part of the model's force f. Tustin's law, eq. (2.17), has the Stribeck curve g(v) in the place of F_c
and may grow with v |v|.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from elastid.friction.law import Curve, Expression

# v_s in rad/s on the link side. Well below the speed at which a multisine moves a joint (0.01 to 1 rad/s), so that the
# torque is F_c nearly all the time; not smaller, since the slope F_c / v_s is a rate that the integrator must resolve:
# 50 Nm on a motor of 20 kg m^2 give 2500 1/s, which RK4 still integrates at 1 kHz.
SLIDING_VELOCITY = 1e-3


@dataclass(frozen=True)
class Tustin:
    """tau_f = g(v) tanh(v / v_s) + alpha_3 v |v|: Coulomb's law where F_s = F_c."""

    v_s: float = SLIDING_VELOCITY

    @property
    def n_states(self) -> int:
        """None: the torque depends on v alone."""
        return 0

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """tau_f(v)."""
        return curve.level(v) * ca.tanh(v / self.v_s) + curve.growing(v)

    def rate(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Empty: there is no state."""
        return ca.SX(0, 1)

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """Empty: there is no state."""
        return ca.SX(0, 1)

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """The slope of tanh."""
        return 0.0, F_s / self.v_s
