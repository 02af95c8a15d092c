"""LocalOptimum: where a solve ended."""

from __future__ import annotations

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.label import labelled


@frozen_value
class LocalOptimum:
    """The end of a solve: its start and its end in x (n_x,), V there, and the message of the solver."""

    x_start: FloatArray = labelled("variables of the solver at the start")
    x: FloatArray = labelled("variables of the solver at the optimum")
    cost: float = labelled("V at the optimum")
    iterations: int
    converged: bool
    message: str
