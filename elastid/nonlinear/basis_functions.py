r"""Basis functions Phi of gear effects along the motion of a joint; each acts at a location, with a magnitude f.

.. math:: J \ddot q + f_m \dot q + (F_m + F_{load} |\tau|)\, \mathrm{sgn}\, \dot q + ripple(q) + (1 + e'(q))\, \tau = u,
          \qquad \tau = n(\delta) + d\, \dot\delta + h(\delta), \qquad \delta = q + e(q) - l

q is the motor angle and l the link angle of a joint, e the transmission error; n is the spring torque and h the
hysteresis. Friction behind the gear brakes the link, -F_l sgn l'. All quantities are link-side values.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.friction.stop_operator import Path, bristle, stop
from elastid.nonlinear.friction_basis import BasisFunction, sliding_means


def sign_of(v: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return tanh(v / scale), or sgn v at scale 0, and its slope (n,), at the points of velocities v (n,) of a period.

    The values have the exact means over the cells between the points: an inertia's velocity depends on them alone.
    """
    means = sliding_means(np.append(v, v[0])[None], [(BasisFunction("", "sign", scale), 1.0)])[0]
    step, phi = np.roll(v, -1) - v, np.tanh(v / scale) if scale else np.sign(v)
    slope = np.divide(np.roll(phi, -1) - phi, step, out=np.zeros_like(v), where=np.abs(step) > 1e-9 * np.abs(v).max())
    return irfft(rfft(means) * _from_means(len(v)), len(v)), (slope + np.roll(slope, 1)) / 2


@lru_cache(maxsize=4)
def _from_means(n: int) -> ComplexArray:
    """Return factor (n // 2 + 1,) from the spectrum of cell means to the spectrum at the first points of the cells."""
    half = np.arange(n // 2 + 1) / n  # half the phase between two points, over pi
    return np.asarray(np.exp(-1j * np.pi * half) / np.sinc(half))


Kind: TypeAlias = Literal[
    "friction", "load", "behind", "cubic", "progressive", "range", "gap", "stop", "bristle",
    "error sine", "error cosine", "ripple sine", "ripple cosine",
]  # fmt: skip
Place: TypeAlias = Literal["motor", "gear", "link"]
SPRINGS: tuple[Kind, ...] = ("cubic", "progressive", "range", "gap")
LOOPS: tuple[Kind, ...] = ("stop", "bristle")


@dataclass(frozen=True)
class SheetNumber:
    """Gearbox characteristic of one or more kinds of effects.  Its name is the prefix and the joint."""

    prefix: str
    meaning: str
    kind: str
    unit: str


STIFFENING = SheetNumber("h_", "hardening: increase of the secant stiffness up to the largest torque", "share", "1")
LOST_MOTION = SheetNumber("lost_", "lost motion", "angle", "rad")
HYSTERESIS = SheetNumber("H_", "hysteresis, half the torque difference of the loop", "torque", "N*m")
ERROR = SheetNumber("e", "transmission error", "error", "rad")
RIPPLE = SheetNumber("r", "torque ripple and cogging", "torque", "N*m")


@dataclass(frozen=True)
class EffectKind:
    """Common properties of all effects of a kind.

    place: location of the effect and of its motion; at a gear, the deflection.  number: its gearbox characteristic.
    scales: candidates over the rms velocity of the motor or deflection of the gear; a law starts at the middle one.
    Empty for effects that have an order and are not implicit.  rivals: kinds of which a joint has one effect only.
    brakes: the magnitude is not negative, because the effect dissipates energy or is the missing stiffness of a gap.
    """

    place: Place
    number: SheetNumber
    scales: tuple[float, ...] = ()
    rivals: tuple[Kind, ...] = ()
    brakes: bool = False


KINDS: dict[Kind, EffectKind] = {
    "friction": EffectKind("motor", SheetNumber("Fc_m", "Coulomb friction before the gear", "torque", "N*m"),
                           (0.01, 0.08), ("friction",), True),
    "load": EffectKind("motor", SheetNumber("Fcl_m", "load-dependent friction, per torque of the gear", "share", "1"),
                       (0.01,), ("load",), True),
    "behind": EffectKind("link", SheetNumber("Fb_", "Coulomb friction behind the gear", "torque", "N*m"),
                         (0.01,), ("behind",), True),
    "cubic": EffectKind("gear", STIFFENING, (0.0,), SPRINGS),
    "progressive": EffectKind("gear", STIFFENING, (0.0,), SPRINGS),
    "range": EffectKind("gear", STIFFENING, (0.5, 1.0, 1.5), SPRINGS),
    "gap": EffectKind("gear", LOST_MOTION, (0.1, 0.3), SPRINGS, True),
    "stop": EffectKind("gear", HYSTERESIS, (0.03, 0.1, 0.3, 1.0), LOOPS, True),
    "bristle": EffectKind("gear", HYSTERESIS, (0.03, 0.1, 0.3, 1.0), LOOPS, True),
    "error sine": EffectKind("gear", ERROR),
    "error cosine": EffectKind("gear", ERROR),
    "ripple sine": EffectKind("motor", RIPPLE),
    "ripple cosine": EffectKind("motor", RIPPLE),
}  # fmt: skip
WIDTH = SheetNumber("Hw_", "hysteresis, width of the loop", "angle", "rad")
SECANT = SheetNumber("K", "secant stiffness over a third of the largest torque", "stiffness", "N*m/rad")
SHEET = (*dict.fromkeys(row.number for row in KINDS.values()), WIDTH, SECANT)
APART = 1.5  # least factor between two distinguishable scales or stiffnesses


@dataclass(frozen=True)
class GearEffect:
    """Effect of a gear at a joint.

    friction, load: at the motor, constant and per Nm of the gear torque.  behind: friction at the link.  cubic,
    progressive: k_3 delta^3 and k_2s |delta| delta.  range: additional stiffness beyond a deflection.  gap: missing
    stiffness within a deflection (lost motion).  stop, bristle: elements of the hysteresis.
    scale: smoothing velocity of friction, rad/s; deflection of a hysteresis, or end of a range or gap, rad; order per
    motor revolution of an error or ripple; 0 for the others.  is_edge: the derivative of the effect by its scale.
    """

    kind: Kind
    joint: str
    scale: float = 0.0
    is_edge: bool = False

    @property
    def row(self) -> EffectKind:
        """Properties of its kind."""
        return KINDS[self.kind]

    @property
    def place(self) -> Place:
        """Location of its motion."""
        return self.row.place

    @property
    def is_implicit(self) -> bool:
        """True if the effect changes the motion that its force depends on (behind the gear, or between samples)."""
        return bool(self.row.scales)

    @property
    def edge(self) -> "GearEffect | None":
        """Derivative of the effect by its scale; None for an effect without scale."""
        return replace(self, is_edge=True) if self.scale and self.is_implicit else None

    @property
    def order(self) -> float:
        """Order of a periodic effect per motor revolution; 0 for other effects."""
        return 0.0 if self.is_implicit else self.scale


@dataclass(frozen=True, eq=False)
class GearMotion:
    """Motion of a joint over a period on a fine grid (n,), link side: rad, rad/s, Nm.

    angle: logged motor angle.  deflection: of the gear, with the static deflection and the transmission error.  torque:
    of the gear, with the static torque.  ratio: motor turns per joint turn.  k, d: of the linear spring.
    """

    angle: FloatArray
    velocity: FloatArray
    link_velocity: FloatArray
    deflection: FloatArray
    torque: FloatArray
    ratio: float
    k: float
    d: float

    @cached_property
    def along(self) -> Callable[[Kind, float], FloatArray]:
        """Function that returns Phi (n,) of an implicit kind and a scale, cached because effects share it."""
        signals = {"motor": self.velocity, "link": self.link_velocity, "gear": self.deflection}

        def phi(kind: Kind, scale: float) -> FloatArray:
            effect = GearEffect(kind, "", scale)
            return along_period(effect, signals[effect.place])[0]

        return cache(phi)


def along_period(effect: GearEffect, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Phi and dPhi / dx (n,) of an implicit effect along its signal x (n,) over a period; for a load, per Nm.

    A kink between two points is treated as at a point.
    """
    if effect.kind in ("friction", "load", "behind"):
        return sign_of(x, effect.scale)
    if effect.kind == "cubic":
        return x**3, 3 * x**2
    if effect.kind == "progressive":
        return np.abs(x) * x, 2 * np.abs(x)
    b = effect.scale
    if effect.kind == "range":
        return x - np.clip(x, -b, b), (np.abs(x) > b).astype(float)
    if effect.kind == "gap":
        return -np.clip(x, -b, b), np.where(np.abs(x) > b, 0.0, -1.0)
    # Two periods: the state at the start is unknown, and periodic from the second period on.
    phi = (stop if effect.kind == "stop" else bristle)(Path.of(np.concatenate([x, x])).without(len(x)), b) / b
    return phi, ((np.abs(phi) < 1) if effect.kind == "stop" else 1 - np.abs(phi)) / b


def transmission_error(effect: GearEffect, angle: FloatArray, ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return e and de/dq (n,) of unit amplitude at motor angles (n,), link side; ratio: motor turns per joint turn."""
    order = effect.scale * ratio
    sine, cosine = np.sin(order * angle), np.cos(order * angle)
    return (cosine, -order * sine) if effect.kind.endswith("cosine") else (sine, order * cosine)


def forces(effect: GearEffect, motion: GearMotion) -> list[tuple[Place, FloatArray]]:
    """Return each location where the effect acts, with Phi (n,); the force is -f Phi."""
    if effect.is_edge:
        h, smooth = 1e-3 * effect.scale, replace(effect, is_edge=False)
        pairs = forces(smooth, motion), forces(replace(smooth, scale=smooth.scale + h), motion)
        return [(place, (b - a) / h) for (place, a), (_, b) in zip(*pairs, strict=True)]
    if effect.is_implicit:
        phi = motion.along("friction" if effect.kind == "load" else effect.kind, effect.scale)
        return [(effect.place, np.abs(motion.torque) * phi if effect.kind == "load" else phi)]
    e, slope = transmission_error(effect, motion.angle, motion.ratio)
    if effect.kind.startswith("ripple"):
        return [("motor", e)]
    return [("gear", motion.k * e + motion.d * slope * motion.velocity), ("motor", motion.torque * slope)]
