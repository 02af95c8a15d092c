"""Units of a study: a plain number is SI, a text such as '2.5 kN*m/rad' comes from a closed table.

`Annotated[float, InUnit("N*m/rad")]` makes a dataclass field read both and refuse every other dimension.
Frequencies are in Hz everywhere; nothing here turns Hz into rad/s.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

# unit: (dimension, factor to SI). Closed on purpose: any other unit is refused with the list of those that fit.
TABLE: dict[str, tuple[str, float]] = {
    "1": ("1", 1.0),
    "%": ("1", 0.01),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", math.pi / 180),
    "rev": ("rad", 2 * math.pi),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180),
    "rpm": ("rad/s", 2 * math.pi / 60),
    "rad/s^2": ("rad/s^2", 1.0),
    "deg/s^2": ("rad/s^2", math.pi / 180),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "N/m": ("N/m", 1.0),
    "kN/m": ("N/m", 1e3),
    "N/mm": ("N/m", 1e3),
    "MN/m": ("N/m", 1e6),
    "N*s/m": ("N*s/m", 1.0),
    "kN*s/m": ("N*s/m", 1e3),
    "N*m": ("N*m", 1.0),
    "mN*m": ("N*m", 1e-3),
    "kN*m": ("N*m", 1e3),
    "A": ("A", 1.0),
    "mA": ("A", 1e-3),
    "N*m/A": ("N*m/A", 1.0),
    "N*m/rad": ("N*m/rad", 1.0),
    "kN*m/rad": ("N*m/rad", 1e3),
    "MN*m/rad": ("N*m/rad", 1e6),
    "N*m/deg": ("N*m/rad", 180 / math.pi),
    "N*m*s/rad": ("N*m*s/rad", 1.0),
    "kN*m*s/rad": ("N*m*s/rad", 1e3),
    "kg": ("kg", 1.0),
    "g": ("kg", 1e-3),
    "kg*m^2": ("kg*m^2", 1.0),
    "g*m^2": ("kg*m^2", 1e-3),
    "kg*cm^2": ("kg*m^2", 1e-4),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "m/s^2": ("m/s^2", 1.0),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "Hz": ("Hz", 1.0),
    "kHz": ("Hz", 1e3),
}

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?$")


def units_of(dimension: str) -> list[str]:
    """The names in the table that measure a dimension, named by its SI unit."""
    return [name for name, (measures, _) in TABLE.items() if measures == dimension]


def factor(unit: str, dimension: str) -> float:
    """How many SI units one `unit` is; ValueError where it is unknown or measures something else.

    >>> factor("rpm", "rad/s") == 2 * math.pi / 60
    True
    """
    fitting = ", ".join(units_of(dimension))
    if unit not in TABLE:
        raise ValueError(f"unknown unit '{unit}'; units that fit here: {fitting}")
    measures, scale = TABLE[unit]
    if measures != dimension:
        raise ValueError(f"unit '{unit}' measures {measures}, not {dimension}; units that fit here: {fitting}")
    return scale


def to_si(value: Any, dimension: str) -> float:
    """A number (SI) or a text '2.5 kN*m/rad' as a float in SI; ValueError names what would fit.

    >>> to_si("2.5 kN*m/rad", "N*m/rad")
    2500.0
    >>> to_si(3, "N*m/rad")
    3.0
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"expected a number in {dimension} or a text such as '1 {dimension}'")
    if isinstance(value, str):
        match = _QUANTITY.match(value)
        if match is None:
            raise ValueError(f"'{value}' is not a number with a unit; write for example '1 {dimension}'")
        number, unit = match.groups()
        value = float(number) * (factor(unit.strip(), dimension) if unit else 1.0)
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number in {dimension}")
    return float(value)


@dataclass(frozen=True)
class InUnit:
    """Marks a float field with its SI unit; the study loader reads numbers and texts with units through it."""

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """How pydantic validates the field; imported here so that value types stay free of pydantic."""
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(
            lambda value: to_si(value, self.unit),
            metadata={"pydantic_js_functions": []},
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """A number in SI, or a text with one of the units that fit."""
        names = "|".join(re.escape(name) for name in units_of(self.unit))
        return {
            "description": f"in {self.unit}, or a text with a unit: {', '.join(units_of(self.unit))}",
            "anyOf": [{"type": "number"}, {"type": "string", "pattern": rf"^\s*[-+0-9.eE]+\s*({names})?$"}],
        }


Angle: TypeAlias = Annotated[float, InUnit("rad")]
AngularAcceleration: TypeAlias = Annotated[float, InUnit("rad/s^2")]
AngularVelocity: TypeAlias = Annotated[float, InUnit("rad/s")]
Damping: TypeAlias = Annotated[float, InUnit("N*m*s/rad")]
Frequency: TypeAlias = Annotated[float, InUnit("Hz")]
Inertia: TypeAlias = Annotated[float, InUnit("kg*m^2")]
Length: TypeAlias = Annotated[float, InUnit("m")]
Mass: TypeAlias = Annotated[float, InUnit("kg")]
Stiffness: TypeAlias = Annotated[float, InUnit("N*m/rad")]
Time: TypeAlias = Annotated[float, InUnit("s")]
Torque: TypeAlias = Annotated[float, InUnit("N*m")]
TorqueConstant: TypeAlias = Annotated[float, InUnit("N*m/A")]

# A quantity whose dimension only its name tells (a parameter of the robot); `study` reads it into SI.
Quantity: TypeAlias = float | str
