"""The page of a friction study: the answer first, the table of numbers, curves to explore, figures of each joint."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import number
from elastid.base.escape import embedded_json
from elastid.base.execution import Execution
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.result import JointFriction
from elastid.report.figures import style
from elastid.report.figures.drawings import JOINT, friction_study_drawings
from elastid.report.figures.friction import DIRECTIONS, Condition, law_band, law_directions, units
from elastid.report.friction_content import NUMBER_HEADINGS, FrictionContent, number_cells, refusals
from elastid.report.page.explorer import curve_scripts
from elastid.report.page.page import EmbeddedFigure, render, write_page

# Key and label of a direction.
NAMES = {0.0: ("", ""), 1.0: ("_ahead", ", positive direction"), -1.0: ("_back", ", negative direction")}


def friction_explorer(joints: Iterable[JointFriction]) -> str:
    """Levels and law of every joint over speed with 95 % intervals as JSON; empty where no joint has a law."""
    laws = [(joint.joint, joint.static) for joint in joints if joint.static is not None]
    if not laws:
        return ""
    quantity = {"title": "friction", "unit": "", "digits": None, "curves": _looks()}
    curves = [_curve(name, law) for name, law in laws]
    return embedded_json({"frequency_unit": "rad/s", "quantities": {"friction": quantity}, "responses": curves})


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
            end | {"key": f"low{key}", "label": "95 % band"},
            end | {"key": f"high{key}", "label": "95 % band"},
        ]
    return looks


def _curve(name: str, law: StaticLaw) -> Mapping[str, Any]:
    levels, condition = law.levels, Condition.typical(law.levels)
    on_curve = condition.includes(law)
    grid = np.geomspace(levels.speed.min(), levels.speed.max(), 120)
    speed = np.unique(np.concatenate([grid, levels.speed[on_curve]]))
    curves: dict[str, list[float | None]] = {}
    for direction in sorted(set(levels.direction[on_curve].tolist())):
        own = on_curve & (levels.direction == direction)
        lines, key = np.searchsorted(speed, levels.speed[own]), NAMES[direction][0]
        curves[f"level{key}"] = _placed(len(speed), lines, levels.torque[own])
        curves[f"half{key}"] = _placed(len(speed), lines, QUANTILE_95 * levels.std[own])
    for direction in law_directions(law):
        torque, half = law_band(law, condition.at(speed, direction))
        for key, values in (("law", torque), ("low", torque - half), ("high", torque + half)):
            curves[f"{key}{NAMES[direction][0]}"] = _rounded(values)
    highest = float((levels.torque + QUANTILE_95 * levels.std)[on_curve].max())
    unit_of_speed, unit = units(levels.slides)
    title, output = f"{name} {condition.text(law)}".rstrip(), "force" if levels.slides else "torque"
    axes = {"range": [0, float(f"{1.1 * highest:.3g}")], "unit": unit, "x_unit": unit_of_speed}
    return {"title": title, "inputs": ["speed"], "outputs": [output], "freq": _rounded(speed), "curves": curves} | axes


def _placed(n: int, lines: FloatArray, values: FloatArray) -> list[float | None]:
    """n values, None on all but these lines."""
    row = np.full(n, np.nan)
    row[lines] = values
    return _rounded(row)


def _rounded(values: FloatArray) -> list[float | None]:
    return [float(f"{value:.5g}") if math.isfinite(value) else None for value in values.tolist()]


# Numbers that all passes of a joint share, as people call them.
SHARED = {
    "inertia": "inertia",
    "slope": "slope of friction within a pass",
    "gravity.cos": "gravity, part of cos q",
    "gravity.sin": "gravity, part of sin q",
    "offset": "offset of the torque",
}


def write_page_of_friction(
    content: FrictionContent, folder: Path, formats: Collection[str], execution: Execution | None = None
) -> Path:
    """folder/report.html and folder/figures/*; the path of the page."""
    drawn = friction_study_drawings(content.result, content.filters, content.twin, content.left_out)
    return write_page(partial(html_of_friction, content), drawn, folder, formats, execution)


def html_of_friction(content: FrictionContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    curves, result = friction_explorer(content.result.joints), content.result
    rows = [(identified, number_cells(identified)) for identified in result.numbers]
    values = {"result": result, "headings": NUMBER_HEADINGS, "rows": rows, "shared": shared_numbers, "section": JOINT}
    scripts = curve_scripts() if curves else ()
    return render("friction.html.j2", content, figures, curves, scripts, **values, refusals=refusals(result))


def shared_numbers(joint: JointFriction) -> tuple[tuple[str, str, str, str], ...]:
    """The numbers that all passes of a joint share, except friction: name, value, std and unit."""
    if joint.levels is None:
        return ()
    torque = "N" if joint.slides else "N*m"
    units = {"inertia": "kg" if joint.slides else "kg*m^2", "slope": "N*s/m" if joint.slides else "N*m*s/rad"}
    rows = []
    for name, (value, std) in joint.levels.shared.items():
        kind = ".".join(name.split(".")[:2])  # of gravity.cos.full the load is full
        load = name[len(kind) + 1 :]
        if kind in SHARED:
            words = SHARED[kind] + (f" ({load})" if load else "")
            rows.append((words, number(value), number(std, 2), units.get(name, torque)))
    return tuple(rows)
