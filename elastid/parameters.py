"""Parameters: names and SI values for people, a vector x of free (mostly logarithmic) variables for solvers.

    theta = expand(x):   theta_p = exp(x_i) for a logarithmic one, x_i for a linear one, factor * theta_q for a tied one

Positive parameters (stiffness, damping, inertia) are optimised as ln p: positivity is free and std(x) is the relative
standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Tie:
    """This parameter is `factor` times another: theta_p = factor * theta_to."""

    to: str
    factor: float = 1.0


@dataclass(frozen=True)
class Prior:
    """What is known before the data: a normal distribution in the solver's variable x.

    mean in SI; std in SI for a linear parameter, relative (0.1 = 10 %) for a logarithmic one.
    """

    mean: float
    std: float

    def __post_init__(self) -> None:
        """Refuse a prior without spread: that is a fixed parameter."""
        if not self.std > 0:
            raise ValueError(f"the prior's std is {self.std:g}; it must be positive (fix the parameter instead)")


@dataclass(frozen=True)
class Parameter:
    """One scalar of the model, in SI: value is its start or its fixed value.

    Raises ValueError where bounds exclude the value or a logarithmic parameter could reach zero.
    """

    name: str
    value: float
    unit: str = "1"
    lower: float = -math.inf
    upper: float = math.inf
    log: bool = False
    free: bool = True
    tie: Tie | None = None
    prior: Prior | None = None

    def __post_init__(self) -> None:
        """Check that value, bounds and scale agree."""
        if not math.isfinite(self.value):
            raise ValueError(f"{self.name}: value {self.value} is not finite")
        if self.lower >= self.upper:
            raise ValueError(f"{self.name}: the lower bound {self.lower:g} is not below the upper bound {self.upper:g}")
        if self.is_free and not self.lower <= self.value <= self.upper:
            raise ValueError(
                f"{self.name}: the start {self.value:g} {self.unit} is outside its bounds "
                f"[{self.lower:g}, {self.upper:g}]; widen the bounds or move the start"
            )
        if self.log and self.is_free and not self.value > 0:
            raise ValueError(f"{self.name}: the start {self.value:g} {self.unit} must be positive")

    @property
    def is_free(self) -> bool:
        """Whether the solver has a variable for it: neither fixed nor tied."""
        return self.free and self.tie is None

    def to_x(self, value: float) -> float:
        """The solver's variable of an SI value."""
        if not self.log:
            return value
        return math.log(value) if value > 0 else -math.inf


@dataclass(frozen=True)
class ParameterSet:
    """All parameters of a model in a fixed order: theta (n_theta,) in SI against x (n_x,) of the free ones.

    Raises ValueError for a name given twice, a tie to an unknown, fixed-to-itself or tied parameter.
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        """Check names and ties."""
        names = self.names
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"parameter {name} is given twice")
        for parameter in self.parameters:
            if parameter.tie is None:
                continue
            if parameter.tie.to not in names:
                raise ValueError(f"{parameter.name} is tied to {parameter.tie.to}, which is not a parameter: {names}")
            if self[parameter.tie.to].tie is not None:
                raise ValueError(f"{parameter.name} is tied to {parameter.tie.to}, which is tied itself")

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __getitem__(self, name: str) -> Parameter:
        return self.parameters[self.index(name)]

    def index(self, name: str) -> int:
        """The place of a name in theta; KeyError lists the names there are."""
        try:
            return self.names.index(name)
        except ValueError:
            raise KeyError(f"no parameter {name}; there are {', '.join(self.names)}") from None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names in the order of theta."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """Those with a variable in x, in the order of x."""
        return tuple(parameter for parameter in self.parameters if parameter.is_free)

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names in the order of x."""
        return tuple(parameter.name for parameter in self.free)

    @cached_property
    def moved_names(self) -> tuple[str, ...]:
        """Names of those that x moves, in the order of theta: the free ones and those tied to them."""
        free = self.free_names
        return tuple(p.name for p in self.parameters if (p.name if p.tie is None else p.tie.to) in free)

    @property
    def theta(self) -> FloatArray:
        """Start and fixed values (n_theta,) in SI, ties applied."""
        return self.expand(self.x)

    @property
    def x(self) -> FloatArray:
        """The solver's start (n_x,)."""
        return np.array([parameter.to_x(parameter.value) for parameter in self.free], dtype=float)

    @property
    def x_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds (n_x,) of the solver's variables."""
        lower = np.array([p.to_x(p.lower) for p in self.free], dtype=float)
        upper = np.array([p.to_x(p.upper) for p in self.free], dtype=float)
        return lower, upper

    def expand(self, x: FloatArray) -> FloatArray:
        """theta (n_theta,) in SI of a solver's vector x (n_x,): exponentials and ties applied."""
        constant, gain, _ = self._chain
        return constant + gain @ self._natural(x)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """d theta / d x (n_theta, n_x): theta_p itself for a logarithmic parameter, ties carried along."""
        _, gain, log = self._chain
        return gain * np.where(log, self._natural(x), 1.0)

    def _natural(self, x: FloatArray) -> FloatArray:
        """The free parameters (n_x,) in SI; infinite, not an error, where a solver tries an absurd step."""
        with np.errstate(over="ignore"):
            natural: FloatArray = np.where(self._chain[2], np.exp(x), x)
        return natural

    @cached_property
    def _chain(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """constant (n_theta,), gain (n_theta, n_x), log (n_x,): theta = constant + gain @ natural(x)."""
        columns = {name: i for i, name in enumerate(self.free_names)}
        constant, gain = np.zeros(len(self)), np.zeros((len(self), len(columns)))
        for row, parameter in enumerate(self.parameters):
            source = parameter if parameter.tie is None else self[parameter.tie.to]
            factor = 1.0 if parameter.tie is None else parameter.tie.factor
            if source.name in columns:
                gain[row, columns[source.name]] = factor
            else:
                constant[row] = factor * source.value
        return constant, gain, np.array([p.log for p in self.free], dtype=np.bool_)

    def with_values(self, values: Mapping[str, float]) -> ParameterSet:
        """The same set starting from other SI values."""
        for name in values:
            self.index(name)
        return ParameterSet(
            tuple(replace(p, value=float(values[p.name])) if p.name in values else p for p in self.parameters)
        )

    def as_dict(self, x: FloatArray | None = None) -> dict[str, float]:
        """Names to SI values, at the start or at x."""
        theta = self.theta if x is None else self.expand(x)
        return dict(zip(self.names, theta.tolist(), strict=True))
