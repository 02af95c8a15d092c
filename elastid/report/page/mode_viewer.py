"""The modes in motion on the page: the sticks of every configuration as JSON, and the script that moves them.

Lengths are whole steps of a 5000th of the robot's size, so that 20 configurations of a six-axis robot with 18 modes are
a third of a megabyte.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import number, percent
from elastid.base.escape import embedded_json
from elastid.report.figures import style
from elastid.report.modes import ModeDrawing, ModeRow
from elastid.report.page.explorer import asset

# To the size of the robot.
STEPS = 5000


@dataclass(frozen=True)
class ModeViewer:
    """data: JSON for a script element.  script: text."""

    data: str
    script: str


def mode_viewer(rows: Sequence[ModeRow], rate_is_known: bool) -> ModeViewer | None:
    """Every mode of the rows of the page's table, ready to be drawn; None where no row has a drawing."""
    if all(row.drawing is None for row in rows):
        return None
    content = {
        "colors": {"rest": style.WEAK, "ahead": style.MEASURED, "back": style.FITTED},
        "rows": [_row(row, "Hz" if rate_is_known else "of the sampling rate") for row in rows],
    }
    return ModeViewer(embedded_json(content), asset("mode_viewer.js"))


def _row(row: ModeRow, unit: str) -> Mapping[str, Any] | None:
    drawing = row.drawing
    if drawing is None:
        return None
    step = float(f"{np.ptp(drawing.points, axis=0).max() / STEPS:.4g}")
    return {
        "step": step,
        "points": _whole(drawing.points, step),
        "links": drawing.links,
        "joints": drawing.joints,
        "down": drawing.up if drawing.hanging else -1,
        "modes": [_mode(row, drawing, mode, step, unit) for mode in range(len(row.frequency_hz))],
    }


def _mode(row: ModeRow, drawing: ModeDrawing, mode: int, step: float, unit: str) -> Mapping[str, Any]:
    title = f"{row.configuration}, mode {mode + 1}: {number(row.frequency_hz[mode])} {unit}, "
    title += f"{percent(row.damping_ratio[mode])} damping"
    moved = drawing.moved[:, :, mode]
    return {
        "title": title,
        "energy": row.energy_text[mode],
        "views": drawing.views(mode),
        "re": _whole(moved.real, step),
        "im": _whole(moved.imag, step),
    }


def _whole(values: FloatArray, step: float) -> list[int]:
    """(n, 3) in whole steps, point by point."""
    return np.round(values / step).astype(int).ravel().tolist()
