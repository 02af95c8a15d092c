"""The modes of the identified model in one configuration, as the report has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen
from elastid.report.modes.mode_drawing import ModeDrawing
from elastid.robot import Body, Joint, Robot, unit_axis

# Shares of a mode's energy that are named: so large, and at most so many.
NAMED, MOST = 0.05, 4
# Cosine of the angle between a link and the axis of its spring, above which it twists and below which it bends.
TWISTS, BENDS = 0.9, 0.5


def spring_names(robot: Robot) -> dict[str, str]:
    """What an engineer calls the spring of each stiffness k_<joint>, km_<joint> or k_<rod>."""
    names = {}
    for body in robot.bodies:
        for joint in body.joints:
            names[f"k_{joint.name}"] = f"{'gear' if joint.motor is not None else _kind(body, joint)} {joint.name}"
            names[f"km_{joint.name}"] = f"shaft of motor {joint.name}"
    for loop in robot.loops:
        names[f"k_{loop.name}"] = loop.name if "rod" in loop.name.lower() else f"rod {loop.name}"
    return names


def load_name(robot: Robot) -> str:
    """What stores energy beside the springs."""
    return "weight and compensators" if robot.compensators else "weight"


def _kind(body: Body, joint: Joint) -> str:
    """A spring amid a link, where no motor is, bends or twists it."""
    along = body.placement.rotation.T @ np.array(body.placement.xyz)
    length = float(np.linalg.norm(along))
    if joint.slides or length == 0 or any(other.motor is not None for other in body.joints):
        return "joint"
    cosine = abs(float(along @ unit_axis(joint.axis))) / length
    return "torsion" if cosine > TWISTS else "bending" if cosine < BENDS else "joint"


def shares_in_words(names: Sequence[str], shares: FloatArray) -> str:
    """The largest shares (n_e,) of a mode's energy, as in '62 % gear 2, 25 % bending b2'.

    >>> shares_in_words(["gear 1", "gear 2", "weight"], np.array([0.104, 0.956, -0.06]))
    '96 % gear 2, 10 % gear 1, -6 % weight'
    """
    order = [i for i in np.argsort(-np.abs(shares), kind="stable") if abs(shares[i]) >= NAMED][:MOST]
    return ", ".join(f"{100 * shares[i]:.0f} % {names[i]}" for i in order)


# Coordinates that the mode table names: those that move so much of the furthest one's way, and at most so many.
HALF, MOST = 0.5, 4


@dataclass(frozen=True)
class ModeRow:
    """Natural frequencies (n_m,) in Hz and damping ratios (n_m,) of the identified model in one configuration.

    frequency_std, damping_std (n_m,): what the parameters' uncertainty makes of them; empty where not known.
    coordinates (n,), shapes (n, n_m): what moves, the largest part of each mode 1; empty where not known.
    stores (n_e,), energy (n_e, n_m): springs, and last the weight, by what they are called, and their shares of each
    mode's potential energy; empty where not known.  drawing: None where there is nothing to be seen.
    """

    configuration: str
    frequency_hz: FloatArray
    damping_ratio: FloatArray
    frequency_std: FloatArray = field(default_factory=lambda: np.empty(0))
    damping_std: FloatArray = field(default_factory=lambda: np.empty(0))
    coordinates: tuple[str, ...] = ()
    shapes: ComplexArray = field(default_factory=lambda: np.empty((0, 0), complex))
    stores: tuple[str, ...] = ()
    energy: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    drawing: ModeDrawing | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays and check shapes."""
        for name in ("frequency_hz", "damping_ratio", "frequency_std", "damping_std", "energy"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "shapes", frozen(self.shapes, np.complex128))
        n_m = len(self.frequency_hz)
        for of, values in ((self.coordinates, self.shapes), (self.stores, self.energy)):
            if of and values.shape != (len(of), n_m):
                raise ValueError(f"an array is {values.shape}, of {len(of)} names ({of[0]}, ...) in {n_m} modes")

    @property
    def modes(self) -> list[tuple[float, float, float, float, str, str]]:
        """Mode by mode: frequency, its standard deviation, damping ratio, its standard deviation, where the energy is,
        and what moves most.

        NaN where a standard deviation is not known.
        """
        unknown = [np.nan] * len(self.frequency_hz)
        columns = (self.frequency_hz, self.frequency_std, self.damping_ratio, self.damping_std)
        numbers = [list(column) if len(column) else unknown for column in columns]
        return list(zip(*numbers, self.carried, self._movers, strict=True))

    @property
    def carried(self) -> list[str]:
        """Mode by mode what stores the energy, in words."""
        if not self.stores:
            return [""] * len(self.frequency_hz)
        return [shares_in_words(self.stores, shares) for shares in self.energy.T]

    @property
    def _movers(self) -> list[str]:
        """The coordinates that move at least half as far as the furthest, furthest first, with their direction."""
        if not self.coordinates:
            return [""] * len(self.frequency_hz)
        words = []
        for shape in self.shapes.T:
            order = [i for i in np.argsort(-np.abs(shape), kind="stable") if abs(shape[i]) >= HALF][:MOST]
            words.append(", ".join(f"{self.coordinates[i]} {shape[i].real:+.2f}" for i in order))
        return words
