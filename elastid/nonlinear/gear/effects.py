r"""Effects of gears: shapes Phi along the motion, each times a level f, that act at a place of the drivetrain.

.. math:: J \ddot q + f_m \dot q + (F_m + F_{load} |\tau|)\, \mathrm{sgn}\, \dot q + ripple(q) + (1 + e'(q))\, \tau = u,
          \qquad \tau = n(\delta) + d\, \dot\delta + h(\delta), \qquad \delta = q + e(q) - l

q motor and l link side of a joint, e transmission error, n and h spring and hysteresis beyond the linear spring, which
both act across the gear; friction behind the gear brakes the link, -F_l sgn l'. Everything on the link side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.operators import Path, bristle, stop

Kind: TypeAlias = Literal[
    "friction", "load", "behind", "cubic", "progressive", "range", "gap", "edge", "stop", "bristle",
    "error sine", "error cosine", "ripple sine", "ripple cosine",
]  # fmt: skip
Place: TypeAlias = Literal["motor", "gear", "link"]

# Of the level of each kind where it is no torque; N and m where a joint slides.
_UNITS: dict[Kind, str] = {
    "load": "1", "cubic": "N*m/rad^3", "progressive": "N*m/rad^2", "range": "N*m/rad", "gap": "N*m/rad",
    "error sine": "rad", "error cosine": "rad",
}  # fmt: skip


@dataclass(frozen=True)
class GearEffect:
    """One effect at a joint.

    friction, load: at the motor, one level and one for each Nm of the gear's torque; behind: at the link.  cubic,
    progressive: k_3 delta^3 and k_2s |delta| delta.  range: the stiffness beyond a deflection, more than before it.
    gap: the stiffness within one, less than beyond it; lost motion.  edge: of steps at the ends of these, by which
    their scale is found.  stop, bristle: elements of the gear's hysteresis.
    scale: rad/s over which friction turns, rad over which a hysteresis bends or at which a range or a gap ends, order
    of an error or ripple in turns of the motor; 0 of the others.
    """

    kind: Kind
    joint: str
    scale: float = 0.0

    @property
    def is_implicit(self) -> bool:
        """True if it depends on the motion behind the gear, which no sensor sees."""
        return self.kind in ("behind", "cubic", "progressive", "range", "gap", "edge", "stop", "bristle")

    @property
    def edge(self) -> GearEffect | None:
        """The change of a range or a gap with its scale: of level f ds, if the scale is wrong by ds; None of others."""
        return GearEffect("edge", self.joint, self.scale) if self.kind in ("range", "gap") else None

    @property
    def unit(self) -> str:
        """Of its level, link side."""
        return _UNITS.get(self.kind, "N*m")

    @property
    def family(self) -> tuple[str, str, float]:
        """Of a sine and its cosine the same."""
        return self.kind.split()[0], self.joint, self.scale

    @property
    def brakes(self) -> bool:
        """True if its level cannot be negative: it takes energy, or is missing within a gap."""
        return self.kind in ("friction", "load", "behind", "stop", "bristle", "gap")

    @property
    def signal(self) -> Literal["deflection", "link velocity"]:
        """The motion that an implicit effect is a function of."""
        return "link velocity" if self.kind == "behind" else "deflection"


@dataclass(frozen=True)
class GearMotion:
    """Motion of a joint over a period on a fine grid (n,), link side: rad, rad/s, Nm.

    angle: of the motor, as logged.  deflection: with its part at rest and the transmission error.  torque: of the gear,
    with that at rest.  ratio: turns of the motor for one of the joint.  k, d: of the linear spring.
    """

    angle: FloatArray
    velocity: FloatArray
    link_velocity: FloatArray
    deflection: FloatArray
    torque: FloatArray
    ratio: float
    k: float
    d: float


def implicit_law(effect: GearEffect, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Phi and dPhi / dx (n,) of an implicit effect along its signal x (n,), a whole period."""
    if effect.kind == "behind":
        phi = np.tanh(x / effect.scale)
        return phi, (1 - phi**2) / effect.scale
    if effect.kind == "cubic":
        return x**3, 3 * x**2
    if effect.kind == "progressive":
        return np.abs(x) * x, 2 * np.abs(x)
    if effect.kind in ("range", "gap", "edge"):
        return _broken_line(effect.kind, x, effect.scale)
    # The state at the start is not known: the period is run over twice.
    twice = Path.of(np.concatenate([x, x])).without(len(x))
    phi = (stop if effect.kind == "stop" else bristle)(twice, effect.scale) / effect.scale
    return phi, ((np.abs(phi) < 1) if effect.kind == "stop" else 1 - np.abs(phi)) / effect.scale


def _broken_line(kind: Kind, x: FloatArray, b: float) -> tuple[FloatArray, FloatArray]:
    """Phi and dPhi / dx (n,) of what begins or ends at deflections of b."""
    is_beyond = np.abs(x) > b
    if kind == "range":
        return np.sign(x) * np.maximum(np.abs(x) - b, 0.0), is_beyond.astype(float)
    if kind == "gap":
        return -np.clip(x, -b, b), np.where(is_beyond, 0.0, -1.0)
    return -np.sign(x) * is_beyond, np.zeros_like(x)


def periodic_error(effect: GearEffect, motion: GearMotion) -> tuple[FloatArray, FloatArray]:
    """e and de/dq (n,) of unit size."""
    order = effect.scale * motion.ratio
    if effect.kind.endswith("cosine"):
        return np.cos(order * motion.angle), -order * np.sin(order * motion.angle)
    return np.sin(order * motion.angle), order * np.cos(order * motion.angle)


def forces(effect: GearEffect, motion: GearMotion) -> list[tuple[Place, FloatArray]]:
    """Phi (n,) at each place where the effect acts, against the motion there."""
    if effect.is_implicit:
        signal = motion.link_velocity if effect.kind == "behind" else motion.deflection
        return [("link" if effect.kind == "behind" else "gear", implicit_law(effect, signal)[0])]
    if effect.kind == "friction":
        turning = np.tanh(motion.velocity / effect.scale) if effect.scale else np.sign(motion.velocity)
        return [("motor", turning)]
    if effect.kind == "load":
        return [("motor", np.abs(motion.torque) * np.sign(motion.velocity))]
    e, slope = periodic_error(effect, motion)
    if effect.kind.startswith("ripple"):
        return [("motor", e)]
    return [("gear", motion.k * e + motion.d * slope * motion.velocity), ("motor", motion.torque * slope)]
