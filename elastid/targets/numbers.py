"""Parameters of a fitted model in exported files, in full precision, with intervals."""

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


# Columns of a table of numbers in all files.
COLUMNS = ("value", "std", "lower_95", "upper_95", "std_noise", "std_prior", "std_systematic")


@dataclass(frozen=True)
class ExportedNumber:
    """Parameter of the model in SI with std and 95 % interval, NaN if it was fixed or tied.

    interval_text: the interval, or the reason why there is none.  std_noise, std_prior, std_systematic: contributions
    to std, NaN for an exact robot model.
    """

    name: str
    unit: str
    value: float
    interval_text: str
    std: float = math.nan
    lower_95: float = math.nan
    upper_95: float = math.nan
    std_noise: float = math.nan
    std_prior: float = math.nan
    std_systematic: float = math.nan

    @property
    def row(self) -> dict[str, float]:
        """Values by `COLUMNS`."""
        return {name: getattr(self, name) for name in COLUMNS}


def exported_numbers(model: FittedRobot) -> tuple[ExportedNumber, ...]:
    """Return every parameter of a fitted model, in the order of the fit."""
    return tuple(_exported_number(model.result, parameter) for parameter in model.parameters)


def interval_lines(model: FittedRobot) -> tuple[str, ...]:
    """Return the `header_lines` of a fitted model."""
    return header_lines(model.result, model.measured[0].configuration.name)


def header_lines(result: Result, configuration: str) -> tuple[str, ...]:
    """Return the header of an exported file: status of the fit, then a line per free parameter of a configuration."""
    all_numbers = [_exported_number(result, parameter) for parameter in parameters_of(result, configuration)]
    numbers = [number for number in all_numbers if number.interval_text != FIXED]
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


def _exported_number(result: Result, parameter: Parameter) -> ExportedNumber:
    number = parameter.stands_for, parameter.unit, result.values[parameter.name]
    if not parameter.is_free:
        tie = parameter.tie
        text = FIXED if tie is None else f"tied to {tie.to}{f' and {tie.by}' if tie.by else ''}"
        return ExportedNumber(*number, text)
    std, (low, high) = result.std[parameter.name], result.interval(parameter.name)
    text = f"std {std:.3g}, {low:.6g} to {high:.6g}" if math.isfinite(std) else "free, but not constrained by the data"
    if parameter.is_nuisance:
        return ExportedNumber(*number, f"within its tolerance, {text}", std, low, high)
    stds = [stds_of[parameter.name] for stds_of in result.std_contributions.values()]
    if stds:
        text = "{} (noise {:.3g}, prior {:.3g}, systematic {:.3g})".format(text, *stds)
    return ExportedNumber(*number, text, std, low, high, *stds)
