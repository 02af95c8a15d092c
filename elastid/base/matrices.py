"""Products, inverses and singular values of stacks of matrices (F, n, m), one matrix per line: in C, or with NumPy."""

from collections.abc import Sequence
from functools import reduce
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.kernels import call, is_compiled

Stacks: TypeAlias = Sequence[ComplexArray]  # one stack for each block of data


def squared_magnitude(A: ComplexArray) -> FloatArray:
    """Return |A|^2 of each element of A (...), without the square root of np.abs."""
    return A.real**2 + A.imag**2


def power(A: ComplexArray) -> FloatArray:
    """Return the real diagonal (F, n) of each positive semidefinite matrix, with 0 for negative rounding errors."""
    return np.asarray(np.maximum(np.einsum("fii->fi", A).real, 0.0))


def added_products(A: Stacks, B: Stacks) -> ComplexArray:
    """Return sum over blocks of A B (F, n, m), A (F, n, k) and B (F, k, m)."""
    if is_compiled():
        return _sum_of_products(A, [b.mT for b in B], -1)
    return reduce(np.add, (a @ b for a, b in zip(A, B, strict=True)))


def added_cross_products(A: Stacks, B: Stacks) -> ComplexArray:
    """Return sum over blocks of A B^H (F, n, m), A (F, n, k) and B (F, m, k)."""
    if is_compiled():
        return _sum_of_products(A, B, 1)
    return added_products(A, [b.mT.conj() for b in B])


def added_error_products(Y: Stacks, G: ComplexArray, U: Stacks) -> ComplexArray:
    """Return sum over blocks of D D^H (F, n, n), D = Y - G U."""
    if is_compiled():
        return _sum_of_products(Y, U, 1, G)
    D = [y - G @ u for y, u in zip(Y, U, strict=True)]
    return added_cross_products(D, D)


def inverse(A: ComplexArray) -> ComplexArray:
    """Invert each matrix of A (..., n, n); raise LinAlgError for a singular matrix."""
    F, n, _ = A.shape
    if not is_compiled():
        return np.asarray(np.linalg.inv(A), np.complex128)
    addresses, inverses, n_singular = _memory([A]), np.empty(A.shape, np.complex128), np.zeros(1, np.int64)
    call("inverse", F, n, addresses, inverses, n_singular)
    if n_singular[0]:
        raise np.linalg.LinAlgError("Singular matrix")
    return inverses


def singular_values(A: ComplexArray) -> FloatArray:
    """Return singular values (F, min(n, m)) of each matrix, largest first."""
    F, n, m = A.shape
    if not is_compiled():
        return np.asarray(np.linalg.svd(A, compute_uv=False), np.float64)
    addresses, values = _memory([A if m <= n else A.mT]), np.empty((F, min(n, m)))
    call("singular_values", F, max(n, m), min(n, m), addresses, values)
    return np.sort(values)[:, ::-1]


def positive(A: ComplexArray) -> ComplexArray:
    """Return the nearest positive semidefinite matrix of each Hermitian A (F, n, n)."""
    value, vector = np.linalg.eigh(A)
    return np.asarray((vector * np.maximum(value, 0.0)[:, None, :]) @ vector.mT.conj())


def _sum_of_products(A: Stacks, B: Stacks, sign: int, G: ComplexArray | None = None) -> ComplexArray:
    """Return the sum over blocks of A B^H (sign 1) or A B^T (sign -1); with G the sum of D D^H, D = A - G B."""
    k, (F, n, _), m = [a.shape[2] for a in A], A[0].shape, B[0].shape[1]
    total, gain = np.empty((F, n, m if G is None else n), np.complex128), None if G is None else _memory([G])
    call("sum_of_products", F, n, m, len(A), max(k), np.array(k), _memory(A), _memory(B), gain, sign, total)
    return total


def _memory(stacks: Stacks) -> IntArray:
    """Return the address of each stack, and its strides by line, row and column, in numbers; TypeError by dtype."""
    if any(stack.dtype != np.complex128 for stack in stacks):
        raise TypeError(f"the kernels read complex128, not {', '.join(str(stack.dtype) for stack in stacks)}")
    return np.array([(stack.ctypes.data, *(stride // stack.itemsize for stride in stack.strides)) for stack in stacks])
