r"""Shapes that fit nearly as well as the chosen ones, and what the choice between them adds to the levels' covariance.

With levels f ~ N(0, S), S = diag(s_i^2), the evidence of a set of shapes, their levels integrated out, is

.. math:: \ln p = \tfrac12 b^T \hat f - \tfrac12 \ln \det(S H), \qquad H = A + S^{-1}, \quad \hat f = H^{-1} b

s_i: the level at which a shape has the power of all friction that was found. Sets are the chosen one and its
neighbours: one shape more, less, or another in its place. With weights w_S = p_S / sum p,

.. math:: C = \sum_S w_S\, (\hat f_S - \hat f)(\hat f_S - \hat f)^T

about the levels of the chosen set. (Hoeting, Madigan, Raftery and Volinsky, Statistical Science 14, 1999.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.frf.friction.levels import NormalEquations, solve

# Sets of a lower weight than this are left out, and shapes that are in no other set.
_MIN_WEIGHT = 0.05


@dataclass(frozen=True)
class Neighbours:
    """Shapes (n,) of a motor, sorted, in sets of some weight; covariance (n, n) of levels by the choice of a set."""

    shapes: IntArray
    covariance: FloatArray


def neighbours_of(found: NormalEquations, chosen: IntArray, candidates: IntArray) -> Neighbours:
    """The neighbours of the chosen shapes (n,) of one motor among its candidates, these among them."""
    if not len(chosen):
        return Neighbours(chosen, np.zeros((0, 0)))
    A, b = (2 * found.dof_share * each.sum(axis=0) for each in (found.A, found.b))
    f = solve(A[np.ix_(chosen, chosen)], b[chosen])
    power = float(f @ A[np.ix_(chosen, chosen)] @ f)
    first, *others = _sets(chosen.tolist(), candidates.tolist())
    sets = [first, *(each for each in others if _is_possible(A, b, each))]
    evidence = np.array([_evidence(A[np.ix_(each, each)], b[each], power) for each in sets])
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    kept = [(w, each) for w, each in zip(weights.tolist(), sets, strict=True) if w >= _MIN_WEIGHT]
    shapes = np.array(sorted({*chosen.tolist(), *(i for _, each in kept for i in each)}), dtype=np.int64)
    levels = [_levels(A, b, each, shapes) for _, each in kept]
    apart = np.array(levels) - _levels(A, b, chosen.tolist(), shapes)
    w = np.array([each for each, _ in kept])
    return Neighbours(shapes, np.asarray((apart.T * (w / w.sum())) @ apart))


def _sets(chosen: list[int], candidates: list[int]) -> list[list[int]]:
    """The chosen set, and with one shape more, less, or another in its place; none is empty."""
    others = [i for i in candidates if i not in chosen]
    smaller = [[i for i in chosen if i != gone] for gone in chosen]
    larger = [[*base, i] for base in (chosen, *smaller) for i in others]
    return [chosen, *(each for each in smaller if each), *larger]


def _is_possible(A: FloatArray, b: FloatArray, shapes: list[int]) -> bool:
    """Whether all levels are positive."""
    return bool(np.all(solve(A[np.ix_(shapes, shapes)], b[shapes]) > 0))


def _evidence(A: FloatArray, b: FloatArray, power: float) -> float:
    s = np.sqrt(power / np.diag(A))
    H, b = A * np.outer(s, s) + np.eye(len(b)), b * s
    return float(0.5 * b @ np.linalg.solve(H, b) - 0.5 * np.linalg.slogdet(H)[1])


def _levels(A: FloatArray, b: FloatArray, shapes: list[int], every: IntArray) -> FloatArray:
    """The levels (n,) of a set of shapes, 0 of all others of `every` (n,)."""
    levels = np.zeros(len(every))
    levels[np.searchsorted(every, shapes)] = solve(A[np.ix_(shapes, shapes)], b[shapes])
    return levels
