"""Evaluation of CasADi functions on NumPy arrays: faster than conversion from and to CasADi matrices."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray


def evaluated(
    function: ca.Function, arguments: Sequence[FloatArray], shapes: Sequence[tuple[int, ...]]
) -> list[FloatArray]:
    """Evaluate a function to arrays of the given shapes, transposed: rows are columns of its outputs."""
    results = [np.empty(shape) for shape in shapes]
    buffer: Any  # its type stub requires a size; deleted at the end of the scope
    buffer, evaluate = function.buffer()
    arguments = [np.ascontiguousarray(values, np.float64) for values in arguments]
    for setter, arrays in ((buffer.set_arg, arguments), (buffer.set_res, results)):
        for i, values in enumerate(arrays):
            setter(i, values.data)
    evaluate()
    return results


def evaluate_rows(function: ca.Function, *rows: FloatArray) -> tuple[FloatArray, ...]:
    """Return the outputs (L, m, n) of a function of vectors for all rows (L, .) of its arguments.

    Of a sparse output the numbers (L, nnz) that are not zero.
    """
    L, outputs = len(rows[0]), map(function.sparsity_out, range(function.n_out()))
    shapes = [(L, *reversed(output.shape)) if output.is_dense() else (L, output.nnz()) for output in outputs]
    results = evaluated(_for_rows(function, L), rows, shapes)
    return tuple(values.swapaxes(1, 2) if values.ndim > 2 else values for values in results)


_for_rows = lru_cache(maxsize=16)(ca.Function.map)
