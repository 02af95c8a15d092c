r"""Friction of one element with memory on the fine grid of a motion: stop operator and bristle.

.. math:: stop: &\quad s(t + dt) = \mathrm{clip}(s(t) + dq, -D, D) \\
          bristle: &\quad ds = dq - |dq|\, s / D

A stop operator is an element of Maxwell's slip law, the bristle is Dahl's (and LuGre's without its Stribeck curve).
Both depend on the way alone; between two turning points they are functions of the way from the first of them. So only
turning points need to be followed one after the other, and s is exact where q is monotonous between its points.
"""

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.kernels import call, is_compiled


@dataclass(frozen=True)
class Path:
    """A motion q (n,) by its turning points: steps between them, the last one (n,) before each q, q (n,) from it on."""

    steps: FloatArray
    last: IntArray
    displacement: FloatArray

    @classmethod
    def of(cls, q: FloatArray) -> "Path":
        """Return the turning points of q (n,), its ends among them."""
        rising = np.diff(q)
        turning = np.concatenate([[0], np.flatnonzero(rising[1:] * rising[:-1] <= 0) + 1, [len(q) - 1]])
        counts = np.diff(turning)
        last = np.append(np.repeat(np.arange(len(counts)), counts), len(counts) - 1)
        return cls(np.diff(q[turning]), last, np.asarray(q - q[turning[last]]))

    def without(self, n: int) -> "Path":
        """Return path without the points of its first n q, whose steps it still has."""
        return Path(self.steps, self.last[n:], self.displacement[n:])


def stop(path: Path, D: float) -> FloatArray:
    """Return s (n,) of a stop operator along a path, from s = 0."""
    if is_compiled():
        return _in_c(path, D, False)
    states = [0.0]
    for step in path.steps.tolist():
        states.append(min(max(states[-1] + step, -D), D))
    return np.clip(np.array(states)[path.last] + path.displacement, -D, D)


def bristle(path: Path, D: float) -> FloatArray:
    """Return s (n,) of a bristle along a path, from s = 0."""
    if is_compiled():
        return _in_c(path, D, True)
    states = [0.0]
    for step in path.steps.tolist():
        end = math.copysign(D, step)
        states.append(end + (states[-1] - end) * math.exp(-abs(step) / D))
    ends = np.copysign(D, path.displacement)
    return np.asarray(ends + (np.array(states)[path.last] - ends) * np.exp(-np.abs(path.displacement) / D))


def _in_c(path: Path, D: float, is_bristle: bool) -> FloatArray:
    """Return the state by `base/kernels/operators.c`."""
    s, states = np.empty(len(path.displacement)), np.empty(len(path.steps) + 1)
    numbers = len(path.steps), len(s), int(is_bristle), np.array([D], np.float64)
    call("element", *numbers, path.steps, path.last, path.displacement, states, s)
    return s
