"""The sheets of a robot's gears as tables of text, in makers' units."""

from __future__ import annotations

import math
from collections.abc import Sequence

from elastid.base.display import digits, interval_of, number, percent
from elastid.nonlinear.gear_result import GearNumber, GearResult, GearSheet


def gear_table(gears: GearResult, numbers: Sequence[GearNumber] | None = None) -> list[list[str]]:
    """Headings, then a line for each number of all gears, or of those given, in makers' units.

    Its interval, or the bound below which it lies; share of the joint's rated torque; number of the fit without
    effects, where there are any.
    """
    chosen = gears.numbers if numbers is None else numbers
    rated = any(math.isfinite(each.rated_share) for each in gears.numbers)
    headings = ["number", "of the gear", "unit", "estimate", "std", "95 % interval"]
    table = [[*headings, *["of rated"] * rated, "linear fit"]]
    for each in chosen:
        share = f"{number(100 * each.rated_share, 2)} %" if math.isfinite(each.rated_share) else "–"
        own = number(each.linear * each.factor, 6) if math.isfinite(each.linear) else "–"
        table.append([*_cells(each), *[share] * rated, own])
    return table


def _cells(each: GearNumber) -> list[str]:
    unit, factor = each.maker_unit or each.unit, each.factor
    if not each.is_seen:
        return [each.name, each.meaning, unit, f"< {number(factor * each.bound, 2)}", "–", "not seen"]
    value, std = factor * each.value, factor * each.std
    meaning = f"{each.meaning}, at {math.degrees(each.phase):.0f} deg" if each.order else each.meaning
    n, (low, high) = digits(value, std), each.interval
    relative = f"{number(100 * std / abs(value), 2)} %" if value else number(std, 2)
    ends = " to ".join(interval_of((factor * low, factor * high), n))
    return [each.name, meaning, unit, number(value, n), relative, ends]


def seen_words(sheet: GearSheet) -> str:
    """Stiffness and the effects of a gear that were seen, in few words."""
    words = []
    for each in sheet.numbers:
        if each.is_seen and each.name[0] in "kHeFr" and not each.name.startswith("H_"):
            unit, std = each.maker_unit or each.unit, each.factor * each.std
            value = each.factor * each.value
            words.append(f"{each.meaning.partition(',')[0]} {number(value, digits(value, std))} {unit}")
    return "; ".join(words)


def gear_line(gears: GearResult) -> str:
    """The findings in a sentence; or why nothing was looked for."""
    if gears.refused:
        return f"nothing was looked for: {gears.refused}"
    found = [each.name for each in gears.numbers if each.is_seen and not math.isfinite(each.linear)]
    if not found:
        return "springs and dampers alone; nothing else was seen, and each effect has its bound"
    left = f"; {percent(gears.after)} of the motion is left unexplained, by the linear fit {percent(gears.before)}"
    return f"found besides springs and dampers: {', '.join(found)}; every other effect has its bound{left}"
