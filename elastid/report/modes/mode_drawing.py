"""The robot's sticks in every mode of one configuration, moved far enough to be seen, and from where to look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen
from elastid.model.stick_figure import Kind, StickFigure

# The point that moves furthest goes to either side by this part of the robot's size.
SWING = 0.15
# Less than this part of the size for a mode whose largest entry is 1 rad (or 1 m) is rounding: nothing moves.
STILL = 1e-6
# A mode that leaves its best view by no more than this part of its largest motion is planar.
PLANAR = 0.1
# What a view is worth that sees the robot end-on, beside one that shows all of it at rest.
END_ON = 0.25


@dataclass(frozen=True)
class ModeDrawing:
    """points (n, 3) at rest in m, links between them, joints among them; moved (n, 3, n_m): displacements in m.

    moved is complex: at the time t of a swing of 1 s a point is at points + Re(moved exp(2 pi j t)), damping left out;
    at t = 0 and 1/2 it is furthest away. up: the axis of the base that points up, hanging: its negative does.
    """

    points: FloatArray
    links: tuple[tuple[int, int, Kind], ...]
    joints: tuple[int, ...]
    moved: ComplexArray
    up: int = 2
    hanging: bool = False

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "points", frozen(self.points))
        object.__setattr__(self, "moved", frozen(self.moved, np.complex128))

    def views(self, mode: int) -> tuple[tuple[int, int], ...]:
        """The axes to the right and upwards of the view that shows most of a mode, and, unless planar, of the next."""
        across = ((self.up + 1) % 3, (self.up + 2) % 3)
        planes = [(across[0], self.up), (across[1], self.up), across]
        motion = (np.abs(self.moved[:, :, mode]) ** 2).sum(axis=0)
        extent = np.ptp(self.points, axis=0) ** 2 / (np.ptp(self.points, axis=0) ** 2).sum()

        def worth(plane: tuple[int, int]) -> float:
            seen = list(plane)
            return float(motion[seen].sum() * (END_ON + (1 - END_ON) * extent[seen].sum()))

        planes.sort(key=worth, reverse=True)
        largest = np.abs(self.moved[:, :, mode]).max(axis=0)
        (missing,) = set(range(3)) - set(planes[0])
        return tuple(planes[: 1 if largest[missing] <= PLANAR * largest.max() else 2])


def mode_drawing(figure: StickFigure, shapes: ComplexArray, gravity: Sequence[float]) -> ModeDrawing | None:
    """Of mode shapes (n_l, n_m) in the joints' coordinates; None where all points are one, or none moves in any mode.

    Motors are behind their gears and move no point. Each shape is turned to the phase in which its points are furthest
    from rest, so that its own phase and length do not matter.
    """
    size = float(np.ptp(figure.points, axis=0).max())
    moved = np.einsum("pal,lm->pam", figure.jacobian, shapes)
    way = np.linalg.norm(moved, axis=1).max(axis=0, initial=0.0)
    moving = way > STILL * size
    if not size > 0 or not moving.any():
        return None
    moved = np.where(moving, moved, 0.0)
    moved = moved * np.exp(-0.5j * np.angle((moved**2).sum(axis=(0, 1))))
    flat = moved.real.reshape(-1, moved.shape[2])
    sign = np.sign(np.take_along_axis(flat, np.abs(flat).argmax(axis=0)[None], axis=0)[0])
    furthest = np.linalg.norm(moved.real, axis=1).max(axis=0)
    moved = moved * np.divide(SWING * size * sign, furthest, out=np.zeros(len(sign)), where=moving)
    up = int(np.argmax(np.abs(gravity))) if any(gravity) else 2
    return ModeDrawing(figure.points, figure.links, figure.joints, moved, up, gravity[up] > 0)
