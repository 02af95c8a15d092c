"""Parameters in exported files, in full precision, with intervals if fitted."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from elastid.fit.fitted_robot import FittedRobot, parameters_of
from elastid.fit.result import Result
from elastid.parameters import Parameter

FIXED = "fixed, not identified"


def in_full(values: Iterable[float], separator: str = " ") -> str:
    """Format numbers in full precision, joined by a separator."""
    return separator.join(repr(float(value)) for value in values)


def c_row(values: Iterable[float]) -> str:
    """Format numbers as the initial value of an array in C."""
    return "{" + in_full(values, ", ") + "}"


@dataclass(frozen=True)
class KnownNumber:
    """A number of the model in SI with its std and 95 % interval, NaN if it was fixed or tied.

    name: of the number in the model.  std_noise, std_prior, std_systematic: contributions to std; NaN: exact robot
    model.
    interval_text: its interval, or why there is none.
    """

    name: str
    unit: str
    value: float
    interval_text: str
    std: float = math.nan
    low: float = math.nan
    high: float = math.nan
    std_noise: float = math.nan
    std_prior: float = math.nan
    std_systematic: float = math.nan

    @property
    def row(self) -> dict[str, float]:
        """The columns of a table of numbers, as all files name them."""
        names = ("value", "std", "lower_95", "upper_95", "std_noise", "std_prior", "std_systematic")
        numbers = (self.value, self.std, self.low, self.high, self.std_noise, self.std_prior, self.std_systematic)
        return dict(zip(names, numbers, strict=True))


def known_numbers(model: FittedRobot) -> tuple[KnownNumber, ...]:
    """Return numbers of every parameter of a fitted model, in the order of the fit."""
    return tuple(_known_number(model.result, parameter) for parameter in model.parameters)


def interval_lines(model: FittedRobot) -> tuple[str, ...]:
    """Return `lines_of` a fitted model."""
    return lines_of(model.result, model.measured[0].configuration.name)


def lines_of(result: Result, configuration: str) -> tuple[str, ...]:
    """Return the header of an exported file: status of the fit, then a row per free parameter."""
    candidates = [_known_number(result, parameter) for parameter in parameters_of(result, configuration)]
    numbers = [number for number in candidates if number.interval_text != FIXED]
    status = result.status.replace("_", " ")
    head = f"Numbers of the fit ({status}), SI, with standard deviation and 95 % interval; all others were fixed:"
    rows = [f"  {number.name} = {number.value:.9g} {number.unit}, {number.interval_text}" for number in numbers]
    presliding = [
        f"  {f.place}: presliding friction of {f.stiffness:.3g} {f.unit} relaxing at {f.rate:.3g} 1/s was estimated "
        "too, and is not part of this file. Do not use the Coulomb torque of this motor"
        for f in result.presliding
        if f.stiffness > 0
    ]
    return head, *rows, *presliding


def _known_number(result: Result, parameter: Parameter) -> KnownNumber:
    number = parameter.stands_for, parameter.unit, result.values[parameter.name]
    if not parameter.is_free:
        tie = parameter.tie
        words = FIXED if tie is None else f"tied to {tie.to}{f' and {tie.by}' if tie.by else ''}"
        return KnownNumber(*number, words)
    std, (low, high) = result.std[parameter.name], result.interval(parameter.name)
    words = f"std {std:.3g}, {low:.6g} to {high:.6g}" if math.isfinite(std) else "free, but not constrained by the data"
    if parameter.is_nuisance:
        return KnownNumber(*number, f"within its tolerance, {words}", std, low, high)
    stds = [stds_of[parameter.name] for stds_of in result.std_contributions.values()]
    if stds:
        words = "{} (noise {:.3g}, prior {:.3g}, systematic {:.3g})".format(words, *stds)
    return KnownNumber(*number, words, std, low, high, *stds)
