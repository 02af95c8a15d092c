"""The robot as an SVG drawing whose joints have the colour of the widest interval of their springs and dampers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup, escape

from elastid.base.arrays import FloatArray
from elastid.base.numbers import percent
from elastid.report.modes.mode_drawing import ModeDrawing
from elastid.report.overview import half_width, width_class
from elastid.report.parameter_rows import ParameterRow
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
            if i == 0 or any(joint.point):
                groups.append((joint.name,))
            else:
                groups[-1] = (*groups[-1], joint.name)
    return groups


def robot_sketch(robot: Robot, drawing: ModeDrawing, rows: Sequence[ParameterRow]) -> Markup:
    """The robot at rest; a title on each joint says its numbers and their intervals."""
    at = _projected(drawing)
    by_name = {row.name: row for row in rows}
    parts = [
        f'<line x1="{at[a][0]:.1f}" y1="{at[a][1]:.1f}" x2="{at[b][0]:.1f}" y2="{at[b][1]:.1f}" '
        f'class="stick" stroke-width="{STICKS[kind]}"/>'
        for a, b, kind in drawing.links
    ]
    x, y = at[0]
    parts.append(f'<path class="base" d="M{x - 16:.1f} {y:.1f}h32l-5 9h-22z"/>')
    for point, names in zip(drawing.joints, joint_groups(robot), strict=True):
        parts.append(_joint(at[point], names, by_name))
    width, height = (float(np.ptp(at[:, axis])) + 2 * MARGIN for axis in (0, 1))
    box = f'viewBox="0 0 {width + 30:.0f} {height:.0f}" width="{width + 30:.0f}" height="{height:.0f}"'
    words = "The robot, its joints coloured by the width of their intervals"
    # Every text within is escaped.
    return Markup(f'<svg class="robot" role="img" aria-label="{words}" {box}>{"".join(parts)}</svg>')


def _joint(at: FloatArray, names: Sequence[str], rows: Mapping[str, ParameterRow]) -> str:
    own = [rows[f"{kind}_{name}"] for name in names for kind in ("k", "d", "fm") if f"{kind}_{name}" in rows]
    level = max(map(width_class, [row for row in own if not row.name.startswith("fm")]), default=None)
    said = ", ".join(f"{row.name} ±{percent(half_width(row))}" for row in own) or "nothing identified here"
    look = "held" if level is None else f"w{level}"
    label = escape(", ".join(names))
    return (
        f'<g><title>{label}: {escape(said)}</title><circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="8" class="{look}"/>'
        f'<text x="{at[0] + 12:.1f}" y="{at[1] + 4:.1f}">{label}</text></g>'
    )


def _projected(drawing: ModeDrawing) -> FloatArray:
    """The points (n, 2) in pixels, seen obliquely, up being up."""
    up = drawing.up
    right, depth = (up + 1) % 3, (up + 2) % 3
    p = drawing.points
    x = p[:, right] * np.cos(AZIMUTH) + p[:, depth] * np.sin(AZIMUTH)
    away = p[:, depth] * np.cos(AZIMUTH) - p[:, right] * np.sin(AZIMUTH)
    y = (-1.0 if drawing.hanging else 1.0) * p[:, up] * np.cos(ELEVATION) + away * np.sin(ELEVATION)
    seen = np.stack([x - x.min(), y.max() - y], axis=1)
    return np.asarray(MARGIN + seen * (SIZE - 2 * MARGIN) / max(float(np.ptp(seen, axis=0).max()), 1e-9))
