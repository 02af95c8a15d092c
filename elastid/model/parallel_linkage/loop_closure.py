r"""Loop closure: the constraints of each loop on the joints' coordinates.

.. math:: \varphi_{point} = p_2 - p_1, \qquad
          \varphi_{rod} = \frac{|p_2 - p_1|^2 - (L + s)^2}{2 L}

with s the rod's elongation. Points are seen from the last frame that carries both ends, so that a row holds the joints
of its loop and no others. Rods stand between points in space: the loop follows elasticity out of its plane, and neither
the rod's angles nor their redundant constraints exist.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import NUMBERS, Tree, Turn, located, tree, turns
from elastid.model.points import between, last_common, position, seat
from elastid.robot import Axis, Loop, Pin, Robot, unit_axis


@dataclass(frozen=True, eq=False)
class Closure:
    """One loop as expressions of the joints' coordinates.

    gap (3,): from the first end to the second.  ends: both in the base frame.  rows (n_rows,): zero where the loop is
    closed and its rod, if it has one, not stretched.  length: of its rod at rest, 0 without one.
    """

    loop: Loop
    gap: ca.SX
    ends: tuple[ca.SX, ca.SX]
    rows: ca.SX
    length: ca.SX | float = 0.0


def closures(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX] = NUMBERS) -> tuple[Closure, ...]:
    """The loops of a robot at joint coordinates q (n_l,); theta: names to symbols, as of `tree`."""
    layout = tree(robot, theta)
    turned = turns(layout, q)
    return tuple(_closure(robot, layout, turned, loop, theta) for loop in robot.loops)


def rod_row(closure: Closure, length: ca.SX | float) -> ca.SX:
    """(|gap|^2 - length^2) / (2 L), L the length at rest in the robot's description."""
    assert closure.loop.rod is not None
    return (ca.sumsqr(closure.gap) - length**2) / (2 * closure.loop.rod.length)


def _closure(robot: Robot, layout: Tree, turned: tuple[Turn, ...], loop: Loop, theta: Mapping[str, ca.SX]) -> Closure:
    first, second = (
        (seat(robot, layout, end.body), located(f"p{i}_{loop.name}", end.point, theta))
        for i, end in enumerate(loop.ends, start=1)
    )
    gap = between(layout, turned, first, second)
    ends = position(layout, turned, *first), position(layout, turned, *second)
    closure = Closure(loop, gap, ends, gap)
    if loop.rod is not None:
        length = theta.get(f"l_{loop.name}", loop.rod.length)
        return Closure(loop, gap, ends, rod_row(closure, length), length)
    if loop.pin is not None:
        return Closure(loop, gap, ends, _pin_rows(robot, layout, turned, loop, loop.pin, gap))
    return closure


def _pin_rows(robot: Robot, layout: Tree, turned: tuple[Turn, ...], loop: Loop, pin: Pin, gap: ca.SX) -> ca.SX:
    """Displacements across the axis; where the pin is spatial, that along it and the two tilts as well."""
    across = _across(pin.axis)
    x, y, z = (_direction(robot, layout, turned, loop, 0, axis) for axis in (*across, unit_axis(pin.axis)))
    rows = [ca.dot(x, gap), ca.dot(y, gap)]
    if not pin.planar:
        other = unit_axis(pin.axis if pin.other_axis is None else pin.other_axis)
        hinge = _direction(robot, layout, turned, loop, 1, other)
        rows += [ca.dot(z, gap), ca.dot(x, hinge), ca.dot(y, hinge)]
    return ca.vertcat(*rows)


def _direction(
    robot: Robot, layout: Tree, turned: tuple[Turn, ...], loop: Loop, end: int, direction: FloatArray
) -> ca.SX:
    """A direction of an end's body in the last frame that carries both ends."""
    seats = [seat(robot, layout, anchor.body) for anchor in loop.ends]
    root = last_common(layout, seats[0].frame, seats[1].frame)
    tip, foot = (position(layout, turned, seats[end], point, root) for point in (direction.tolist(), (0.0, 0.0, 0.0)))
    return tip - foot


def _across(axis: Axis) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that complete an axis."""
    z = unit_axis(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return x, np.cross(z, x)
