r"""The contract of a friction law, the curve of sliding friction that all laws share, and static laws.

.. math:: \tau_f = h(v, z), \qquad \dot z = \Omega(v, z), \qquad
          g(v) = F_c + \delta_c\, \mathrm{sgn}\, v + (F_s - F_c) e^{-|v / \nu_s|^a} + F_l e^{-|v / \nu_l|^a}

A positive torque brakes a positive velocity: it stands on the side of M q'' + f + tau_f = B u. Viscous friction is not
here; it is linear and part of the model's force f. Sources: Niglis & Oberg (2015), eqs. (2.14) to (2.21).

Coulomb's F_c sgn(v), eq. (2.15), is smoothed to F_c tanh(v / v_s). Tustin's law, eq. (2.17), has the Stribeck curve
g(v) instead of F_c and may grow with v |v|. As a sum of columns, linear in most of its numbers:

.. math::
   s \tau_f = F_c + \delta_c s + F_{cl} L + F_{sl} L\, e(v / \nu_l)
       + F_{cT} \theta + (D_s + D_{sT} \theta)\, e(v / (\nu_s + \nu_T \theta))
       + (\alpha + \delta_v s) v + \alpha_T (e^{-\theta / T_V} - 1) v + \alpha_3 v^2, \quad e(x) = e^{-|x|^a}

with s the direction, v = |v|, L the load and theta = T - T_0 (Bittencourt, Wernholt, Sander-Tavallaey and Brogardh,
LiTH-ISY-R-2948, IROS 2010, with its temperatures about T_0). Numbers are named as in a robot's file, in which stiction
is F_c + D_s, and that by load F_cl + F_sl.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value

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

    def torque(self, v: Expression) -> ca.SX:
        """Return g(v), Nm: torque of steady sliding at v, without the parts that grow with v."""
        torque = self.F_c + (self.F_s - self.F_c) * self._falling(v * self.inverse_nu_s)
        if not is_absent(self.F_l):
            torque += self.F_l * self._falling(v * self.inverse_nu_l)
        return torque if is_absent(self.delta_c) else torque + self.delta_c * ca.sign(v)

    def growing(self, v: Expression) -> ca.SX:
        """Return alpha_3 v |v| + alpha_T v + delta_v |v|, Nm."""
        growing = v * (self.alpha_3 * ca.fabs(v) + self.alpha_T)
        return growing if is_absent(self.delta_v) else growing + self.delta_v * ca.fabs(v)

    def _falling(self, x: Expression) -> ca.SX:
        """Return exp(-|x|^a)."""
        # 1e-12 keeps the derivative of an exponent other than 2 finite at rest.
        return ca.exp(-(x**2)) if self.exponent == 2 else ca.exp(-((x**2 + 1e-12) ** (self.exponent / 2)))


def is_absent(number: Expression) -> bool:
    """Return True if a number is 0 for good, and no symbol."""
    return isinstance(number, float) and number == 0


class Law(Protocol):
    """A friction law at one place, states z (n_states,); v in rad/s, torque in Nm on one side."""

    @property
    def n_states(self) -> int:
        """Number of states; 0 where the torque depends on v alone."""

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return tau_f(v, z)."""

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """Return z after `step` s at constant v: exactly, or never out of the law's bounds, however long the step."""

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """Return d tau / d (displacement) and d tau / d v at rest, Nm/rad and Nms/rad: a bound on its rates."""


def exponential_step(z: Expression, rate: Expression, slope: Expression, step: Expression) -> ca.SX:
    """Solve z' = rate - slope z over `step`, both constant: z e^-x + rate step phi_1(-x), x = slope step."""
    x = slope * step
    return z * ca.exp(-x) + rate * step * phi_1(x)


def phi_1(x: Expression) -> ca.SX:
    """Return (1 - e^-x) / x of x >= 0, by its series where x is small; correct at 0 up to the third derivative."""
    small = x < 1e-3
    divisor = ca.if_else(small, 1.0, x)
    return ca.if_else(small, 1 - x / 2 * (1 - x / 3 * (1 - x / 4)), -ca.expm1(-divisor) / divisor)


# v_s in rad/s on the link side. Well below the speed at which a multisine moves a joint (0.01 to 1 rad/s), so that the
# torque is F_c nearly all the time; not smaller, since the slope F_c / v_s is a rate that the integrator must resolve:
# 50 Nm on a motor of 20 kg m^2 give 2500 1/s, which RK4 still integrates at 1 kHz.
SLIDING_VELOCITY = 1e-3


@dataclass(frozen=True)
class Tustin:
    """tau_f = g(v) tanh(v / v_s) + alpha_3 v |v|: Coulomb's law where F_s = F_c."""

    v_s: float = SLIDING_VELOCITY
    n_states: ClassVar[int] = 0  # the torque depends on v alone

    def torque(self, v: Expression, z: ca.SX, curve: Curve) -> ca.SX:
        """Return tau_f(v)."""
        return curve.torque(v) * ca.tanh(v / self.v_s) + curve.growing(v)

    def advanced(self, v: Expression, z: ca.SX, curve: Curve, step: Expression) -> ca.SX:
        """Return empty: there is no state."""
        return ca.SX(0, 1)

    def at_rest(self, F_c: float, F_s: float) -> tuple[float, float]:
        """Return the slope of tanh."""
        return 0.0, F_s / self.v_s


# Numbers of the law by their path in `robot.friction.Friction`: those that tau_f is linear in, and the others.
LINEAR = (
    *("coulomb", "stiction", "viscous", "quadratic", "load.coulomb", "load.stiction"),
    *("temperature.coulomb", "temperature.stiction", "temperature.viscous"),
    *("directions.coulomb", "directions.viscous"),
)


# Stiction falls to Coulomb friction.
FALLING = {"stiction": "coulomb", "load.stiction": "load.coulomb"}


@frozen_value
class Conditions:
    """n conditions of steady sliding, each an array (n,).

    speed: positive.  direction: 1, -1, or 0 for the mean of both.  load: 0 or more.  temperature: degC, NaN where it is
    not known.
    """

    speed: FloatArray
    direction: FloatArray
    load: FloatArray
    temperature: FloatArray


def columns(conditions: Conditions, names: tuple[str, ...], eta: Mapping[str, Any], T_0: float) -> FloatArray:
    """Return Phi (n, len(names)): the derivative of s tau_f by each linear number, at the nonlinear ones eta."""
    v, s, L, theta = conditions.speed, conditions.direction, conditions.load, _theta(conditions, T_0)
    terms = {
        "coulomb": np.ones_like(v), "viscous": v, "quadratic": v**2, "load.coulomb": L, "temperature.coulomb": theta,
        "directions.coulomb": s, "directions.viscous": s * v,
    }  # fmt: skip
    if "stribeck_velocity" in eta:
        e = np.exp(-((v / _nu(eta, theta)) ** eta["exponent"]))
        terms |= {"stiction": e, "temperature.stiction": theta * e, "load.stiction": L * e}
    if "load.stribeck_velocity" in eta:
        terms["load.stiction"] = L * np.exp(-((v / eta["load.stribeck_velocity"]) ** eta["exponent"]))
    if "temperature.decay" in eta:
        terms["temperature.viscous"] = v * np.expm1(-theta / eta["temperature.decay"])
    for stiction, coulomb in FALLING.items():
        if stiction in names:
            terms[coulomb] = terms[coulomb] - terms[stiction]
    return np.stack([terms[name] for name in names], axis=1)


def slopes(
    conditions: Conditions, linear: Mapping[str, float], names: tuple[str, ...], eta: Mapping[str, float], T_0: float
) -> FloatArray:
    """Return the derivative (n, len(names)) of s tau_f by each nonlinear number of `names`, at linear and eta.

    By complex steps, exact to rounding (Squire and Trapp, SIAM Review 40, 1998).  linear: others are ignored.
    """
    linear_terms, step = {name: value for name, value in linear.items() if name in LINEAR}, 1e-100
    steps = ({**eta, name: eta.get(name, 0.0) + 1j * step} for name in names)
    torques = [columns(conditions, tuple(linear_terms), at, T_0) @ [*linear_terms.values()] for at in steps]
    return np.reshape([torque.imag / step for torque in torques], (len(names), len(conditions.speed))).T


def _nu(eta: Mapping[str, Any], theta: FloatArray) -> FloatArray:
    """Return the Stribeck velocity (n,) at every temperature; far beyond the data it is kept from vanishing."""
    nu_s = eta.get("stribeck_velocity", np.inf)
    return np.asarray(np.maximum(nu_s + eta.get("temperature.stribeck_velocity", 0.0) * theta, 1e-3 * nu_s))


def _theta(conditions: Conditions, T_0: float) -> FloatArray:
    """Return T - T_0 (n,), 0 where no temperature is known."""
    return np.nan_to_num(conditions.temperature - T_0, nan=0.0)
