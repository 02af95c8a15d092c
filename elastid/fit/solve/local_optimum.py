"""LocalOptimum: where a solve ended."""

from __future__ import annotations

from elastid.base.arrays import FloatArray, frozen_value


@frozen_value
class LocalOptimum:
    """The end of a solve: its start and its end in x (n_x,), V there, and the message of the solver."""

    x_start: FloatArray
    x: FloatArray
    cost: float
    iterations: int
    converged: bool
    message: str
