"""The array types that signatures speak of; the letters F, Q, n_y, n_u ... in docstrings give their shapes."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]


def frozen(array: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of an array, so that a value that flows through the stages cannot be edited on its way."""
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy
