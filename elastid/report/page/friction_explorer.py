"""The friction curves of a page to hover over: their data in the form that the explorer of responses draws."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.escape import embedded_json
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.result import JointFriction
from elastid.report.figures import style
from elastid.report.figures.friction_curve import DIRECTIONS, Z_95, Condition, law_band, law_directions, units
from elastid.report.page.embedding import asset
from elastid.report.page.explorer import Explorer, curve_scripts

POINTS = 120
# Key and label of a direction.
NAMES = {0.0: ("", ""), 1.0: ("_ahead", ", positive direction"), -1.0: ("_back", ", negative direction")}


def friction_explorer(joints: Iterable[JointFriction]) -> Explorer | None:
    """Levels and law of every joint over speed, with their 95 % intervals; None where no joint has a law."""
    laws = [(joint.joint, joint.static) for joint in joints if joint.static is not None]
    if not laws:
        return None
    quantity = {"title": "friction", "unit": "", "digits": None, "curves": _looks()}
    content = {
        "frequency_unit": "rad/s",
        "quantities": {"friction": quantity},
        "responses": [_curve(name, law) for name, law in laws],
    }
    return Explorer(embedded_json(content), curve_scripts(), asset("uplot", "uPlot.min.css"))


def _looks() -> list[Mapping[str, Any]]:
    """Levels as points, laws as lines, ends of their intervals thin and broken."""
    looks: list[Mapping[str, Any]] = []
    for direction, (key, name) in NAMES.items():
        color = style.FITTED if direction >= 0 else style.TOTAL
        end = {"color": color, "points": False, "width": 0.7, "dash": [4, 4], "ranged": True}
        looks += [
            {"key": f"level{key}", "label": f"level{name}", "color": DIRECTIONS[direction][0], "points": True}
            | {"ranged": True},
            {"key": f"half{key}", "label": "± (95 %)", "color": "transparent", "points": False, "width": 0},
            {"key": f"law{key}", "label": f"law{name}", "color": color, "points": False, "width": 1.5, "ranged": True},
            end | {"key": f"low{key}", "label": "from"},
            end | {"key": f"high{key}", "label": "to"},
        ]
    return looks


def _curve(name: str, law: StaticLaw) -> Mapping[str, Any]:
    levels, condition = law.levels, Condition.typical(law.levels)
    here = condition.here(law)
    grid = np.geomspace(levels.speed.min(), levels.speed.max(), POINTS)
    speed = np.unique(np.concatenate([grid, levels.speed[here]]))
    curves: dict[str, list[float | None]] = {}
    for direction in sorted(set(levels.direction[here].tolist())):
        own = here & (levels.direction == direction)
        at, key = np.searchsorted(speed, levels.speed[own]), NAMES[direction][0]
        curves[f"level{key}"] = _placed(len(speed), at, levels.torque[own])
        curves[f"half{key}"] = _placed(len(speed), at, Z_95 * levels.std[own])
    for direction in law_directions(law):
        torque, half = law_band(law, condition.at(speed, direction))
        for what, values in (("law", torque), ("low", torque - half), ("high", torque + half)):
            curves[f"{what}{NAMES[direction][0]}"] = _rounded(values)
    highest = float((levels.torque + Z_95 * levels.std)[here].max())
    unit_of_speed, unit = units(levels.slides)
    return {
        "title": f"{name} {condition.text(law)}".rstrip(),
        "inputs": ["speed"],
        "outputs": ["force" if levels.slides else "torque"],
        "freq": _rounded(speed),
        "curves": curves,
        "range": [0, float(f"{1.1 * highest:.3g}")],
        "unit": unit,
        "x_unit": unit_of_speed,
    }


def _placed(n: int, at: FloatArray, values: FloatArray) -> list[float | None]:
    """n values, nothing but at `at`."""
    row: list[float | None] = [None] * n
    for i, value in zip(at.tolist(), _rounded(values), strict=True):
        row[int(i)] = value
    return row


def _rounded(values: FloatArray) -> list[float | None]:
    return [float(f"{value:.5g}") if math.isfinite(value) else None for value in values.tolist()]
