"""The tables of the terminal: predicted and estimated parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from elastid.base.numbers import digits, interval_of, number
from elastid.report.parameter_rows import ParameterRow

if TYPE_CHECKING:
    from elastid.design.forecast import Forecast
    from elastid.friction_study.result import FrictionNumber


def parameter_table(rows: Sequence[ParameterRow]) -> list[list[str]]:
    """Headings, then a line for each parameter; the truth and the deviation from it where the rig is simulated."""
    simulated = any(row.truth is not None for row in rows)
    headings = ["parameter", "unit", *(["true"] if simulated else []), "estimate", "std", "95 % interval"]
    headings += ["off / std"] if simulated else []
    return [headings, *(_line(row, simulated) for row in rows)]


def friction_table(numbers: Sequence[FrictionNumber]) -> list[list[str]]:
    """Headings, then a line for each number of friction; the truth where the rig is simulated."""
    simulated = any(each.truth is not None for each in numbers)
    rows = [["number", "unit", *(["true"] if simulated else []), "estimate", "std", "95 % interval", "learnt from"]]
    for one in numbers:
        kept = digits(one.value, one.std)
        relative = 100 * one.std / abs(one.value) if one.value else math.inf
        std = f"{number(relative, 2)} %" if math.isfinite(relative) else number(one.std, 2)
        line = [one.name, one.unit, number(one.value, kept), std, " to ".join(interval_of((one.low, one.high), kept))]
        rows.append([*line[:2], *([number(one.truth)] if simulated else []), *line[2:], one.learnt_from])
    return rows


def forecast_table(forecast: Forecast) -> list[list[str]]:
    """Headings, then a line for each parameter: predicted std, the configuration that informs it most, correlation."""
    rows = [["parameter", "unit", "nominal", "expected std", "most of it from", "most correlated with"]]
    by_configuration = forecast.share.sum(axis=1)
    for i, name in enumerate(forecast.parameters):
        relative, std = float(forecast.relative[i]), float(forecast.std[i])
        seen = math.isfinite(std)
        known = f"{number(100 * relative, 2)} %" if math.isfinite(relative) else number(std, 2)
        best = int(by_configuration[:, i].argmax())
        other, correlation = forecast.strongest(name)
        rows.append(
            [
                name,
                forecast.units[i],
                number(float(forecast.nominal[i])),
                known if seen else "not seen",
                f"{forecast.configurations[best]} {100 * by_configuration[best, i]:.0f} %" if seen else "–",
                f"{other} {correlation:+.2f}" if other else "–",
            ]
        )
    return rows


def _line(row: ParameterRow, simulated: bool) -> list[str]:
    kept = digits(row.estimate, row.std)
    relative = 100 * row.std / abs(row.estimate) if row.estimate else math.inf
    std = f"{number(relative, 2)} %" if math.isfinite(relative) else number(row.std, 2)
    interval = " to ".join(interval_of(row.interval, kept))
    line = [row.name, row.unit, number(row.estimate, kept), std, interval + " (at bound)" * row.at_bound]
    if simulated:
        line.insert(2, number(row.truth))
        known = row.deviation is not None and math.isfinite(row.deviation)
        line.append(f"{row.deviation:+.1f}" if known else "–")
    return line
