"""Which shapes of friction are taken out: by cross-validation over realisations, and only where it pays."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.frf.friction.levels import NormalEquations, solve

# A further shape must lower the power that is left in other realisations by this part of it.
_MIN_SHAPE_GAIN = 0.02
# Friction is taken out of a motor where at most this share of the power is left in other realisations.
MAX_KEPT_SHARE = 0.5


def kept_power(found: NormalEquations, motor: int, chosen: IntArray) -> float:
    """Power that `chosen` shapes leave of a motor's residual, each realisation by the levels of all others."""
    total = float(found.c[:, motor].sum())
    if not len(chosen):
        return total
    A, b = found.A[np.ix_(np.arange(len(found.A)), chosen, chosen)], found.b[:, chosen]
    left = 0.0
    for m in range(len(A)):
        f = solve(A.sum(axis=0) - A[m], b.sum(axis=0) - b[m])
        left += float(found.c[m, motor] - 2 * b[m] @ f + f @ A[m] @ f)
    return left


def choose_shapes(found: NormalEquations, motor: int, candidates: IntArray) -> tuple[IntArray, float]:
    """The shapes of a motor, added one at a time as long as another pays; and the share of the power that they leave.

    The first candidate is Coulomb friction: it goes where others explain its part.
    """
    chosen: list[int] = []
    left = total = kept_power(found, motor, candidates[:0])
    while len(chosen) < len(candidates):
        others = [each for each in candidates.tolist() if each not in chosen]
        powers = [kept_power(found, motor, np.array([*chosen, each])) for each in others]
        best = int(np.argmin(powers))
        if powers[best] > (1 - _MIN_SHAPE_GAIN) * left:
            break
        chosen.append(others[best])
        left = powers[best]
    share = left / total if total > 0 else 1.0
    return _without_needless(found, motor, np.array(sorted(chosen), dtype=np.int64), left), share


def _without_needless(found: NormalEquations, motor: int, chosen: IntArray, left: float) -> IntArray:
    """Without those that others have made needless."""
    for each in chosen.tolist():
        rest = chosen[chosen != each]
        if len(rest) and kept_power(found, motor, rest) <= (1 + _MIN_SHAPE_GAIN / 2) * left:
            return _without_needless(found, motor, rest, left)
    return chosen


def shares(found: NormalEquations, motors: int, motor_of: IntArray, chosen: IntArray) -> FloatArray:
    """Share (n_m,) of the power that the chosen shapes (n,) of each motor leave in other realisations."""
    every = [chosen[motor_of[chosen] == motor] for motor in range(motors)]
    none = motor_of[:0]
    powers = [(kept_power(found, i, own), kept_power(found, i, none)) for i, own in enumerate(every)]
    return np.array([left / total if total > 0 else 1.0 for left, total in powers])
