r"""The joint that a filter follows, and one sample of its states.

.. math:: J_m \ddot q_m + f \dot q_m + \tau_f(\dot q_m, z) + k (q_m - q_l) + d (\dot q_m - \dot q_l) = u + w, \qquad
          J_l \ddot q_l + g + b = k (q_m - q_l) + d (\dot q_m - \dot q_l)

on one side of the gear: LuGre's bristles z, the torque g of gravity as a model has it, its slow error b, and w, noise
of the torque that is correlated in time. Without a spring both inertias move as one. What is followed are constants
that drift: ln F_c, with F_s / F_c and sigma_0 held; ln f, or one of each direction; b.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from elastid.friction.dynamic import Bristle
from elastid.friction.law import Curve
from elastid.observer.spec import Followed
from elastid.simulation.dynamics import runge_kutta_step


@dataclass(frozen=True)
class FollowedJoint:
    """Inertias, spring and damper, and the friction from which a filter starts; all on one side of the gear, SI.

    link_inertia, stiffness, damping: 0 for a joint that is rigid, with all of its inertia in motor_inertia.
    stiction_ratio: F_s / F_c.  bristle_stiffness, bristle_damping: sigma_0, sigma_1.  followed: what changes.
    correlation_s: time constant of the torque noise w, 0 for none.
    """

    motor_inertia: float
    coulomb: float
    viscous: float
    bristle_stiffness: float
    followed: tuple[Followed, ...] = ("Fc", "f", "offset")
    link_inertia: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    stiction_ratio: float = 1.0
    stribeck_velocity: float = 0.0
    bristle_damping: float = 0.0
    correlation_s: float = 0.0

    def __post_init__(self) -> None:
        """Refuse half an elastic joint, and viscous friction followed twice."""
        if (self.stiffness > 0) != (self.link_inertia > 0):
            raise ValueError("a joint with a spring has inertias on both of its sides; give both, or neither")
        if "f" in self.followed and {"f+", "f-"} & set(self.followed):
            raise ValueError("viscous friction is followed as one number (f) or one a direction (f+, f-), not both")
        if self.stiction_ratio > 1 and self.stribeck_velocity <= 0:
            raise ValueError("stiction above Coulomb friction needs stribeck_velocity, over which it falls")

    @property
    def is_elastic(self) -> bool:
        """Whether motor and link move apart."""
        return self.stiffness > 0

    @property
    def states(self) -> tuple[str, ...]:
        """The names of the states x, in order: angles, velocities, bristle, correlated noise, what is followed."""
        mechanical = ("q_m", "q_l", "v_m", "v_l", "z") if self.is_elastic else ("q_m", "v_m", "z")
        return (*mechanical, *(("w",) if self.correlation_s > 0 else ()), *self.followed)

    def start_of(self, name: Followed) -> float:
        """The number from which a followed one starts, not its logarithm."""
        return {"Fc": self.coulomb, "offset": 0.0}.get(name, self.viscous)

    def step(self, rate_hz: float) -> ca.Function:
        """(x (n,), u, g) -> x (n,) one sample later; torque held, the noise w its mean.

        One Runge-Kutta step, the bristle by its exact update.
        """
        names = self.states
        x, u, g = ca.SX.sym("x", len(names)), ca.SX.sym("u"), ca.SX.sym("g")
        at = dict(zip(names, ca.vertsplit(x), strict=True))
        n_q = 2 if self.is_elastic else 1
        curve = self._curve(at)
        law = Bristle(self.bristle_stiffness, self.bristle_damping)
        noise = at.get("w", 0.0)

        def acceleration(q: ca.SX, v: ca.SX, z: ca.SX, torque: ca.SX) -> ca.SX:
            motor = torque + noise - law.torque(v[0], z, curve) - self._viscous(at, v[0])
            load = g + at.get("offset", 0.0)
            if not self.is_elastic:
                return (motor - load) / self.motor_inertia
            spring = self.stiffness * (q[0] - q[1]) + self.damping * (v[0] - v[1])
            return ca.vertcat((motor - spring) / self.motor_inertia, (spring - load) / self.link_inertia)

        def advanced(z: ca.SX, v: ca.SX, step: float) -> ca.SX:
            return law.advanced(v[0], z, curve, step)

        q, v, z = runge_kutta_step(acceleration, advanced, x[:n_q], x[n_q : 2 * n_q], at["z"], [u, u, u], 1 / rate_hz)
        faded = [at["w"] * math.exp(-1 / (rate_hz * self.correlation_s))] if "w" in at else []
        following = ca.vertcat(q, v, z, *faded, *(at[name] for name in self.followed))
        return ca.Function("step", [x, u, g], [following], ["x", "u", "g"], ["next"])

    def _curve(self, at: dict[str, ca.SX]) -> Curve:
        """Sliding friction at the F_c that is followed."""
        coulomb = ca.exp(at["Fc"]) if "Fc" in at else self.coulomb
        inverse = 1 / self.stribeck_velocity if self.stribeck_velocity > 0 else 0.0
        return Curve(coulomb, self.stiction_ratio * coulomb, inverse)

    def _viscous(self, at: dict[str, ca.SX], v: ca.SX) -> ca.SX:
        """f v, or f+ and f- of the two directions."""
        if "f" in at:
            return ca.exp(at["f"]) * v
        forwards, backwards = (ca.exp(at[name]) if name in at else self.viscous for name in ("f+", "f-"))
        return forwards * ca.fmax(v, 0) + backwards * ca.fmin(v, 0)
