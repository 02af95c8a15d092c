"""Robots, sections of studies and records in other units: of a result nothing but its units may change.

The other units are powers of two of those of SI, so that numbers differ by no more than sums in another order do.
"""

import re
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, get_args, get_type_hints

from elastid.base.units import InUnit
from elastid.record import Record

T = TypeVar("T")
MASS, LENGTH, TIME = 2.0**-5, 2.0**3, 2.0**-4
SIZES = {"kg": MASS, "m": LENGTH, "s": TIME, "N": MASS * LENGTH / TIME**2, "Hz": 1 / TIME}


def factor(unit: str) -> float:
    """The number in the other units of one `unit` of SI, such as N*m*s/rad."""
    sizes = {name: SIZES.get(name, 1.0) for name in re.findall("[A-Za-z]+", unit)}
    return 1 / float(eval(unit.replace("^", "**"), {}, sizes))


def in_other_units(section: T) -> T:
    """A robot whose joints turn, or a section of a study, by the units that fields have."""
    hints = get_type_hints(type(section), include_extras=True)
    parts = {each.name: getattr(section, each.name) for each in fields(section) if each.init}
    converted = {name: _converted(value, unit_of(hints[name])) for name, value in parts.items()}
    return replace(section, **converted)


def unit_of(hint: Any) -> str:
    """The unit of the numbers of a field, 1 where it has none."""
    if isinstance(hint, InUnit):
        return hint.unit
    parts = (*getattr(hint, "__metadata__", ()), *get_args(hint))
    return next((unit for unit in map(unit_of, parts) if unit != "1"), "1")


def _converted(value: Any, unit: str) -> Any:
    if is_dataclass(value):
        return in_other_units(value)
    if isinstance(value, tuple):
        return tuple(_converted(each, unit) for each in value)
    return value * factor(unit) if isinstance(value, float | int) and unit != "1" else value


def record_in_other_units(record: Record) -> Record:
    return replace(record, rate_hz=record.rate_hz * factor("Hz"), u=record.u * factor("N*m"))
