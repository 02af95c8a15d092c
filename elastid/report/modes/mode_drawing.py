"""The robot as a stick figure in every mode of one configuration: visible displacements, and the best views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.model.stick_figure import StickFigure, StickKind

# Displacement of the point that moves furthest, in sizes of the robot.
SWING = 0.15
# Displacements of less, in sizes of the robot for a mode whose largest entry is 1 rad (or 1 m), are rounding.
MIN_DISPLACEMENT = 1e-6
# Motion out of the best view, over the largest in it, of a mode that needs a second view.
MIN_OUT_OF_PLANE = 0.1
# Weight of a view that sees the robot end-on, where one that shows all of it at rest has 1.
END_ON_WEIGHT = 0.25


@frozen_value
class ModeDrawing:
    """points (n, 3) at rest in m, links between them, joints among them; moved (n, 3, n_m): displacements in m.

    moved is complex: at the time t of a swing of 1 s a point is at points + Re(moved exp(2 pi j t)), damping left out;
    at t = 0 and 1/2 it is furthest away. up: the vertical axis of the base; hanging: it points down.
    """

    points: FloatArray
    links: tuple[tuple[int, int, StickKind], ...]
    joints: tuple[int, ...]
    moved: ComplexArray
    up: int = 2
    hanging: bool = False

    def views(self, mode: int) -> tuple[tuple[int, int], ...]:
        """Axes to the right and upwards of the view that shows most of a mode; and of the next, unless it is planar."""
        across = ((self.up + 1) % 3, (self.up + 2) % 3)
        planes = [(across[0], self.up), (across[1], self.up), across]
        motion = (np.abs(self.moved[:, :, mode]) ** 2).sum(axis=0)
        extent = np.ptp(self.points, axis=0) ** 2 / (np.ptp(self.points, axis=0) ** 2).sum()

        def visible(plane: tuple[int, int]) -> float:
            seen = list(plane)
            return float(motion[seen].sum() * (END_ON_WEIGHT + (1 - END_ON_WEIGHT) * extent[seen].sum()))

        planes.sort(key=visible, reverse=True)
        largest = np.abs(self.moved[:, :, mode]).max(axis=0)
        (missing,) = set(range(3)) - set(planes[0])
        return tuple(planes[: 1 if largest[missing] <= MIN_OUT_OF_PLANE * largest.max() else 2])


def mode_drawing(figure: StickFigure, shapes: ComplexArray, gravity: Sequence[float]) -> ModeDrawing | None:
    """The drawing of mode shapes (n_l, n_m) in joint coordinates; None where no point is seen to move.

    Motors are behind their gears and move no point. Each shape is turned to the phase in which its points are furthest
    from rest, so that the drawing does not depend on the phase and length of the shape.
    """
    size = float(np.ptp(figure.points, axis=0).max())
    moved = np.einsum("pal,lm->pam", figure.jacobian, shapes)
    reach = np.linalg.norm(moved, axis=1).max(axis=0, initial=0.0)
    moving = reach > MIN_DISPLACEMENT * size
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
