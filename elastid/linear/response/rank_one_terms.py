r"""The derivatives of Z = K + s D + s^2 M as sums of terms of rank one.

.. math:: \partial Z / \partial \theta_p = \sum_t s^{k_t} \sigma_t\, y_t y_t^T
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.linear.linear_model import Slope

# Eigenvalues of a slope below this part of its largest are rounding.
RANK_TOLERANCE = 1e-12


@dataclass(frozen=True)
class RankOneTerms:
    """dZ of the parameters with the same number n_t of terms: power, sigma, direction (columns of Y), each (P_g, n_t).

    members (P_g,): their places among the wanted parameters.
    """

    members: IntArray
    power: IntArray
    sigma: FloatArray
    direction: IntArray


def rank_one_terms(slopes: Sequence[Slope], n: int) -> tuple[FloatArray, tuple[RankOneTerms, ...]]:
    """Y (n, n_d) of the terms of all slopes (P), each direction once, and the slopes in groups of as many terms."""
    found: dict[int, list[tuple[int, float]]] = {}
    directions: list[FloatArray] = []
    for place, slope in enumerate(slopes):
        for power, matrix in enumerate((slope.K, slope.D, slope.M)):
            for sigma, y in rank_one_parts(matrix) if matrix is not None else ():
                found.setdefault(place, []).append((power, sigma))
                directions.append(y)
    stacked = np.array(directions).reshape(-1, n)
    # A spring and its damper have the same direction: Y X is computed once for both.
    _, first, same = np.unique(np.round(stacked, 12), axis=0, return_index=True, return_inverse=True)
    ends = np.cumsum([len(parts) for parts in found.values()])
    rows = dict(zip(found, np.split(same.reshape(-1), ends[:-1]), strict=False))
    return stacked[first].T, tuple(_grouped(found, rows))


def _grouped(found: Mapping[int, list[tuple[int, float]]], rows: Mapping[int, IntArray]) -> Iterator[RankOneTerms]:
    for count in sorted({len(parts) for parts in found.values()}):
        members = [place for place, parts in found.items() if len(parts) == count]
        yield RankOneTerms(
            members=np.array(members),
            power=np.array([[power for power, _ in found[place]] for place in members]),
            sigma=np.array([[sigma for _, sigma in found[place]] for place in members]),
            direction=np.array([rows[place] for place in members]),
        )


def rank_one_parts(matrix: FloatArray) -> list[tuple[float, FloatArray]]:
    """A symmetric matrix as sum sigma y y^T, y of length one and of a definite sign."""
    eigenvalues, vectors = np.linalg.eigh(matrix)
    keep = np.flatnonzero(np.abs(eigenvalues) > RANK_TOLERANCE * np.abs(eigenvalues).max())
    return [(float(eigenvalues[i]), _with_sign(vectors[:, i])) for i in keep]


def as_rank_one(matrix: FloatArray) -> tuple[float, FloatArray] | None:
    """sigma = +-1 and y of a symmetric matrix sigma y y^T; None where it is of a higher rank."""
    i = int(np.argmax(np.abs(matrix.diagonal())))
    largest = float(matrix[i, i])
    if not largest:
        return None
    y = matrix[:, i] / np.sqrt(abs(largest))
    sigma = float(np.sign(largest))
    is_all = np.abs(matrix - sigma * np.outer(y, y)).max() <= RANK_TOLERANCE * abs(largest)
    return (sigma, y) if is_all else None


def _with_sign(y: FloatArray) -> FloatArray:
    leading = y[np.argmax(np.abs(y) > 0.5 * np.abs(y).max())]
    return y if leading > 0 else -y
