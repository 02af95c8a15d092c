r"""Fixed points x = F(x) that repetition alone reaches slowly or never.

Anderson's method: the next x is that combination of the last ones whose residuals F(x) - x nearly cancel,

.. math:: x_{k+1} = F(x_k) - \sum_i \gamma_i\, [F(x_{i+1}) - F(x_i)], \qquad
          \gamma = \arg\min \Big| r_k - \sum_i \gamma_i (r_{i+1} - r_i) \Big|, \quad r = F(x) - x

(Anderson, J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elastid.base.arrays import ComplexArray

# Of so many steps differences are combined.
_DEPTH = 5


def fixed_point(
    F: Callable[[ComplexArray], ComplexArray], x: ComplexArray, tolerance: float, limit: int
) -> ComplexArray:
    """x (n,) one step beyond that whose |F(x) - x| is below `tolerance` of the first one, or after `limit` steps."""
    mapped = F(x)
    residual = mapped - x
    first = float(np.linalg.norm(residual))
    of_mapped: list[ComplexArray] = []
    of_residual: list[ComplexArray] = []
    for _ in range(limit - 1):
        if np.linalg.norm(residual) <= tolerance * first:
            break
        before, last = mapped, residual
        x = _combined(mapped, residual, of_mapped, of_residual)
        mapped = F(x)
        residual = mapped - x
        of_mapped = [*of_mapped[1 - _DEPTH :], mapped - before]
        of_residual = [*of_residual[1 - _DEPTH :], residual - last]
    return _combined(mapped, residual, of_mapped, of_residual)


def _combined(
    mapped: ComplexArray, residual: ComplexArray, of_mapped: list[ComplexArray], of_residual: list[ComplexArray]
) -> ComplexArray:
    """The next x (n,) from the last F(x) and its residual, and the steps of both before, oldest first."""
    if not of_residual:
        return mapped
    A = np.array([[np.vdot(a, b).real for b in of_residual] for a in of_residual])
    pull = np.array([np.vdot(a, residual).real for a in of_residual])
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    gamma = np.linalg.lstsq(A / np.outer(size, size), pull / size, rcond=1e-12)[0] / size
    return np.asarray(mapped - sum(g * step for g, step in zip(gamma, of_mapped, strict=True)))
