"""Stacks of matrices (F, n, m), one for each line."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray


def transposed(A: ComplexArray) -> ComplexArray:
    """A^T of each matrix."""
    return np.swapaxes(A, -1, -2)


def adjoint(A: ComplexArray) -> ComplexArray:
    """A^H of each matrix."""
    return np.asarray(np.swapaxes(A, -1, -2).conj())


def squared_magnitude(A: ComplexArray) -> FloatArray:
    """|A|^2 of each element, without the root that its magnitude costs."""
    return np.asarray(A.real**2 + A.imag**2)


def power(A: ComplexArray) -> FloatArray:
    """Diagonal (F, n) of each positive semidefinite matrix: real, and no less than zero but for rounding."""
    return np.asarray(np.maximum(np.einsum("fii->fi", A).real, 0.0))


def added(terms: Iterable[ComplexArray]) -> ComplexArray:
    """The sum of the terms, two of them in memory at a time."""
    return reduce(np.add, terms)
