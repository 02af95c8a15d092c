"""Parameters: names and SI values for people, a vector x of free (mostly logarithmic) variables for solvers.

    theta = expand(x):   theta_p = exp(x_i) for a logarithmic one, x_i for a linear one,
                         factor * theta_q, or factor * theta_q * theta_r, for a tied one

Positive parameters (stiffness, damping, inertia) are optimised as ln p; std(x) is the relative standard deviation.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen, values_by_name
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import NamedValues, index_of
from elastid.base.names import posture_of
from elastid.base.section import Key, section

DELAY = "delay"  # of the torques, the last entry of theta


@section
class Tie:
    """theta_p = factor theta_to, times theta_by if `by` names a third parameter.

    With a ratio to identify as the third, the dampers of many springs have one loss factor: d = eta k / omega.
    """

    # fmt: off
    to: Annotated[str, Key("Name of the other parameter. A * is replaced as in the key: `d_*: {tie: {to: k_*}}` "
        "ties d_1 to k_1.", "choose the parameter with the smaller interval.")]
    factor: Annotated[float, Key("Factor of the other parameter.", "other than 1 for a known ratio, such as the "
        "squared ratio of two lengths.")] = 1.0
    by: Annotated[str, Key("Name of a ratio under fit.ratios that multiplies the factor (default: no further factor).",
        "for an unknown ratio, such as a common loss factor: with factor 1 / (2 pi f), the loss factor at f.")] = ""
    # fmt: on


@dataclass(frozen=True)
class Prior:
    """Knowledge before the data: a normal distribution in the solver's variable x.

    mean in SI; std in SI for a linear parameter, relative (0.1 = 10 %) for a logarithmic one.
    """

    mean: float
    std: float

    def __post_init__(self) -> None:
        """Refuse a prior without spread: that is a fixed parameter."""
        if not self.std > 0:
            raise ValueError(f"the prior's std is {self.std:g}; it must be positive (fix the parameter instead)")

    def __str__(self) -> str:
        return f"{self.mean:g} ± {self.std:g}"


@dataclass(frozen=True)
class Parameter:
    """One scalar of the model, in SI: value is its start or its fixed value.

    only: configurations in which it stands in for the parameter `stands_for`; `fm_1@warm` for fm_1 there.
    ratio: it is no number of the model but a factor of ties.
    is_nuisance: it is not of interest, and varies within its tolerance only.
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
    only: tuple[str, ...] = ()
    ratio: bool = False
    is_nuisance: bool = False

    def __post_init__(self) -> None:
        """Check that value, bounds and scale agree."""
        if not math.isfinite(self.value):
            raise ValueError(f"{self.name}: value {self.value} is not finite")
        if self.log and self.is_free and not self.value > 0:
            raise ValueError(f"{self.name}: the start {self.value:g} {self.unit} must be positive")
        if self.lower >= self.upper:
            raise ValueError(f"{self.name}: the lower bound {self.lower:g} is not below the upper bound {self.upper:g}")
        if self.is_free and not self.lower <= self.value <= self.upper:
            raise ValueError(
                f"{self.name}: the start {self.value:g} {self.unit} is outside its bounds "
                f"[{self.lower:g}, {self.upper:g}]; widen the bounds or move the start"
            )

    @property
    def is_free(self) -> bool:
        """True if the solver has a variable for it: neither fixed nor tied."""
        return self.free and self.tie is None

    @property
    def is_of_model(self) -> bool:
        """True if it is part of theta, and not a ratio or a stand-in."""
        return not self.only and not self.ratio

    @property
    def stands_for(self) -> str:
        """The parameter of the model that it replaces."""
        return self.name.partition("@")[0]

    def to_x(self, value: float) -> float:
        """Return the solver's variable of an SI value."""
        if not self.log:
            return value
        return math.log(value) if value > 0 else -math.inf


@dataclass(frozen=True, repr=False)
class Parameters:
    """All parameters of a model in a fixed order: theta (n_theta,) in SI, and x (n_x,) of the free ones.

    theta contains the parameters of the model. Ratios and parameters of single configurations are part of x; theta of
    such a configuration uses their values.

    Parameters
    ----------
    parameters : tuple of Parameter
        Name, value (start or fixed), unit, bounds, scale, tie and prior of each.

    Raises
    ------
    ValueError
        For a name that occurs twice, a tie to an unknown, the same or a tied parameter, or two values of one parameter
        in a configuration.

    Examples
    --------
    >>> stiffness = Parameter("k_1", 1.0, "N*m/rad", 0.01, 100.0, log=True)
    >>> parameters = Parameters((stiffness, Parameter("m_arm", 2.0, "kg", free=False)))
    >>> parameters.free_names, parameters.theta.tolist()
    (('k_1',), [1.0, 2.0])
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        """Check names and ties."""
        names = tuple(parameter.name for parameter in self.parameters)
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"parameter {name} is given twice")
        keys = [(p.stands_for, configuration) for p in self.parameters for configuration in p.only]
        for name, configuration in keys:
            if name not in self.names:
                raise ValueError(f"{name}@ in configuration {configuration} is no parameter; parameters: {self.names}")
            if keys.count((name, configuration)) > 1:
                raise ValueError(f"{name} has two values in configuration {configuration}")
        for parameter in self.parameters:
            if parameter.tie is None:
                continue
            for source in (parameter.tie.to, parameter.tie.by):
                if source and source not in names:
                    raise ValueError(f"{parameter.name} is tied to {source}, which is not a parameter: {names}")
                if source and self[source].tie is not None:
                    raise ValueError(f"{parameter.name} is tied to {source}, which is tied itself")

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """The free parameters with start, bounds and prior."""
        headings = ("name", "start", "unit", "bounds", "prior")
        rows = [
            (p.name, f"{p.value:.6g}", p.unit, f"{p.lower:g} to {p.upper:g}", str(p.prior or "")) for p in self.free
        ]
        return Display(f"{len(rows)} of {len(self)} parameters free", headings, rows)

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __getitem__(self, name: str) -> Parameter:
        return self.parameters[index_of(name, [p.name for p in self.parameters], "parameter")]

    def index(self, name: str) -> int:
        """Return the index of a name in theta; UnknownNameError lists the existing names."""
        return index_of(name, self.names, "parameter")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names in the order of theta."""
        return tuple(parameter.name for parameter in self.parameters if parameter.is_of_model)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """Parameters with a variable in x, in its order: parameters of interest, then nuisance parameters."""
        return tuple(sorted((p for p in self.parameters if p.is_free), key=lambda p: p.is_nuisance))

    @property
    def of_interest(self) -> tuple[Parameter, ...]:
        """The first of `free`: all without the nuisance parameters."""
        return tuple(parameter for parameter in self.free if not parameter.is_nuisance)

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names in the order of x."""
        return tuple(parameter.name for parameter in self.free)

    def dependent_names(self, configuration: str = "") -> tuple[str, ...]:
        """List the free and tied parameters of theta that x changes in a configuration, in the order of theta."""
        chain = self._chain(configuration)
        moves = np.any((chain.gain != 0) | (chain.by_gain != 0), axis=1)
        return tuple(name for name, is_moved in zip(self.names, moves, strict=True) if is_moved)

    @property
    def theta(self) -> FloatArray:
        """Start and fixed values (n_theta,) in SI, ties applied."""
        return self.expand(self.x)

    @property
    def x(self) -> FloatArray:
        """Start value (n_x,) of the solver's variables."""
        return self.x_with({})

    def x_with(self, values: Mapping[str, float]) -> FloatArray:
        """Return x (n_x,) with `values` of x by name, and start values of all others."""
        return np.array([values.get(p.name, p.to_x(p.value)) for p in self.free], dtype=float)

    @cached_property
    def x_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds (n_x,) of the solver's variables."""
        return frozen([p.to_x(p.lower) for p in self.free]), frozen([p.to_x(p.upper) for p in self.free])

    def expand(self, x: FloatArray, configuration: str = "") -> FloatArray:
        """Expand a solver's x (n_x,) to theta (n_theta,) in SI in a configuration; applies exponentials and ties."""
        return self._chain(configuration).theta(self.natural(x))

    def jacobian(self, x: FloatArray, configuration: str = "") -> FloatArray:
        """Return d theta / d x (n_theta, n_x), ties included; theta_p itself for a logarithmic parameter."""
        natural = self.natural(x)
        return self._chain(configuration).slopes(natural) * np.where(self.is_log, natural, 1.0)

    def natural(self, x: FloatArray) -> FloatArray:
        """Return the free parameters (..., n_x) in SI; infinite, without an error, for an absurd step of a solver."""
        with np.errstate(over="ignore"):
            return np.where(self.is_log, np.exp(x), x)

    @cached_property
    def is_log(self) -> BoolArray:
        """Flags (n_x,) of the free parameters whose logarithm the solver has."""
        return np.array([p.log for p in self.free], dtype=np.bool_)

    @cached_property
    def prior_slopes(self) -> FloatArray:
        """1 / s (n_x,), s: prior standard deviation of x; 0 without a prior."""
        return np.array([0.0 if p.prior is None else 1 / p.prior.std for p in self.free])

    def priors(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (x - m) / s and 1 / s (n_x,) at x (n_x,), m and s: prior mean and std; 0 without a prior."""
        mean = np.array([0.0 if p.prior is None else p.to_x(p.prior.mean) for p in self.free])
        return (x - mean) * self.prior_slopes, self.prior_slopes

    def _chain(self, configuration: str) -> "_Chain":
        if (local := self.configuration_of_stand_in(configuration)) not in self._chains:
            standing = {p.stands_for: p for p in self.parameters if local in p.only}
            self._chains[local] = _chain([standing.get(name, self[name]) for name in self.names], self)
        return self._chains[local]

    def configuration_of_stand_in(self, configuration: str) -> str:
        """Return the name of a configuration if a parameter has a stand-in for it; empty for all others.

        Of a configuration that is measured at several amplitudes that of its posture, whose parameters are the same.
        """
        return next((name for name in (configuration, posture_of(configuration)) if name in self._stand_ins), "")

    @cached_property
    def _stand_ins(self) -> frozenset[str]:
        return frozenset(name for p in self.parameters for name in p.only)

    @cached_property
    def _chains(self) -> "dict[str, _Chain]":
        return {}

    def with_values(self, values: Mapping[str, float]) -> "Parameters":
        """Replace the starting values by other SI values."""
        for name in values:
            self[name]
        rows = (replace(p, value=float(values[p.name])) if p.name in values else p for p in self.parameters)
        return Parameters(tuple(rows))

    def with_means(self, x: FloatArray) -> "Parameters":
        """Return the parameters for configurations without data: each stand-in becomes its mean at x (n_x,).

        The mean is of the solver's variable: geometric for logarithmic parameters.
        """
        values = self.as_dict(x)

        def with_mean(p: Parameter) -> Parameter:
            groups = [group for group in self.parameters if group.only and group.stands_for == p.name]
            if p.free or p.tie is not None or p.only or not groups:
                return p
            mean = sum(p.to_x(values[group.name]) for group in groups) / len(groups)
            return replace(p, value=math.exp(mean) if p.log else mean)

        return Parameters(tuple(with_mean(p) for p in self.parameters))

    def as_dict(self, x: FloatArray | None = None) -> dict[str, float]:
        """Return SI values by name, at the start or at x; ratios and stand-ins come last."""
        x = self.x if x is None else x
        free = values_by_name(self.free_names, self.natural(x))
        outside = {p.name: free.get(p.name, p.value) for p in self.parameters if not p.is_of_model}
        return NamedValues("parameter", self.numbers(x) | outside)

    def numbers(self, x: FloatArray, configuration: str = "") -> dict[str, float]:
        """Return SI values of the model's parameters by name in a configuration, the delay of torques included."""
        return values_by_name(self.names, self.expand(x, configuration))


@dataclass(frozen=True)
class _Chain:
    """theta = (a_1 + A_1 z) * (a_2 + A_2 z), element by element, z the free parameters in SI."""

    constant: FloatArray
    gain: FloatArray
    by_constant: FloatArray
    by_gain: FloatArray

    def theta(self, z: FloatArray) -> FloatArray:
        """Return theta (n_theta,) of z (n_x,)."""
        return (self.constant + self.gain @ z) * (self.by_constant + self.by_gain @ z)

    def slopes(self, z: FloatArray) -> FloatArray:
        """Return d theta / d z (n_theta, n_x)."""
        value, by = self.constant + self.gain @ z, self.by_constant + self.by_gain @ z
        return self.gain * by[:, None] + value[:, None] * self.by_gain


def _chain(model: list[Parameter], parameters: Parameters) -> _Chain:
    columns = {name: i for i, name in enumerate(parameters.free_names)}
    n, n_x = len(model), len(columns)
    constant, gain = np.zeros(n), np.zeros((n, n_x))
    by_constant, by_gain = np.ones(n), np.zeros((n, n_x))
    for row, parameter in enumerate(model):
        tie = parameter.tie or Tie(parameter.name)
        to = parameters[tie.to]
        if to.name in columns:
            gain[row, columns[to.name]] = tie.factor
        else:
            constant[row] = tie.factor * to.value
        if tie.by in columns:
            by_constant[row], by_gain[row, columns[tie.by]] = 0.0, 1.0
        elif tie.by:
            by_constant[row] = parameters[tie.by].value
    return _Chain(constant, gain, by_constant, by_gain)
