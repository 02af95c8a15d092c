"""Sums of the residuals of some configurations, here or at workers that have them.

Sums of all configurations are those of chunks of neighbours, added in their order: the same to the last bit wherever
a chunk is worked out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.execution import Execution
from elastid.base.placed import Placed
from elastid.fit.problem.part import Part
from elastid.linear.response.kernel import Kernel
from elastid.parameters import Parameters

# Configurations of a chunk.
CHUNK = 4


@dataclass(frozen=True, eq=False)
class Chunk:
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

    @property
    def bare(self) -> Chunk:
        """Chunk without what is worked out again where it goes."""
        parts = (replace(part, kernel=replace(part.kernel), compressed=None) for part in self.parts)
        return Chunk(self.parameters, tuple(parts))

    def with_models(self, parameters: Parameters, kernels: Sequence[Kernel]) -> Chunk:
        """Chunk with data and weights by other models."""
        pairs = zip(self.parts, kernels, strict=True)
        parts = (replace(part, kernel=kernel, compressed=part.normal.residuals) for part, kernel in pairs)
        return Chunk(parameters, tuple(parts))


def chunked(parameters: Parameters, parts: tuple[Part, ...]) -> tuple[Chunk, ...]:
    """All configurations in chunks of neighbours."""
    return tuple(Chunk(parameters, parts[first : first + CHUNK]) for first in range(0, len(parts), CHUNK))


class PlacedChunks:
    """All configurations at workers as long as a fit holds this; to another process it goes as None."""

    def __init__(self, parameters: Parameters, parts: tuple[Part, ...], execution: Execution) -> None:
        self._parameters, self._parts = parameters, parts
        self.items = Placed([chunk.bare for chunk in chunked(parameters, parts)], execution)

    def is_of(self, parameters: Parameters, parts: tuple[Part, ...]) -> bool:
        """True if these are there."""
        return parameters is self._parameters and parts is self._parts

    def move(self, parameters: Parameters, parts: tuple[Part, ...]) -> None:
        """Other models of the same data and weights take the place of those that are there."""
        bare = [chunk.bare for chunk in chunked(parameters, parts)]
        kernels = [[part.kernel for part in chunk.parts] for chunk in bare]
        moves = [partial(Chunk.with_models, parameters=parameters, kernels=each) for each in kernels]
        self.items.change(bare, moves)
        self._parameters, self._parts = parameters, parts

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()
