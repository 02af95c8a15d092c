"""The tables of the terminal: predicted and estimated parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from elastid.base.display import digits, interval_of, number
from elastid.report.content import ParameterRow

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
    for each in numbers:
        true = [number(each.truth)] if simulated else []
        estimate = _estimate(each.value, each.std, (each.low, each.high))
        rows.append([each.name, each.unit, *true, *estimate, each.learnt_from])
    return rows


def forecast_table(forecast: Forecast) -> list[list[str]]:
    """Headings, then a line for each parameter: predicted std, the configuration that informs it most, correlation."""
    rows = [["parameter", "unit", "nominal", "expected std", "most of it from", "most correlated with"]]
    by_configuration = forecast.share.sum(axis=1)
    for i, name in enumerate(forecast.parameters):
        relative, std = float(forecast.relative[i]), float(forecast.std[i])
        informed = math.isfinite(std)
        known = f"{number(100 * relative, 2)} %" if math.isfinite(relative) else number(std, 2)
        best = int(by_configuration[:, i].argmax())
        other, correlation = forecast.strongest(name)
        rows.append(
            [
                name,
                forecast.units[i],
                number(float(forecast.nominal[i])),
                known if informed else "not seen",
                f"{forecast.configurations[best]} {100 * by_configuration[best, i]:.0f} %" if informed else "–",
                f"{other} {correlation:+.2f}" if other else "–",
            ]
        )
    return rows


def _line(row: ParameterRow, simulated: bool) -> list[str]:
    estimate, std, interval = _estimate(row.estimate, row.std, row.interval)
    line = [row.name, row.unit, estimate, std, interval + " (at bound)" * row.at_bound]
    if simulated:
        line.insert(2, number(row.truth))
        known = row.deviation is not None and math.isfinite(row.deviation)
        line.append(f"{row.deviation:+.1f}" if known else "–")
    return line


def _estimate(value: float, std: float, interval: tuple[float, float]) -> tuple[str, str, str]:
    """An estimate, its standard deviation in percent where it is not zero, and its interval, to as many digits."""
    n = digits(value, std)
    return number(value, n), _relative(std, value), " to ".join(interval_of(interval, n))


def _relative(std: float, value: float) -> str:
    relative = 100 * std / abs(value) if value else math.inf
    return f"{number(relative, 2)} %" if math.isfinite(relative) else number(std, 2)
