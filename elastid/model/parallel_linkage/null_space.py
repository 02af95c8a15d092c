r"""Dependent coordinates of loops by pivots of Phi, and the motions that the constraints leave free.

.. math:: \Phi\, \dot q = 0 \iff \dot q = Z \dot y, \qquad \Phi Z = 0

Constraints may be redundant (a planar loop closed in space): redundant rows have no pivot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.model.elastic import ElasticModel

# A singular value or a pivot below this part of the largest is zero.
RANK_TOLERANCE = 1e-9
# Of a pivot beside its row; smaller ones are taken only where the preferred dependent coordinates are used up.
MIN_PIVOT = 0.05


@dataclass(frozen=True)
class Partition:
    """rows, dependent (n_r,): pivots, in the order of elimination.  independent (n_q - n_r,): the other coordinates."""

    rows: IntArray
    dependent: IntArray
    independent: IntArray

    def basis(self, Phi: FloatArray) -> FloatArray:
        """Z (n_q, n_q - n_r) of Phi (n_c, n_q): the unit matrix for the independent coordinates."""
        Z = np.zeros((Phi.shape[1], len(self.independent)))
        Z[self.independent, range(len(self.independent))] = 1.0
        rows = Phi[self.rows]
        Z[self.dependent] = -np.linalg.solve(rows[:, self.dependent], rows[:, self.independent])
        return Z


def partition(model: ElasticModel, Phi: FloatArray) -> Partition:
    """Pivots of Phi (n_c, n_q) with complete pivoting, the loops' own coordinates before those that motors drive.

    Raises StudyError where the coordinates that a minimal formulation asks for are not independent.
    """
    chosen = model.independent or ()
    tier = np.array([_tier(model, name) for name in model.coordinates])
    allowed = ~np.isin(model.coordinates, chosen)
    rows: list[int] = []
    dependent: list[int] = []
    scale = np.abs(Phi).max(axis=1, initial=0.0, keepdims=True)
    A = Phi / np.where(scale > 0, scale, 1.0)
    rank = np.linalg.matrix_rank(Phi, tol=RANK_TOLERANCE * np.abs(Phi).max(initial=0.0)) if Phi.size else 0
    passes = [(tier <= last) & allowed for last in range(int(tier.max()) + 1)]
    for least, columns in [*((MIN_PIVOT, columns) for columns in passes), (RANK_TOLERANCE, passes[-1])]:
        while len(rows) < rank:
            size = np.abs(A) * columns
            size[rows] = 0.0
            row, column = np.unravel_index(int(np.argmax(size)), size.shape)
            if size[row, column] <= least:
                break
            others = np.setdiff1d(np.arange(len(A)), [*rows, row])
            A[others] -= np.outer(A[others, column] / A[row, column], A[row])
            rows.append(int(row))
            dependent.append(int(column))
    if len(rows) < rank or (chosen and len(chosen) != model.n_q - rank):
        raise StudyError(_dependent(model, chosen, int(rank), len(rows)))
    independent = np.setdiff1d(np.arange(model.n_q), dependent)
    return Partition(np.array(rows, np.int64), np.array(dependent, np.int64), independent)


def _tier(model: ElasticModel, coordinate: str) -> int:
    """0: elongations of rods and joints that nothing holds; then elastic joints, geared joints, motors."""
    kind, _, name = coordinate.partition(" ")
    if kind == "rod":
        return 0
    joint = next(joint for joint in model.robot.joints if joint.name == name)
    if kind == "joint" and joint.is_passive:
        return 1
    if joint.motor is None:
        return 2
    return 3 if kind == "joint" and joint in model.robot.flexible else 4


def _dependent(model: ElasticModel, chosen: Sequence[str], rank: int, reached: int) -> str:
    needed = model.n_q - rank
    if len(chosen) != needed:
        return (
            f"model.independent names {len(chosen)} coordinates, but {model.n_q} coordinates with {rank} independent "
            f"constraints leave {needed}; there are {', '.join(model.coordinates)}"
            + ("" if rank else " (elastic rods are cut and determine none of them)")
        )
    return (
        f"model.independent: {', '.join(chosen)} are not independent here: with them held, the loops leave "
        f"{rank - reached} of the other coordinates free; choose others, or leave the choice to the rank"
    )


def motions(model: ElasticModel, Phi: FloatArray) -> FloatArray:
    """Z (n_q, n): columns span the null space of Phi (n_c, n_q); orthonormal, or of the independent coordinates."""
    if model.independent is not None and (Phi.size or model.independent):
        return partition(model, Phi).basis(Phi)
    return null_space(Phi)


def null_space(Phi: FloatArray) -> FloatArray:
    """Z (n_q, n), orthonormal columns, of Phi (n_c, n_q); the unit matrix where there is no constraint."""
    if not Phi.size:
        return np.eye(Phi.shape[1])
    _, s, Vt = np.linalg.svd(Phi)
    rank = int(np.sum(s > RANK_TOLERANCE * s.max()))
    return Vt[rank:].T
