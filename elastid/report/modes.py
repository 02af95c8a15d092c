"""Modes of a model or of measured responses for the page: numbers, energies, shapes and animated stick figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.model.spec import StickKind
from elastid.robot import Body, Joint, Robot, unit_axis

if TYPE_CHECKING:
    from elastid.modal.modes import Modes  # slow imports: SciPy's linear algebra and CasADi
    from elastid.modal.spec import GeometrySpec
    from elastid.model.kinematics import StickFigure

SWING = 0.15  # largest displacement in a drawing, relative to the size of the robot
MIN_DISPLACEMENT = 1e-6  # relative to the size of the robot, for a mode with the largest entry 1; less is rounding
END_ON_WEIGHT = 0.25  # weight of a view along the robot; 1 for a view that shows its full extent


@frozen_value
class ModeDrawing:
    """Drawing of modes: points (n, 3) at rest in m, links between points, and points that are joints.

    moved (n, 3, n_m): complex displacements in m.  At time t of a cycle of 1 s, a point is at
    points + Re(moved exp(2 pi j t)), without damping; the displacement is largest at t = 0 and 1/2.  up: the vertical
    axis of the base.  hanging: True if this axis points down.
    """

    points: FloatArray
    links: tuple[tuple[int, int, StickKind], ...]
    joints: tuple[int, ...]
    moved: ComplexArray
    up: int = 2
    hanging: bool = False

    def views(self, mode: int) -> tuple[tuple[int, int], ...]:
        """Select axes (right, up) of the view that shows most of a mode, and of a second view if it is not planar."""
        across = ((self.up + 1) % 3, (self.up + 2) % 3)
        planes = [(across[0], self.up), (across[1], self.up), across]
        distance, extent = np.abs(self.moved[:, :, mode]), np.ptp(self.points, axis=0) ** 2
        motion, extent = (distance**2).sum(axis=0), extent / extent.sum()

        def visible(plane: tuple[int, int]) -> float:
            axes = list(plane)
            return float(motion[axes].sum() * (END_ON_WEIGHT + (1 - END_ON_WEIGHT) * extent[axes].sum()))

        planes.sort(key=visible, reverse=True)
        largest = distance.max(axis=0)
        (third,) = set(range(3)) - set(planes[0])
        # A mode needs a second view if more than a tenth of its motion is normal to the first view.
        return tuple(planes[: 1 if largest[third] <= 0.1 * largest.max() else 2])


def mode_drawing(figure: StickFigure, shapes: ComplexArray, gravity: Sequence[float]) -> ModeDrawing | None:
    """Return the drawing of mode shapes (n_l, n_m) in joint coordinates; None if no visible point moves.

    Motors move no point. Each shape is normalised to the phase and amplitude of its largest displacement, so that the
    drawing does not depend on the phase and length of the shape.
    """
    size = float(np.ptp(figure.points, axis=0).max())
    motion = np.einsum("pal,lm->pam", figure.jacobian, shapes)
    moving = np.linalg.norm(motion, axis=1).max(axis=0, initial=0.0) > MIN_DISPLACEMENT * size
    if not size > 0 or not moving.any():
        return None
    motion = np.where(moving, motion, 0.0)
    motion = motion * np.exp(-0.5j * np.angle((motion**2).sum(axis=(0, 1))))
    flat = motion.real.reshape(-1, motion.shape[2])
    sign = np.sign(np.take_along_axis(flat, np.abs(flat).argmax(axis=0)[None], axis=0)[0])
    furthest = np.linalg.norm(motion.real, axis=1).max(axis=0)
    motion = motion * np.divide(SWING * size * sign, furthest, out=np.zeros(len(sign)), where=moving)
    up = int(np.argmax(np.abs(gravity))) if any(gravity) else 2
    return ModeDrawing(figure.points, figure.links, figure.joints, motion, up, gravity[up] > 0)


def measured_modes_row(modes: Modes, geometry: GeometrySpec | None) -> ModeRow:
    """Return the modes of a measured response, whose coordinates are its outputs."""
    columns = modes.configuration, modes.freq_hz, modes.zeta, modes.freq_std, modes.zeta_std
    drawing = None if geometry is None or not modes.n_modes else measured_drawing(modes, geometry)
    return ModeRow(*columns, coordinates=modes.places, shapes=modes.place_shapes[0], drawing=drawing)


def measured_drawing(modes: Modes, geometry: GeometrySpec) -> ModeDrawing | None:
    """Return the drawing of measured mode shapes at the points of a geometry; None without motion."""
    names = list(geometry.points)
    points = np.array([geometry.points[name] for name in names], dtype=float)
    motion = np.zeros((len(names), 3, modes.n_modes), complex)
    for location, shape in zip(modes.places, modes.place_shapes[0], strict=True):
        if (node := geometry.direction_of(location)) is not None:
            point, direction = node
            sign = -1.0 if direction.startswith("-") else 1.0
            motion[names.index(point), "xyz".index(direction.lstrip("+-"))] += sign * shape
    size = float(np.ptp(points, axis=0).max(initial=0.0))
    amplitude = np.linalg.norm(motion, axis=1).max(axis=0, initial=0.0)
    if not size > 0 or not amplitude.any():
        return None
    lines = geometry.lines or tuple(pairwise(names))
    links: tuple[tuple[int, int, StickKind], ...] = tuple((names.index(a), names.index(b), "strut") for a, b in lines)
    swung = motion * np.divide(SWING * size, amplitude, out=np.zeros(modes.n_modes), where=amplitude > 0)
    return ModeDrawing(points, links, tuple(range(len(names))), swung)


# Least energy fraction and least relative motion in a text, and the number of entries.
MIN_FRACTION, MIN_MOTION, MAX_WRITTEN = 0.05, 0.5, 4


@frozen_value
class ModeRow:
    """Natural frequencies (n_m,) in Hz and damping ratios (n_m,) in one configuration; unknown arrays are empty.

    frequency_std, damping_std (n_m,): standard deviations.  coordinates (n,), shapes (n, n_m): the largest entry of
    each mode is 1.  stores (n_e,), energy (n_e, n_m): names of the springs and of the weight (last), and their
    fractions of the potential energy of each mode.  drawing: None if no visible point moves.
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
        n_m = len(self.frequency_hz)
        for names, values in ((self.coordinates, self.shapes), (self.stores, self.energy)):
            if names and values.shape != (len(names), n_m):
                raise ValueError(f"an array is {values.shape}, of {len(names)} names ({names[0]}, ...) in {n_m} modes")

    @property
    def modes(self) -> list[tuple[float, float, float, float, str, str]]:
        """Rows by mode: frequency, std, damping ratio, std (NaN: unknown), energy by spring, largest coordinates."""
        unknown = [np.nan] * len(self.frequency_hz)
        columns = (self.frequency_hz, self.frequency_std, self.damping_ratio, self.damping_std)
        numbers = [list(column) if len(column) else unknown for column in columns]
        return list(zip(*numbers, self.energy_text, self._motion_text, strict=True))

    @property
    def energy_text(self) -> list[str]:
        """Largest energy fractions of each mode."""
        if not self.stores:
            return [""] * len(self.frequency_hz)
        return [format_energy(self.stores, fractions) for fractions in self.energy.T]

    @property
    def _motion_text(self) -> list[str]:
        """Coordinates with at least half of the largest motion of each mode, in decreasing order, with signs."""
        if not self.coordinates:
            return [""] * len(self.frequency_hz)
        return [
            ", ".join(
                f"{self.coordinates[i]} {math.copysign(abs(shape[i]), shape[i].real):+.2f}"
                for i in _largest(np.abs(shape), MIN_MOTION)
            )
            for shape in self.shapes.T
        ]


def format_energy(names: Sequence[str], fractions: FloatArray) -> str:
    """Format the largest energy fractions (n_e,) of a mode, such as '62 % gear 2, 25 % bending b2'.

    >>> format_energy(["gear 1", "gear 2", "weight"], np.array([0.104, 0.956, -0.06]))
    '96 % gear 2, 10 % gear 1, -6 % weight'
    """
    return ", ".join(f"{100 * fractions[i]:.0f} % {names[i]}" for i in _largest(np.abs(fractions), MIN_FRACTION))


def _largest(magnitude: FloatArray, min_value: float) -> list[int]:
    return [i for i in np.argsort(-magnitude, kind="stable").tolist() if magnitude[i] >= min_value][:MAX_WRITTEN]


def spring_names(robot: Robot) -> dict[str, str]:
    """Name the spring of each stiffness k_<joint>, km_<joint> or k_<rod> for an engineer."""
    names = {}
    for body in robot.bodies:
        for joint in body.joints:
            names[f"k_{joint.name}"] = f"{'joint' if joint.motor is not None else _kind(body, joint)} {joint.name}"
            names[f"km_{joint.name}"] = f"shaft of motor {joint.name}"
    for loop in robot.loops:
        names[f"k_{loop.name}"] = loop.name if "rod" in loop.name.lower() else f"rod {loop.name}"
    return names


def load_name(robot: Robot) -> str:
    """Name the stores of energy other than springs."""
    return "weight and compensators" if robot.compensators else "weight"


def _kind(body: Body, joint: Joint) -> str:
    """Return bending or torsion for a spring in a link, by the angle between the link and the axis; else joint."""
    along = body.placement.rotation.T @ np.array(body.placement.xyz)
    length = float(np.linalg.norm(along))
    if joint.slides or length == 0 or any(joint_.motor is not None for joint_ in body.joints):
        return "joint"
    cosine = abs(float(along @ unit_axis(joint.axis))) / length
    return "torsion" if cosine > 0.9 else "bending" if cosine < 0.5 else "joint"
