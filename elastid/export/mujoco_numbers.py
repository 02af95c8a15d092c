"""Numbers as MJCF writes them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from elastid.base.arrays import FloatArray

# MuJoCo refuses a moving body without mass or without inertia: negligible kg and kg m^2 of any robot.
MIN_INERTIA = 1e-12


def quaternion(R: FloatArray) -> FloatArray:
    """(w, x, y, z) of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix, with w >= 0."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = R.ravel()
    K = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, yx + xy, zx + xz],
            [xz - zx, yx + xy, yy - xx - zz, zy + yz],
            [yx - xy, zx + xz, zy + yz, zz - xx - yy],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q[0] >= 0 else -q


def numbers(values: Iterable[float]) -> str:
    """Separated by blanks, in full."""
    return " ".join(number(float(value)) for value in values)


def number(value: float) -> str:
    """In full."""
    return repr(float(value))
