"""The parameter table at the end of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence

from elastid.report.numbers import digits, number
from elastid.report.parameter_rows import ParameterRow


def parameter_table(rows: Sequence[ParameterRow]) -> list[list[str]]:
    """Headings, then a line for each parameter; the truth and the deviation from it where the rig is simulated."""
    simulated = any(row.truth is not None for row in rows)
    headings = ["parameter", "unit", *(["true"] if simulated else []), "estimate", "std", "95 % interval"]
    headings += ["off / std"] if simulated else []
    return [headings, *(_line(row, simulated) for row in rows)]


def _line(row: ParameterRow, simulated: bool) -> list[str]:
    kept = digits(row.estimate, row.std)
    relative = 100 * row.std / abs(row.estimate) if row.estimate else math.inf
    std = f"{number(relative, 2)} %" if math.isfinite(relative) else number(row.std, 2)
    interval = " to ".join(number(end, kept) for end in row.interval)
    line = [row.name, row.unit, number(row.estimate, kept), std, interval + " (at bound)" * row.at_bound]
    if simulated:
        line.insert(2, number(row.truth))
        known = row.deviation is not None and math.isfinite(row.deviation)
        line.append(f"{row.deviation:+.1f}" if known else "–")
    return line
