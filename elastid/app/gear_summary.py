"""The section `gears` of summary.json, and its parameters with the effects of gears beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from elastid.app.summaries import listed, section
from elastid.fit.result import FitResult
from elastid.nonlinear.gear_result import GearNumber, GearResult, with_gears
from elastid.report.content import ParameterRow
from elastid.store.kinds import json_value


def with_gear_section(
    content: Mapping[str, Any], result: FitResult, rows: Sequence[ParameterRow], gears: GearResult
) -> dict[str, Any]:
    """The content of summary.json with the section `gears`, and the parameters found beside the effects.

    rows: of these; those of the linear fit stand in them as `linear`.  numbers: by name, SI and in makers' units; value
    is null of what was not seen, which lies below `bound95`.  refused: why nothing was looked for.
    """
    parameters = dict(content["parameters"])
    for row in rows if not gears.refused else ():
        known = {name: each for name, each in parameters[row.name].items() if name not in ("profile95", "bootstrap95")}
        own = {"value": result.values[row.name], "std": result.std[row.name], "interval95": result.interval(row.name)}
        parameters[row.name] = known | section(row, "value=estimate std interval95=interval") | {"linear": own}
    found = {
        "refused": gears.refused,
        "numbers": {each.name: _number(sheet.joint, each) for sheet in gears.sheets for each in sheet.numbers},
        "largest_torque": {sheet.joint: sheet.peak for sheet in gears.sheets},
        "notes": listed(gears.notes),
    }
    final = with_gears(result, gears)
    content = {**content, "status": final.status, "message": final.message}
    return {**content, "parameters": json_value(parameters), "gears": json_value(found)}


def _number(joint: str, each: GearNumber) -> dict[str, Any]:
    known: dict[str, Any] = {"joint": joint, **section(each, "meaning unit value std")}
    known |= {"interval95": each.interval if each.is_seen else None, "bound95": None if each.is_seen else each.bound}
    if each.order:
        known |= section(each, "order phase phase_std")
    if math.isfinite(each.rated_share):
        known["of_rated"] = each.rated_share
    if each.maker_unit:
        size = each.value if each.is_seen else each.bound
        known |= {"maker_unit": each.maker_unit, "in_maker_unit": size * each.factor}
    return known
