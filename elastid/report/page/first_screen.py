"""The values of the first screen and of the table of numbers, as the template of the page writes them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from elastid.fit.result import FitResult
from elastid.report.content import ReportContent
from elastid.report.modes.mode_row import spring_names
from elastid.report.next_steps import commands, next_steps
from elastid.report.overview import (
    WIDTH_WORDS,
    half_width,
    is_wrong,
    numbers_answer,
    residual_sentence,
    strip,
    summary_line,
    verdict_sentence,
    widest,
    width_class,
)
from elastid.report.parameter_rows import ParameterRow
from elastid.report.robot_sketch import robot_sketch

# The axis of the table reaches at least and at most so far to either side, as a ratio to the estimate.
MIN_REACH, MAX_REACH = 1.02, 100.0
# A correlation that the table names.
MIN_CORRELATION = 0.5
# Pixels of the drawing of an interval.
BAR_WIDTH = 120.0


def first_screen(content: ReportContent, rows: tuple[ParameterRow, ...]) -> Mapping[str, Any]:
    """Values for the status bar and the three columns; a sketch only where the robot has points that are drawn."""
    drawing = next((row.drawing for row in content.modes if row.drawing is not None), None)
    classes = [width_class(row) for row in rows]
    return {
        "sentence": verdict_sentence(content.result, rows, content.validation.configurations),
        "numbers_answer": numbers_answer(content.result, rows),
        "summary": summary_line(content),
        "sketch": robot_sketch(content.robot, drawing, rows) if content.robot is not None and drawing else "",
        "widest": None if is_wrong(content.result) else widest(rows),
        "half_width": half_width,
        "width_class": width_class,
        "width_counts": [(words, i, classes.count(i)) for i, words in enumerate(WIDTH_WORDS)],
        "strip": strip(content.validation.configurations),
        "residuals": residual_sentence(content.result, content.validation.configurations),
        "actions": next_steps(content, rows),
        "commands": commands(content),
        "meanings": meanings(content),
        "correlated": correlated(content.result),
    }


def correlated(result: FitResult) -> dict[str, tuple[str, float]]:
    """Of each free parameter the one whose estimate is most correlated with its own, and how; "" below 0.5."""
    names, found = result.parameters.free_names, {}
    others = np.nan_to_num(result.correlation, nan=0.0) - np.eye(len(names))
    for i, name in enumerate(names):
        j = int(np.argmax(np.abs(others[i])))
        found[name] = (names[j], float(others[i, j])) if abs(others[i, j]) >= MIN_CORRELATION else ("", 0.0)
    return found


def meanings(content: ReportContent) -> dict[str, str]:
    """The name in words of each spring and damper of the robot, by symbol."""
    if content.robot is None:
        return {}
    springs = spring_names(content.robot)
    words = {name: f"stiffness, {spring}" for name, spring in springs.items()}
    words |= {f"d{name[1:]}": f"damping, {spring}" for name, spring in springs.items()}
    return words | {f"fm_{joint.name}": f"viscous friction, motor {joint.name}" for joint in content.robot.joints}


def row_axis(rows: Sequence[ParameterRow]) -> Mapping[str, Mapping[str, float | bool]]:
    """Places in pixels on the common axis ln(p / estimate) of the interval's ends, the start and the truth.

    Marks beyond the axis are at its end. A number whose estimate or start is not positive is drawn about its estimate,
    relative to its size.
    """
    ratios = [end for row in rows for end in (*row.interval, *((row.truth,) if row.truth is not None else ()))]
    sizes = [row.estimate for row in rows for _ in range(2 + (row.truth is not None))]
    spread = [abs(_log_ratio(value, size)) for value, size in zip(ratios, sizes, strict=True)]
    finite = [value for value in spread if math.isfinite(value)]
    reach = float(np.clip(max(finite, default=0.0), math.log(MIN_REACH), math.log(MAX_REACH)))

    def place(value: float, estimate: float) -> float:
        ratio = float(np.clip(_log_ratio(value, estimate) / reach, -1, 1))
        return round(BAR_WIDTH / 2 * (1 + 0.94 * ratio), 1)

    return {
        row.name: {
            "low": place(row.interval[0], row.estimate),
            "high": place(row.interval[1], row.estimate),
            "start": place(row.start, row.estimate),
            "truth": place(row.truth, row.estimate) if row.truth is not None else math.nan,
        }
        for row in rows
    } | {"": {"reach": math.exp(reach)}}


def _log_ratio(value: float, estimate: float) -> float:
    if value > 0 and estimate > 0:
        return math.log(value / estimate)
    if not estimate:
        return math.copysign(math.inf, value) if value else 0.0
    return (value - estimate) / abs(estimate)
