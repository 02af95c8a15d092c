"""Table and sentences of gear effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from elastid.base.display import digits, format_interval, number, percent, relative_std

if TYPE_CHECKING:
    from elastid.nonlinear.gear_result import GearNumber, GearResult, GearSheet  # a slow import


def gear_table(gears: GearResult, numbers: Sequence[GearNumber] | None = None) -> list[list[str]]:
    """Return headings and a row for each number of all gears, or for the given numbers, in makers' units.

    Columns: interval or upper bound, fraction of the rated torque of the joint, and value of the linear fit.
    """
    has_rated = any(math.isfinite(row.rated_fraction) for row in gears.numbers)
    headings = ["parameter", "meaning", "unit", "estimate", "std", "95 % interval"]
    table = [[*headings, *["of rated torque"] * has_rated, "linear fit"]]
    for row in gears.numbers if numbers is None else numbers:
        fraction = f"{number(100 * row.rated_fraction, 2)} %" if math.isfinite(row.rated_fraction) else "–"
        linear = number(row.linear * row.factor, digits(row.value, row.std)) if math.isfinite(row.linear) else "–"
        table.append([*_number_cells(row), *[fraction] * has_rated, linear])
    return table


def _number_cells(row: GearNumber) -> list[str]:
    unit, factor = row.maker_unit or row.unit, row.factor
    if not row.is_significant:
        return [row.name, row.meaning, unit, f"< {number(factor * row.bound, 2)}", "–", "not significant"]
    value, std = factor * row.value, factor * row.std
    meaning = f"{row.meaning}, phase {math.degrees(row.phase):.0f} deg" if row.order else row.meaning
    n, (low, high) = digits(value, std), row.interval
    ends = " to ".join(format_interval((factor * low, factor * high), n))
    return [row.name, meaning, unit, number(value, n), relative_std(value, std), ends]


def gear_sentence(sheet: GearSheet) -> str:
    """Summarise the stiffness and the significant effects of a gear."""
    texts = []
    for row in sheet.numbers:
        if row.is_significant and row.name[0] in "kHeFr" and not row.name.startswith("H_"):
            unit, std = row.maker_unit or row.unit, row.factor * row.std
            value = row.factor * row.value
            texts.append(f"{row.meaning.partition(',')[0]} {number(value, digits(value, std))} {unit}")
    return "; ".join(texts)


def gear_line(gears: GearResult) -> str:
    """Summarise the gear effects in a sentence, or the reason for their absence."""
    if gears.refused:
        return f"effects not estimated: {gears.refused}"
    nonlinear = [row.name for row in gears.numbers if row.is_significant and not math.isfinite(row.linear)]
    if not nonlinear:
        return "no effect besides stiffness and damping is significant; upper bounds are in gears.h5"
    fraction = f"unexplained position signal {percent(gears.after)} (linear fit {percent(gears.before)})"
    return f"significant effects: {', '.join(nonlinear)} (upper bounds for the others); {fraction}"
