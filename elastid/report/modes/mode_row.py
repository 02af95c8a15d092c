"""The modes of the identified model in one configuration: numbers, energies and shapes, and the names of springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.report.modes.mode_drawing import ModeDrawing
from elastid.robot import Body, Joint, Robot, unit_axis

# Written: shares of a mode's energy, coordinates by their motion over the largest, and how many of each.
MIN_SHARE, MIN_MOTION, MAX_WRITTEN = 0.05, 0.5, 4
# Cosine of the angle between a link and the axis of its spring.
MIN_TORSION_COSINE, MAX_BENDING_COSINE = 0.9, 0.5


@frozen_value
class ModeRow:
    """Natural frequencies (n_m,) in Hz and damping ratios (n_m,) of the identified model in one configuration.

    frequency_std, damping_std (n_m,): by the covariance of the parameters; empty where not known.
    coordinates (n,), shapes (n, n_m): the largest entry of each mode is 1; empty where not known.
    stores (n_e,), energy (n_e, n_m): names of the springs and last of the weight, and their shares of each mode's
    potential energy; empty where not known.  drawing: None where no point of the robot is seen to move.
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
        """Check shapes."""
        n_m = len(self.frequency_hz)
        for of, values in ((self.coordinates, self.shapes), (self.stores, self.energy)):
            if of and values.shape != (len(of), n_m):
                raise ValueError(f"an array is {values.shape}, of {len(of)} names ({of[0]}, ...) in {n_m} modes")

    @property
    def modes(self) -> list[tuple[float, float, float, float, str, str]]:
        """Mode by mode: frequency, its std, damping ratio, its std, energy by spring, coordinates that move most.

        NaN where a standard deviation is not known.
        """
        unknown = [np.nan] * len(self.frequency_hz)
        columns = (self.frequency_hz, self.frequency_std, self.damping_ratio, self.damping_std)
        numbers = [list(column) if len(column) else unknown for column in columns]
        return list(zip(*numbers, self.energy_text, self._motion_text, strict=True))

    @property
    def energy_text(self) -> list[str]:
        """Mode by mode the largest shares of the energy."""
        if not self.stores:
            return [""] * len(self.frequency_hz)
        return [shares_in_words(self.stores, shares) for shares in self.energy.T]

    @property
    def _motion_text(self) -> list[str]:
        """Coordinates that move at least half as far as the furthest, furthest first, with their direction."""
        if not self.coordinates:
            return [""] * len(self.frequency_hz)
        return [
            ", ".join(f"{self.coordinates[i]} {shape[i].real:+.2f}" for i in _largest(np.abs(shape), MIN_MOTION))
            for shape in self.shapes.T
        ]


def shares_in_words(names: Sequence[str], shares: FloatArray) -> str:
    """The largest shares (n_e,) of a mode's energy, as in '62 % gear 2, 25 % bending b2'.

    >>> shares_in_words(["gear 1", "gear 2", "weight"], np.array([0.104, 0.956, -0.06]))
    '96 % gear 2, 10 % gear 1, -6 % weight'
    """
    return ", ".join(f"{100 * shares[i]:.0f} % {names[i]}" for i in _largest(np.abs(shares), MIN_SHARE))


def _largest(magnitude: FloatArray, least: float) -> list[int]:
    """Indices of the largest entries of at least so much, the largest first."""
    return [i for i in np.argsort(-magnitude, kind="stable").tolist() if magnitude[i] >= least][:MAX_WRITTEN]


def spring_names(robot: Robot) -> dict[str, str]:
    """The name that an engineer gives the spring of each stiffness k_<joint>, km_<joint> or k_<rod>."""
    names = {}
    for body in robot.bodies:
        for joint in body.joints:
            names[f"k_{joint.name}"] = f"{'gear' if joint.motor is not None else _kind(body, joint)} {joint.name}"
            names[f"km_{joint.name}"] = f"shaft of motor {joint.name}"
    for loop in robot.loops:
        names[f"k_{loop.name}"] = loop.name if "rod" in loop.name.lower() else f"rod {loop.name}"
    return names


def load_name(robot: Robot) -> str:
    """The name of the stores of energy beside the springs."""
    return "weight and compensators" if robot.compensators else "weight"


def _kind(body: Body, joint: Joint) -> str:
    """Bending or torsion where the spring of a joint without motor lies in a link along or across its axis."""
    along = body.placement.rotation.T @ np.array(body.placement.xyz)
    length = float(np.linalg.norm(along))
    if joint.slides or length == 0 or any(other.motor is not None for other in body.joints):
        return "joint"
    cosine = abs(float(along @ unit_axis(joint.axis))) / length
    return "torsion" if cosine > MIN_TORSION_COSINE else "bending" if cosine < MAX_BENDING_COSINE else "joint"
