"""The first screen and the table of numbers as the template writes them, with the robot drawn in SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from elastid.base.arrays import FloatArray
from elastid.base.display import percent
from elastid.fit.result import Result
from elastid.report import overview
from elastid.report.content import ParameterRow, ReportContent
from elastid.report.modes import ModeDrawing, spring_names
from elastid.robot import Robot

# Pixels of the drawing, and free ones about it.
SIZE, MARGIN = 250.0, 26.0
# Opposite to an axis of the base, of a view from the side, somewhat from the front and above.
AZIMUTH, ELEVATION = np.radians(25.0), np.radians(15.0)
STICKS = {"arm": 5.0, "strut": 2.5, "mass": 1.5}


def joint_groups(robot: Robot) -> list[tuple[str, ...]]:
    """Names of the joints at each drawn joint, in the order of `StickFigure.joints`: those of a body share a point."""
    groups: list[tuple[str, ...]] = []
    for body in robot.all_bodies:
        for i, joint in enumerate(body.joints):
            own = () if i == 0 or any(joint.point) else groups.pop()
            groups.append((*own, joint.name))
    return groups


def robot_sketch(robot: Robot, drawing: ModeDrawing, rows: Sequence[ParameterRow]) -> Markup:
    """The robot at rest; a title on each joint says its numbers and their intervals."""
    points = _projected(drawing)
    by_name = {row.name: row for row in rows}
    parts = [
        f'<line x1="{points[a][0]:.1f}" y1="{points[a][1]:.1f}" x2="{points[b][0]:.1f}" y2="{points[b][1]:.1f}" '
        f'class="stick" stroke-width="{STICKS[kind]}"/>'
        for a, b, kind in drawing.links
    ]
    x, y = points[0]
    parts.append(f'<path class="base" d="M{x - 16:.1f} {y:.1f}h32l-5 9h-22z"/>')
    for point, names in zip(drawing.joints, joint_groups(robot), strict=True):
        parts.append(_joint(points[point], names, by_name))
    width, height = (float(np.ptp(points[:, axis])) + 2 * MARGIN for axis in (0, 1))
    box = f'viewBox="0 0 {width + 30:.0f} {height:.0f}" width="{width + 30:.0f}" height="{height:.0f}"'
    words = "The robot, its joints coloured by the width of their intervals"
    # Every text within is escaped.
    return Markup(f'<svg class="robot" role="img" aria-label="{words}" {box}>{"".join(parts)}</svg>')


def _joint(point: FloatArray, names: Sequence[str], rows: Mapping[str, ParameterRow]) -> str:
    own = [rows[f"{kind}_{name}"] for name in names for kind in ("k", "d", "fm") if f"{kind}_{name}" in rows]
    level = max(map(overview.width_class, [row for row in own if not row.name.startswith("fm")]), default=None)
    widths = ", ".join(f"{row.name} ±{percent(overview.half_width(row))}" for row in own) or "nothing identified here"
    css_class = "held" if level is None else f"w{level}"
    label = escape(", ".join(names))
    return (
        f"<g><title>{label}: {escape(widths)}</title>"
        f'<circle cx="{point[0]:.1f}" cy="{point[1]:.1f}" r="8" class="{css_class}"/>'
        f'<text x="{point[0] + 12:.1f}" y="{point[1] + 4:.1f}">{label}</text></g>'
    )


def _projected(drawing: ModeDrawing) -> FloatArray:
    """The points (n, 2) in pixels, seen obliquely, up being up."""
    up = drawing.up
    right, depth = (up + 1) % 3, (up + 2) % 3
    p = drawing.points
    x = p[:, right] * np.cos(AZIMUTH) + p[:, depth] * np.sin(AZIMUTH)
    away = p[:, depth] * np.cos(AZIMUTH) - p[:, right] * np.sin(AZIMUTH)
    y = (-1.0 if drawing.hanging else 1.0) * p[:, up] * np.cos(ELEVATION) + away * np.sin(ELEVATION)
    view = np.stack([x - x.min(), y.max() - y], axis=1)
    return np.asarray(MARGIN + view * (SIZE - 2 * MARGIN) / max(float(np.ptp(view, axis=0).max()), 1e-9))


# Of a row; pixels of the drawing of its interval.
MARKS = ("low", "high", "start", "truth")


def first_screen(content: ReportContent, rows: tuple[ParameterRow, ...]) -> Mapping[str, Any]:
    """Values for the status bar and the three columns; a sketch only where the robot has points that are drawn."""
    drawing = next((row.drawing for row in content.modes if row.drawing is not None), None)
    classes = [overview.width_class(row) for row in rows]
    return {
        "sentence": overview.verdict_sentence(content.result, rows, content.validation.configurations),
        "numbers_answer": overview.numbers_answer(content.result, rows, content.gears),
        "summary": overview.summary_line(content),
        "sketch": robot_sketch(content.robot, drawing, rows) if content.robot is not None and drawing else "",
        "widest": None if overview.is_wrong(content.result) else overview.widest(rows),
        "half_width": overview.half_width,
        "width_class": overview.width_class,
        "width_counts": [(words, i, classes.count(i)) for i, words in enumerate(overview.WIDTH_WORDS)],
        "strip": overview.strip(content.validation.configurations),
        "residuals": overview.residual_sentence(content.result, content.validation.configurations),
        "actions": overview.next_steps(content.result, rows, content.plan),
        "commands": overview.COMMANDS,
        "meanings": meanings(content),
        "correlated": correlated(content.result),
    }


def correlated(result: Result) -> dict[str, tuple[str, float]]:
    """Of each free parameter the one whose estimate is most correlated with its own, and how; "" below 0.5."""
    names, partners = result.parameters.free_names, {}
    correlation = np.nan_to_num(result.correlation, nan=0.0) - np.eye(len(names))
    for i, name in enumerate(names):
        j = int(np.argmax(np.abs(correlation[i])))
        partners[name] = (names[j], float(correlation[i, j])) if abs(correlation[i, j]) >= 0.5 else ("", 0.0)
    return partners


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
    known = [(value, row) for row in rows for value in (*row.interval, row.truth) if value is not None]
    spread = [abs(_log_ratio(value, row.estimate)) for value, row in known]
    finite = [value for value in spread if math.isfinite(value)]
    # The axis reaches from 2 % to a factor of 100 to either side.
    reach = float(np.clip(max(finite, default=0.0), math.log(1.02), math.log(100.0)))

    def place(value: float | None, row: ParameterRow) -> float:
        if value is None:
            return math.nan
        ratio = float(np.clip(_log_ratio(value, row.estimate) / reach, -1, 1))
        return round(60 * (1 + 0.94 * ratio), 1)

    axis = {
        row.name: {
            key: place(value, row) for key, value in zip(MARKS, (*row.interval, row.start, row.truth), strict=True)
        }
        for row in rows
    }
    return axis | {"": {"reach": math.exp(reach)}}


def _log_ratio(value: float, estimate: float) -> float:
    if value > 0 and estimate > 0:
        return math.log(value / estimate)
    if not estimate:
        return math.copysign(math.inf, value) if value else 0.0
    return (value - estimate) / abs(estimate)
