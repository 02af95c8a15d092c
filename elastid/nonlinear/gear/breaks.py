r"""Laws of springs and loops that break or turn back between the points at which a deflection is known.

Between two points, 1 apart, x is a line with a bend c t (t - 1) / 2, c its second difference, and the mean of a smooth
law is that of its ends less a twelfth of its own second difference. In cells where a law breaks, where a stop begins to
slide and where the motion turns back, it is the mean over many points of that curve, and a loop turns back at its
vertex. Values at the points are those whose means over cells are these: at points alone, what a break has beyond half
their rate would be folded onto the lines.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.friction.operators import Path, bristle, stop
from elastid.nonlinear.gear.turning import following, points_of_means

_PARTS = (np.arange(16) + 0.5) / 16  # of a cell in which a law breaks


def clipped(x: FloatArray, b: float) -> tuple[FloatArray, FloatArray]:
    """x within -b and b, and its slope (n,), along deflections x (n,) of a period."""
    phi, bend, within = np.clip(x, -b, b), _bends(x), np.abs(x) <= b
    slope, side = within.astype(float), np.sign(x) * ~within
    means = _means(phi, bend * slope)
    cells = np.flatnonzero(side != following(side))
    curve = _curves(x, bend, cells)
    means[cells] = np.clip(curve, -b, b).mean(axis=1)
    slope[cells] = (np.abs(curve) <= b).mean(axis=1)
    return points_of_means(means), (slope + np.roll(slope, 1)) / 2


def looped(kind: Literal["stop", "bristle"], x: FloatArray, D: float) -> tuple[FloatArray, FloatArray]:
    """State, over D, of an element that bends over D, and its slope (n,), along deflections x (n,) of a period."""
    bend, step = _bends(x), following(x) - x
    v = (step + np.roll(step, 1)) / 2
    turns = np.flatnonzero(v * following(v) < 0)
    at = np.full(len(x), np.inf)
    at[turns] = v[turns] / (v - following(v))[turns]
    vertex = x[turns] + at[turns] * (step[turns] + bend[turns] * (at[turns] - 1) / 2)
    path = np.insert(x, turns + 1, vertex)
    # The state at the start is not known: the period is run over twice.
    twice = Path.of(np.concatenate([path, path])).without(len(path))
    states = (stop if kind == "stop" else bristle)(twice, D) / D
    inserted = turns + 1 + np.arange(len(turns))
    phi = np.delete(states, inserted)
    if kind == "stop":
        slope = (np.abs(phi) < 1) / D
        means = _means(phi, bend * slope)
        cells = np.union1d(turns, np.flatnonzero((slope > 0) & (np.abs(following(phi)) == 1)))
    else:
        slope, middle = (1 - np.abs(phi)) / D, (phi + following(phi)) / 2
        means = _means(phi, (1 - np.sign(step) * middle) / D * (bend - np.abs(step) * step / D))
        cells = turns
    # From the point before, and from the vertex on
    begin, state = x.copy(), phi.copy()
    begin[turns], state[turns] = vertex, states[inserted]
    is_after = at[cells, None] < _PARTS
    moved = (_curves(x, bend, cells) - np.where(is_after, begin[cells, None], x[cells, None])) / D
    first = np.where(is_after, state[cells, None], phi[cells, None])
    if kind == "stop":
        curve = np.clip(first + moved, -1, 1)
    else:
        curve = np.sign(moved) + (first - np.sign(moved)) * np.exp(-np.abs(moved))
    means[cells] = curve.mean(axis=1)
    return points_of_means(means), slope


def _means(phi: FloatArray, bend: FloatArray) -> FloatArray:
    """Of a smooth law over the cells that begin at its points (n,), by its second differences."""
    return np.asarray((phi + following(phi)) / 2 - bend / 12)


def _bends(x: FloatArray) -> FloatArray:
    """Second differences (n,) in the middle of cells."""
    bend = following(x) - 2 * x + np.roll(x, 1)
    return np.asarray((bend + following(bend)) / 2)


def _curves(x: FloatArray, bend: FloatArray, cells: IntArray) -> FloatArray:
    """x (m, 16) within cells (m,)."""
    step = (following(x) - x)[cells, None]
    return np.asarray(x[cells, None] + _PARTS * (step + bend[cells, None] * (_PARTS - 1) / 2))
