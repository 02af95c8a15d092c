r"""The fitted robot about many postures: matrices of what can move, and their slopes to the parameters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import StudyError
from elastid.fit.posture import Family
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import known_axes
from elastid.linear.linear_model import Slope
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration

CHUNK = 128  # postures at a time, so that their slopes stay in the cache


@dataclass(frozen=True, eq=False)
class Linearised:
    """P postures with an equilibrium: matrices (P, n, n), J (P, 6, n) of the frame in the axes of the family.

    slopes: dM, dD, dK (P, n_k, n, n) and dJ (P, n_k, 6, n) to the n_k numbers that x moves.  of_x (n_k, n_d): these per
    standard deviation of x along each independent direction.  found (P_asked,): which postures have an equilibrium.
    position (P, 3): of the frame.  strain_c (P, n_s), strain_b (P, n_s, n): energy of the springs.
    """

    M: FloatArray
    D: FloatArray
    K: FloatArray
    J: FloatArray
    dM: FloatArray
    dD: FloatArray
    dK: FloatArray
    dJ: FloatArray
    strain_c: FloatArray
    strain_b: FloatArray
    position: FloatArray
    of_x: FloatArray
    found: BoolArray


def linearised(family: Family, angles: FloatArray) -> Iterator[Linearised]:
    """Linearisations of a family about angles (P, n_u), in pieces of at most CHUNK postures."""
    for first in range(0, len(angles), CHUNK):
        yield _about(family, angles[first : first + CHUNK])


def _about(family: Family, angles: FloatArray) -> Linearised:
    """Linearisations; no matrices where no posture has an equilibrium."""
    known, found = family.estimated, np.zeros(len(angles), bool)
    rows: list[list[FloatArray]] = [[] for _ in range(10)]
    q = []
    for i, own in enumerate(angles):
        configuration = Configuration("posture", own, family.asked.payload is not False)
        try:
            linear = family.at(configuration).whole
            point = equilibrium(family.model, family.theta, configuration)
        except StudyError:
            continue
        found[i] = True
        q.append(point.q[: len(family.robot.joints)])
        slopes = [linear.slopes.get(known.names[row], Slope()) for row in known.moved]
        matrices = (linear.M, linear.D, linear.K, linear.C[-6:])
        of_theta = [
            np.array([np.zeros_like(matrix) if each is None else each[-len(matrix) :] for each in parts])
            for matrix, *parts in zip(matrices, *((s.M, s.D, s.K, s.C) for s in slopes), strict=True)
        ]
        c, b = (part.full() for part in family.model.strain(point.q, family.theta))
        for row, part in zip(rows, (*matrices, *of_theta, c[:, 0], b @ np.asarray(linear.Z)), strict=True):
            row.append(part)
    M, D, K, J, dM, dD, dK, dJ, strain_c, strain_b = map(np.array, rows)
    robot, of_x = family.model.robot_at(family.theta), known.slopes[known.moved] @ known_axes(known.covariance).T
    position = frame_poses(robot, np.array(q), family.frame).position if q else np.zeros((0, 3))
    return Linearised(M, D, K, J, dM, dD, dK, dJ, strain_c, strain_b, position, of_x, found)
