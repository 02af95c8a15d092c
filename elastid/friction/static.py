r"""Static friction laws over velocity, load and temperature, and the terms that they are sums of.

.. math:: \tau_f = F_c \tanh(v / v_s)

Coulomb's F_c sgn(v), smoothed over v_s: eq. (2.15) of Niglis & Oberg (2015) as v_s -> 0. The sign is that of the
velocity, and the torque stands on the side of M q'' + f + tau_f = B u: friction brakes. Viscous friction is not here;
it is linear and part of the model's force f. Tustin's law, eq. (2.17), has the Stribeck curve g(v) instead of F_c
and may grow with v |v|.

As a sum of columns, linear in most of its numbers:

.. math::
   s \tau_f = F_c + \delta_c s + F_{cl} L + F_{sl} L\, e(v / \nu_l)
       + (D_s + D_{sT} \theta)\, e(v / (\nu_s + \nu_T \theta))
       + (\alpha + \delta_v s) v + \alpha_T (e^{-\theta / T_V} - 1) v + \alpha_3 v^2, \quad e(x) = e^{-|x|^a}

with s the direction, v = |v|, L the load and theta = T - T_0 (Bittencourt, Wernholt, Sander-Tavallaey and Brogardh,
LiTH-ISY-R-2948, IROS 2010, with its temperatures about T_0). Numbers are named as in a robot's file; `excess` is D_s
and `load.excess` F_sl, the excess of stiction over Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
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


# Numbers of the law by their path in `robot.friction.Friction`: those that tau_f is linear in, and the others.
LINEAR = (
    *("coulomb", "excess", "viscous", "quadratic", "load.coulomb", "load.excess"),
    *("temperature.stiction", "temperature.viscous", "directions.coulomb", "directions.viscous"),
)
NONLINEAR = (
    *("stribeck_velocity", "temperature.stribeck_velocity", "exponent", "load.stribeck_velocity"),
    "temperature.decay",
)


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


def columns(conditions: Conditions, names: tuple[str, ...], eta: Mapping[str, float], T_0: float) -> FloatArray:
    """Phi (n, len(names)): the derivative of s tau_f by each linear number, at the nonlinear ones eta."""
    terms = _columns(conditions, eta, T_0)
    return np.stack([terms[name] for name in names], axis=1)


def slopes(
    conditions: Conditions, linear: Mapping[str, float], names: tuple[str, ...], eta: Mapping[str, float], T_0: float
) -> FloatArray:
    """The derivative (n, len(names)) of s tau_f by each nonlinear number of `names`, at linear and eta."""
    v, L, theta = conditions.speed, conditions.load, _theta(conditions, T_0)
    load_excess = linear.get("load.excess", 0.0) * L
    slopes: dict[str, FloatArray] = {"exponent": np.zeros_like(v)}
    if "stribeck_velocity" in eta:
        falling = linear.get("excess", 0.0) + linear.get("temperature.stiction", 0.0) * theta
        if "load.stribeck_velocity" in eta:
            by_nu_l, by_a = _fall(v, np.full_like(v, eta["load.stribeck_velocity"]), eta["exponent"])
            slopes |= {"load.stribeck_velocity": load_excess * by_nu_l, "exponent": load_excess * by_a}
        else:
            falling = falling + load_excess
        by_nu, by_a = _fall(v, _nu(eta, theta), eta["exponent"])
        slopes["stribeck_velocity"] = falling * by_nu
        slopes["temperature.stribeck_velocity"] = falling * by_nu * theta
        slopes["exponent"] = slopes["exponent"] + falling * by_a
    if "temperature.decay" in eta:
        T_V = eta["temperature.decay"]
        slopes["temperature.decay"] = linear.get("temperature.viscous", 0.0) * v * np.exp(-theta / T_V) * theta / T_V**2
    return np.stack([slopes[name] for name in names], axis=1) if names else np.zeros((len(v), 0))


def _fall(v: FloatArray, nu: FloatArray, a: float) -> tuple[FloatArray, FloatArray]:
    """The derivatives of exp(-(v / nu)^a) by nu and by a."""
    power = (v / nu) ** a
    e = np.exp(-power)
    return e * power * a / nu, -e * power * np.log(v / nu)


def _columns(conditions: Conditions, eta: Mapping[str, float], T_0: float) -> dict[str, FloatArray]:
    v, s, L, theta = conditions.speed, conditions.direction, conditions.load, _theta(conditions, T_0)
    terms = {
        "coulomb": np.ones_like(v),
        "viscous": v,
        "quadratic": v**2,
        "load.coulomb": L,
        "directions.coulomb": s,
        "directions.viscous": s * v,
    }
    if "stribeck_velocity" in eta:
        e = np.exp(-((v / _nu(eta, theta)) ** eta["exponent"]))
        terms |= {"excess": e, "temperature.stiction": theta * e, "load.excess": L * e}
    if "load.stribeck_velocity" in eta:
        terms["load.excess"] = L * np.exp(-((v / eta["load.stribeck_velocity"]) ** eta["exponent"]))
    if "temperature.decay" in eta:
        terms["temperature.viscous"] = v * np.expm1(-theta / eta["temperature.decay"])
    return terms


def _nu(eta: Mapping[str, float], theta: FloatArray) -> FloatArray:
    """The Stribeck velocity (n,) at every temperature; far beyond the data it is kept from vanishing."""
    nu_s = eta.get("stribeck_velocity", np.inf)
    return np.maximum(nu_s + eta.get("temperature.stribeck_velocity", 0.0) * theta, 1e-3 * nu_s)


def _theta(conditions: Conditions, T_0: float) -> FloatArray:
    """T - T_0 (n,), 0 where no temperature is known."""
    return np.nan_to_num(conditions.temperature - T_0, nan=0.0)
