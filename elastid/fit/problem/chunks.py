"""Sums of the residuals of some configurations, here or at workers that have them.

Sums of all configurations are those of chunks of neighbours, added in their order: the same to the last bit wherever
a chunk is worked out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.execution import HERE, Execution
from elastid.base.kept import Kept
from elastid.fit.problem.part import Part
from elastid.parameters import Parameters
from elastid.response import Response

# Configurations of a chunk.
CHUNK = 4
# Lines of all configurations from which on an evaluation is worth the work of others.
MIN_LINES = 5_000
Item = TypeVar("Item")
Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class Chunk(Kept):
    """Some configurations over one set of parameters."""

    parameters: Parameters
    parts: tuple[Part, ...]

    def sums(self, x: FloatArray, precision: type[np.floating[Any]]) -> tuple[float, FloatArray, FloatArray]:
        """V, J^T r (n_x,) and J^T J (n_x, n_x) at x; precision: of J^T J."""
        V, g, A = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
        with np.errstate(all="ignore"):
            for group in self._groups:
                theta, T = group[0].theta(self.parameters, x), group[0].chain(self.parameters, x)
                costs, gradients, normals = zip(*(part.normal.at(theta, precision) for part in group), strict=True)
                V, g, A = V + sum(costs), g + T.T @ sum(gradients), A + T.T @ sum(normals) @ T
        return V, g, A

    @cached_property
    def _groups(self) -> tuple[tuple[Part, ...], ...]:
        """The parts in groups with the same theta and the same wanted parameters at any x."""
        groups: dict[tuple[str, tuple[str, ...]], list[Part]] = {}
        for part in self.parts:
            own = self.parameters.configuration_of_its_own(part.configuration)
            groups.setdefault((own, part.kernel.wanted), []).append(part)
        return tuple(map(tuple, groups.values()))


def chunked(items: Sequence[Item]) -> list[tuple[Item, ...]]:
    """What belongs to each configuration in chunks of neighbours."""
    return [tuple(items[first : first + CHUNK]) for first in range(0, len(items), CHUNK)]


def home_of(responses: Sequence[Response], execution: Execution) -> Execution:
    """Who evaluates the chunks of all configurations: others where these are many, else starts are shared."""
    is_large = sum(response.n_lines for response in responses) >= MIN_LINES
    is_large &= len(chunked(responses)) >= 2 * execution.jobs
    return Execution(execution.jobs) if is_large and execution.is_shared(len(responses)) else HERE


def each_at_home(function: Callable[[Item], Value], items: Sequence[Item], home: Execution) -> list[Value]:
    """[function(item) for item in items], what belongs to each configuration where its chunk is."""
    return [value for values in home.at_home(partial(_each, function), chunked(items)) for value in values]


def _each(function: Callable[[Item], Value], chunk: Sequence[Item]) -> list[Value]:
    return [function(item) for item in chunk]
