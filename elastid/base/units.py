"""Units of a study: conversion of numbers (SI) and texts such as '2.5 kN*m/rad' by a closed table.

`Annotated[float, InUnit("N*m/rad")]` makes a dataclass field read both and refuse every other dimension; with
`InUnit("N*m/rad", "N/m")` it takes either, as a `Measured` number that keeps its dimension for its owner to check.
Frequencies are in Hz everywhere; nothing here turns Hz into rad/s.
"""

import math
import re
from functools import cache
from typing import Annotated, Any, TypeAlias

# Rows of a dimension: its SI unit, then further units with their factors to SI (deg = pi / 180 rad). Closed on
# purpose: any other unit is refused with the list of the fitting ones.
_ROWS = """
1 %=0.01
rad mrad=0.001 deg=0.017453292519943295 arcmin=0.0002908882086657216 arcsec=4.84813681109536e-06 rev=6.283185307179586
rad mdeg=1.7453292519943296e-05
rad/s deg/s=0.017453292519943295 rpm=0.10471975511965977 rev/s=6.283185307179586
rad/s mrad/s=0.001 mdeg/s=1.7453292519943296e-05
rad/s^2 deg/s^2=0.017453292519943295
rad/s^3 deg/s^3=0.017453292519943295
N mN=0.001 daN=10.0 kN=1000.0
N/m kN/m=1000.0 N/mm=1000.0 kN/mm=1000000.0 MN/m=1000000.0
N*s/m kN*s/m=1000.0
N*m mN*m=0.001 N*mm=0.001 N*cm=0.01 daN*m=10.0 kN*m=1000.0
V mV=0.001 kV=1000.0
A mA=0.001
N*m/rad kN*m/rad=1000.0 MN*m/rad=1000000.0 N*m/deg=57.29577951308232 N*m/arcmin=3437.7467707849396
N*m*s/rad kN*m*s/rad=1000.0
kg g=0.001
kg*m^2 g*m^2=0.001 kg*cm^2=0.0001
m mm=0.001 um=1e-06
m/s um/s=1e-06 mm/s=0.001
m/s^2 mm/s^2=0.001
s ms=0.001 us=1e-06 min=60.0 h=3600.0
Hz kHz=1000.0
"""
# Dimensions with an SI unit alone.
_SI_ALONE = """
1/s 1/s^2 N*m/A N*m/rad^2 N*m/rad^3 N/m^2 N/m^3 N*m*s^2/rad^2 N*s^2/m^2 N*m/s N/s N*m/K N/K rad/(s*K) m/(s*K) degC K
W/K m/s^3
"""
# unit: (dimension, factor to SI).
TABLE: dict[str, tuple[str, float]] = {
    unit: (row.split()[0], float(scale or 1.0))
    for row in (*_ROWS.strip().splitlines(), *_SI_ALONE.split())
    for unit, _, scale in (word.partition("=") for word in row.split())
}
# Parts of a unit and their spellings in logs and data sheets (Nm, kg m², °/s, 1/min, µs), as regular expressions.
_PARTS = {
    r"\*": "[*·⋅. ]?", "/": "(/|_?per_?|_)", r"\^2": r"(\^?2|²)", "s": "s(ec)?", "u": "[uµμ]", "A": "A(mp(ere)?s?)?",
    "deg": "(deg(rees?)?|gra(d(er|os|i)?|us)|°)", "rad": "rad(ians?)?", "rev": "(rev|turns?)",
    "rpm": r"(rpm|([ur]|tr|rev|turns?|1)/min|min\^?-1)",
}  # fmt: skip
# Spellings of each unit; messages and `units_of` have its name alone.
SPELLINGS = {
    unit: re.sub(r"\\\*|\\\^2|/|\bs\b|^u|A|deg|rad|rev|rpm", lambda part: _PARTS[part[0]], re.escape(unit))
    for unit in TABLE
}


@cache
def table_unit(unit: str) -> str:
    """Return the name of a unit in the table, for any spelling; an unknown unit stays as it is.

    >>> table_unit("Nm")
    'N*m'
    """
    return unit if unit in TABLE else next((name for name, text in SPELLINGS.items() if re.fullmatch(text, unit)), unit)


def dimension_and_size(unit: str) -> tuple[str, float]:
    """Return the SI unit of a unit and its factor, for any spelling; empty and 1 for an unknown unit.

    >>> dimension_and_size("mNm")
    ('N*m', 0.001)
    """
    return TABLE.get(table_unit(unit), ("", 1.0))


def units_of(dimension: str) -> list[str]:
    """List the units in the table of a dimension, which its SI unit names."""
    return [name for name, (measures, _) in TABLE.items() if measures == dimension]


def si_factor(unit: str, *dimensions: str) -> float:
    """Return the number of SI units in one `unit`; ValueError for an unknown unit or another dimension.

    >>> si_factor("rpm", "rad/s") == 2 * math.pi / 60
    True
    """
    measures, scale = dimension_and_size(unit)
    if measures not in dimensions:
        fitting = ", ".join(name for dimension in dimensions for name in units_of(dimension))
        wrong = f"measures {measures}, not {' or '.join(dimensions)}" if measures else "is unknown"
        raise ValueError(f"unit '{unit}' {wrong}; units that fit here: {fitting}")
    return scale


def to_si(value: Any, *dimensions: str) -> float:
    """Convert a number (SI) or a text '2.5 kN*m/rad' to SI; ValueError lists the units that fit.

    If several dimensions are allowed, a text with a unit keeps its dimension.

    >>> to_si("2.5 kN*m/rad", "N*m/rad")
    2500.0
    >>> force = to_si("5 N/mm", "N*m/rad", "N/m")
    >>> force, force.dimension
    (5000.0, 'N/m')
    """
    unit, expected_units = "", " or ".join(dimensions)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"expected a number in {expected_units} or a text such as '1 {dimensions[0]}'")
    if isinstance(value, str):
        match = re.match(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?$", value)
        if match is None:
            raise ValueError(f"'{value}' is not a number with a unit; write for example '1 {dimensions[0]}'")
        unit = (match[2] or "").strip()
        value = float(match[1]) * (si_factor(unit, *dimensions) if unit else 1.0)
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number in {expected_units}")
    return Measured(value, dimension_and_size(unit)[0]) if unit and len(dimensions) > 1 else float(value)


class Measured(float):
    """A float in SI with the dimension of the unit that it was written in."""

    dimension: str

    def __new__(cls, value: float, dimension: str) -> "Measured":
        """Make a number with its dimension."""
        number = super().__new__(cls, value)
        number.dimension = dimension
        return number

    def __getnewargs__(self) -> tuple[float, str]:  # type: ignore[override]
        return float(self), self.dimension


def translation_unit(unit: str) -> str:
    """Return the unit of a translation that corresponds to a unit of a rotation.

    >>> translation_unit("N*m*s/rad")
    'N*s/m'
    """
    return unit.replace("N*m", "N").replace("rad", "m")


class InUnit:
    """SI unit of a float field, in its annotation; by it the study loader reads numbers and texts with units.

    others: further dimensions that the field may have instead.  is_finite: False if infinity is a valid value (no
    limit).
    """

    def __init__(self, unit: str, *others: str, is_finite: bool = True) -> None:
        self.unit, self.units, self.is_finite = unit, (unit, *others), is_finite

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the pydantic schema of the field."""
        from pydantic_core import core_schema  # value types stay free of pydantic

        # JSON has no infinite numbers.
        serializer = core_schema.plain_serializer_function_ser_schema(lambda x: x if math.isfinite(x) else str(x))
        return core_schema.no_info_plain_validator_function(
            self._number, metadata={"pydantic_js_functions": []}, serialization=None if self.is_finite else serializer
        )

    def _number(self, value: Any) -> float:
        return float(value) if not self.is_finite and str(value) in ("inf", "-inf") else to_si(value, *self.units)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        fitting = [name for unit in self.units for name in units_of(unit)]
        names = "|".join(SPELLINGS[name] for name in fitting)
        return {
            "description": f"in {' or '.join(self.units)}, or a text with a unit: {', '.join(fitting)}",
            "anyOf": [{"type": "number"}, {"type": "string", "pattern": rf"^\s*[-+0-9.eE]+\s*({names})?$"}],
        }


Acceleration: TypeAlias = Annotated[float, InUnit("m/s^2")]
AxialDamping: TypeAlias = Annotated[float, InUnit("N*s/m")]
Angle: TypeAlias = Annotated[float, InUnit("rad")]
Damping: TypeAlias = Annotated[float, InUnit("N*m*s/rad", "N*s/m")]
CubicStiffness: TypeAlias = Annotated[float, InUnit("N*m/rad^3", "N/m^3")]
Force: TypeAlias = Annotated[float, InUnit("N")]
Frequency: TypeAlias = Annotated[float, InUnit("Hz")]
Inertia: TypeAlias = Annotated[float, InUnit("kg*m^2")]
Length: TypeAlias = Annotated[float, InUnit("m")]
LinearStiffness: TypeAlias = Annotated[float, InUnit("N/m")]
Mass: TypeAlias = Annotated[float, InUnit("kg")]
Stiffness: TypeAlias = Annotated[float, InUnit("N*m/rad", "N/m")]
QuadraticStiffness: TypeAlias = Annotated[float, InUnit("N*m/rad^2", "N/m^2")]
Ratio: TypeAlias = Annotated[float, InUnit("1")]
Time: TypeAlias = Annotated[float, InUnit("s")]
Torque: TypeAlias = Annotated[float, InUnit("N*m")]
Temperature: TypeAlias = Annotated[float, InUnit("degC")]
TemperatureRise: TypeAlias = Annotated[float, InUnit("K")]
Conductance: TypeAlias = Annotated[float, InUnit("W/K")]
# Of a joint, which may turn or slide.
JointPosition: TypeAlias = Annotated[float, InUnit("rad", "m")]
JointVelocity: TypeAlias = Annotated[float, InUnit("rad/s", "m/s")]
JointTorque: TypeAlias = Annotated[float, InUnit("N*m", "N")]
TorqueConstant: TypeAlias = Annotated[float, InUnit("N*m/A")]

# A quantity whose dimension follows from its name (a parameter of the robot); `study` reads it into SI.
Quantity: TypeAlias = float | str
