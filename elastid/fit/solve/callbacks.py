"""CasADi functions that evaluate Python functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import casadi as ca

Outputs: TypeAlias = list[ca.DM]
# A name and a sparsity for each argument or result.
Signature: TypeAlias = list[tuple[str, ca.Sparsity]]


class Callback(ca.Callback):
    """A CasADi function that evaluates a Python function; CasADi deletes one that goes out of scope."""

    def __init__(
        self, name: str, inputs: Signature, outputs: Signature, function: Callable[[Sequence[ca.DM]], Outputs]
    ) -> None:
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Number of arguments."""
        return len(self.inputs)

    def get_n_out(self) -> int:
        """Number of results."""
        return len(self.outputs)

    def get_name_in(self, i: int) -> str:
        """Name of an argument."""
        return self.inputs[i][0]

    def get_name_out(self, i: int) -> str:
        """Name of a result."""
        return self.outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Sparsity of an argument."""
        return self.inputs[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Sparsity of a result."""
        return self.outputs[i][1]

    def eval(self, arguments: Sequence[ca.DM]) -> Outputs:
        """The results."""
        return self.function(arguments)


def vector(n: int) -> ca.Sparsity:
    """A dense column."""
    return ca.Sparsity.dense(n, 1)
