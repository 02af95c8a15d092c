r"""Friction of one bristle on the fine grid of a motion: what it remembers, and means over the cells.

.. math:: stop: &\quad s(t + dt) = \mathrm{clip}(s(t) + dq, -D, D) \\
          bristle: &\quad ds = dq - |dq|\, s / D

A stop operator is an element of Maxwell's slip law, the bristle is Dahl's (and LuGre's without its Stribeck curve).
Both depend on the way alone; between two turning points they are functions of the way from the first of them. So only
turning points need to be followed one after the other, and s is exact where q is monotonous between its points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray

# From here on tanh(x) is 1 to 1e-10.
_SATURATED = 12.0


@dataclass(frozen=True)
class Path:
    """A motion q (n,) by its turning points: steps between them, the last one (n,) before each q, q (n,) from it on."""

    steps: list[float]
    last: IntArray
    moved: FloatArray

    @classmethod
    def of(cls, q: FloatArray) -> Path:
        """The turning points of q (n,), its ends among them."""
        rising = np.diff(q)
        is_turning = rising[1:] * rising[:-1] <= 0
        turning = np.concatenate([[0], np.flatnonzero(is_turning) + 1, [len(q) - 1]])
        counts = np.diff(turning)
        last = np.append(np.repeat(np.arange(len(counts)), counts), len(counts) - 1)
        return cls(np.diff(q[turning]).tolist(), last, np.asarray(q - q[turning[last]]))

    def without(self, n: int) -> Path:
        """The same without the points of its first n q, whose steps it still has."""
        return Path(self.steps, self.last[n:], self.moved[n:])


def stop(path: Path, D: float) -> FloatArray:
    """s (n,) of a stop operator along a path, from s = 0."""
    states = [0.0]
    for step in path.steps:
        states.append(min(max(states[-1] + step, -D), D))
    return np.asarray(np.clip(np.array(states)[path.last] + path.moved, -D, D))


def bristle(path: Path, D: float) -> FloatArray:
    """s (n,) of a bristle along a path, from s = 0."""
    states = [0.0]
    for step in path.steps:
        end = math.copysign(D, step)
        states.append(end + (states[-1] - end) * math.exp(-abs(step) / D))
    ends = np.copysign(D, path.moved)
    return np.asarray(ends + (np.array(states)[path.last] - ends) * np.exp(-np.abs(path.moved) / D))


def mean_sign(v: FloatArray, v_s: float) -> FloatArray:
    """Mean (n - 1,) of tanh(v / v_s) over each cell between points v (n,), v linear in it; of sgn(v) where v_s = 0."""
    return sum_of_mean_signs(v, [(v_s, 1.0)])


def sum_of_mean_signs(v: FloatArray, signs: Sequence[tuple[float, float]]) -> FloatArray:
    """Sum (n - 1,) of levels times `mean_sign`, of pairs of a speed v_s and a level; they share the search for cells.

    By the integral v_s ln cosh(v / v_s), or |v|; so a reversal within a cell counts where it is.
    """
    speed = np.abs(v)
    slow = speed <= _SATURATED * max(v_s for v_s, _ in signs)
    negative = np.signbit(v)
    found = np.copysign(sum(level for _, level in signs), v[:-1])
    turning = np.flatnonzero(slow[:-1] | slow[1:] | (negative[:-1] != negative[1:]))
    # Neighbouring cells share a point, where the integral is found once.
    before = np.arange(len(turning)) + np.cumsum(np.diff(turning, prepend=turning[:1]) > 1)
    points = np.zeros(len(turning) and before[-1] + 2, dtype=np.int64)
    points[before], points[before + 1] = turning, turning + 1
    step = v[turning + 1] - v[turning]
    small = np.abs(step) <= 1e-6 * (speed[turning] + speed[turning + 1])
    middle = (v[turning] + v[turning + 1])[small] / 2
    step[small] = 1.0
    found[turning] = 0.0
    for v_s, level in signs:
        integral = speed[points]
        if v_s > 0:
            integral += v_s * np.log1p(np.exp(-2 / v_s * integral))
        mean = (integral[before + 1] - integral[before]) / step
        mean[small] = np.tanh(middle / v_s) if v_s > 0 else np.sign(middle)
        found[turning] += level * mean
    return np.asarray(found)
