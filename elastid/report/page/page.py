"""Self-contained HTML page of a study or of responses: values for its templates, the robot in SVG, and figures."""

import base64
import io
import math
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from elastid.base.arrays import FloatArray
from elastid.base.display import capitalise, digits, format_interval, number, percent
from elastid.base.errors import group_notes
from elastid.base.execution import Execution
from elastid.base.files import clear_folder, write_atomically
from elastid.nonlinear.compensated_friction import friction_rows
from elastid.report import run_summary
from elastid.report.content import ReportContent
from elastid.report.figures import style
from elastid.report.figures.drawings import Drawing
from elastid.report.figures.style import default_style
from elastid.report.gear_table import gear_line, gear_sentence, gear_table
from elastid.report.modes import ModeDrawing, spring_names
from elastid.report.next_steps import COMMANDS, next_steps
from elastid.report.page.explorer import asset, curve_scripts, explorer, mode_viewer, script_policy
from elastid.report.parameter_row import WIDTH_WORDS, ParameterRow, parameter_rows
from elastid.report.residual_strip import residual_strip
from elastid.report.responses_content import ResponsesContent, questions_of_responses
from elastid.robot import Robot

SIZE, MARGIN = 250.0, 26.0  # of the robot drawing, pixels
AZIMUTH, ELEVATION = np.radians(25.0), np.radians(15.0)  # of the view, from the side of the base
STICKS = {"arm": 5.0, "strut": 2.5, "mass": 1.5}


def joint_groups(robot: Robot) -> list[tuple[str, ...]]:
    """Return the names of the joints at each drawn point, in the order of `StickFigure.joints`."""
    groups: list[tuple[str, ...]] = []
    for body in robot.all_bodies:
        for i, joint in enumerate(body.joints):
            groups.append((*(() if i == 0 or any(joint.point) else groups.pop()), joint.name))
    return groups


def robot_sketch(robot: Robot, drawing: ModeDrawing, rows: Sequence[ParameterRow]) -> Markup:
    """Draw the robot at rest; the title of each joint lists its parameters and interval widths."""
    points = _project(drawing)
    by_name = {row.name: row for row in rows}
    elements = [
        f'<line x1="{points[a][0]:.1f}" y1="{points[a][1]:.1f}" x2="{points[b][0]:.1f}" y2="{points[b][1]:.1f}" '
        f'class="stick" stroke-width="{STICKS[kind]}"/>'
        for a, b, kind in drawing.links
    ]
    x, y = points[0]
    elements.append(f'<path class="base" d="M{x - 16:.1f} {y:.1f}h32l-5 9h-22z"/>')
    joints = zip(drawing.joints, joint_groups(robot), strict=True)
    elements += [_joint(points[point], names, by_name) for point, names in joints]
    width, height = (float(np.ptp(points[:, axis])) + 2 * MARGIN for axis in (0, 1))
    box = f'viewBox="0 0 {width + 30:.0f} {height:.0f}" width="{width + 30:.0f}" height="{height:.0f}"'
    title = "The robot; colours of the points: widths of the intervals of their joints"
    # All texts in the elements are escaped.
    return Markup(f'<svg class="robot" role="img" aria-label="{title}" {box}>{"".join(elements)}</svg>')


def _widest_class(names: Sequence[str], rows: Iterable[ParameterRow]) -> int | None:
    """Return the width class of the widest interval of stiffness and damping at these joints; None without any."""
    terms = {f"{kind}_{name}" for name in names for kind in "kd"}
    return max((row.width_class for row in rows if row.name in terms), default=None)


def _joint(point: FloatArray, names: Sequence[str], rows: Mapping[str, ParameterRow]) -> str:
    terms = [rows[f"{kind}_{name}"] for name in names for kind in ("k", "d", "fm") if f"{kind}_{name}" in rows]
    width_class = _widest_class(names, rows.values())
    widths = ", ".join(f"{row.name} ±{percent(row.half_width)}" for row in terms) or "nothing identified here"
    css_class = "held" if width_class is None else f"w{width_class}"
    label = escape(", ".join(names))
    return (
        f"<g><title>{label}: {escape(widths)}</title>"
        f'<circle cx="{point[0]:.1f}" cy="{point[1]:.1f}" r="8" class="{css_class}"/>'
        f'<text x="{point[0] + 12:.1f}" y="{point[1] + 4:.1f}">{label}</text></g>'
    )


def _project(drawing: ModeDrawing) -> FloatArray:
    """Project points to pixels (n, 2), with the vertical axis up."""
    up = drawing.up
    right, depth = (up + 1) % 3, (up + 2) % 3
    p = drawing.points
    x = p[:, right] * np.cos(AZIMUTH) + p[:, depth] * np.sin(AZIMUTH)
    away = p[:, depth] * np.cos(AZIMUTH) - p[:, right] * np.sin(AZIMUTH)
    y = (-1.0 if drawing.hanging else 1.0) * p[:, up] * np.cos(ELEVATION) + away * np.sin(ELEVATION)
    view = np.stack([x - x.min(), y.max() - y], axis=1)
    return MARGIN + view * (SIZE - 2 * MARGIN) / max(float(np.ptp(view, axis=0).max()), 1e-9)


def first_screen(content: ReportContent, rows: tuple[ParameterRow, ...]) -> Mapping[str, Any]:
    """Return the values of the status bar and the three columns; with a sketch if the robot can be drawn."""
    drawing = next((row.drawing for row in content.modes if row.drawing is not None), None)
    robot = content.robot if drawing is not None else None
    classes: list[int | None] = [row.width_class for row in rows]
    if robot is not None:
        classes = [_widest_class(names, rows) for names in joint_groups(robot)]
    return {
        "sentence": run_summary.verdict_sentence(content.result, rows, content.agreements),
        "numbers_answer": run_summary.numbers_answer(content.result, rows, content.gears),
        "summary": content.summary,
        "sketch": robot_sketch(robot, drawing, rows) if robot is not None and drawing is not None else "",
        "widest": None if run_summary.is_wrong(content.result) else run_summary.widest(rows),
        "width_counts": [(label, i, classes.count(i)) for i, label in enumerate(WIDTH_WORDS)],
        "counted": "point" if robot else "parameter",
        "strip": residual_strip(content.validation.configurations),
        "residuals": run_summary.residual_sentence(content.result, content.agreements),
        "actions": next_steps(content.result, rows),
        "commands": COMMANDS,
        "meanings": meanings(content),
    }


def meanings(content: ReportContent) -> dict[str, str]:
    """Describe each spring and damper of the robot, by symbol."""
    if content.robot is None:
        return {}
    springs = spring_names(content.robot)
    names = [joint.name for joint in content.robot.joints]
    return {
        **{name: f"stiffness, {spring}" for name, spring in springs.items()},
        **{f"d{name[1:]}": f"damping, {spring}" for name, spring in springs.items()},
        **{f"f_{name}": f"viscous friction, joint {name} (link side)" for name in names},
        **{f"fm_{name}": f"viscous friction, motor {name}" for name in names},
    }


def row_axis(rows: Sequence[ParameterRow]) -> Mapping[str, Mapping[str, float | bool]]:
    """Return positions in pixels of interval ends, start and true value on a common axis ln(p / estimate).

    Marks beyond the axis are at its end. If an estimate or value is not positive, its relative deviation is used.
    """
    values = [(value, row) for row in rows for value in (*row.interval, row.truth) if value is not None]
    spread = [abs(_log_ratio(value, row.estimate)) for value, row in values]
    finite = [value for value in spread if math.isfinite(value)]
    # The axis extends to 2 % at least and to a factor of 100 at most, on either side.
    limit = float(np.clip(max(finite, default=0.0), math.log(1.02), math.log(100.0)))

    def place(value: float | None, row: ParameterRow) -> float:
        if value is None:
            return math.nan
        return round(60 * (1 + 0.94 * float(np.clip(_log_ratio(value, row.estimate) / limit, -1, 1))), 1)

    axis = {
        row.name: {
            key: place(value, row)
            for key, value in zip(("low", "high", "start", "truth"), (*row.interval, row.start, row.truth), strict=True)
        }
        for row in rows
    }
    return axis | {"": {"reach": math.exp(limit)}}


def _log_ratio(value: float, estimate: float) -> float:
    if value > 0 and estimate > 0:
        return math.log(value / estimate)
    if not estimate:
        return math.copysign(math.inf, value) if value else 0.0
    return (value - estimate) / abs(estimate)


DPI = 110


@dataclass(frozen=True)
class EmbeddedFigure:
    """Figure of the page: PNG in base64, empty if it is not on the page."""

    name: str
    section: str
    caption: str
    png: str
    file: str = ""


@default_style()
def write_page(
    page: Callable[[list[EmbeddedFigure]], str], drawings: Iterable[Drawing], folder: Path, formats: Collection[str],
    execution: Execution | None = None, name: str = "report.html",
) -> Path:  # fmt: skip
    """Write a page as folder/`name` and replace folder/figures/*; return its path.

    page(figures): returns the HTML.  All files are written atomically, the page last; equal content gives equal bytes.
    """
    figures = clear_folder(folder, "figures")
    figures.mkdir(parents=True)
    todo = [drawing for drawing in drawings if drawing.on_page or formats]
    embedded = (execution or Execution()).ordered(partial(_embed, figures if formats else None), todo)
    write_atomically(folder / name, page(embedded).encode("utf-8"))
    return folder / name


@default_style()
def _embed(figures: Path | None, drawing: Drawing) -> EmbeddedFigure:
    with rc_context({"axes.titley": 1.0}):  # automatic positions of titles would place all ticks twice
        figure = drawing.draw()
    png, name = render_png(figure), f"{drawing.name}.png"
    if figures is not None:
        write_atomically(figures / name, png)
    text = base64.b64encode(png).decode("ascii") if drawing.on_page else ""
    file = "" if figures is None else f"figures/{name}"
    return EmbeddedFigure(drawing.name, drawing.section, drawing.caption, text, file)


def html(content: ReportContent, figures: Collection[EmbeddedFigure]) -> str:
    """Render the page; every text from a study or a file is escaped."""
    free = set(content.result.parameters.free_names)
    has_rate = all(measured.has_rate for measured, _ in content.frf)
    left_out = [agreement.configuration for agreement in content.validation.configurations if agreement.is_validation]
    responses = explorer(content.frf, left_out, content.dense) if content.frf else ""
    modes = mode_viewer(content.modes, has_rate)
    scripts = curve_scripts() if responses else (asset("first_screen.js"),)
    scripts = (*scripts, asset("mode_viewer.js")) if modes else scripts
    rows = parameter_rows(content.result, content.truth, content.contents)
    fixed = [(p, content.result.values[p.name]) for p in content.result.parameters if p.name not in free]
    return render(
        "template.html.j2", content, figures, responses, scripts, **first_screen(content, rows),
        result=content.result, rows=rows, given=fixed, axis=row_axis(rows), mode_viewer=modes,
        agreements=content.validation.configurations, hz="Hz" if has_rate else "units of the sampling rate",
    )  # fmt: skip


def render(
    template: str, content: Any, figures: Collection[EmbeddedFigure], curves: str = "", scripts: Sequence[str] = (),
    **values: Any,
) -> str:  # fmt: skip
    """Render a page from a template, with data of the explorer (curves) and further values of the template."""
    names = {"content": content, "figures": figures, "explorer": curves, "scripts": scripts, "mode_viewer": ""} | values
    return _environment().get_template(template).render(names, asset=asset, policy=script_policy(scripts))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("elastid.report", "page"), autoescape=True, undefined=StrictUndefined
    )
    environment.trim_blocks = environment.lstrip_blocks = True
    environment.filters |= {
        "number": number, "digits": digits, "percent": percent, "capitalised": capitalise,
        "interval_of": format_interval, "grouped": group_notes,
        "friction_rows": friction_rows, "coded": _code_markup, "gear_table": gear_table, "gear_line": gear_line,
        "seen_words": gear_sentence,
    }  # fmt: skip
    return environment


def _code_markup(sentence: str) -> Markup:
    pieces = [escape(part) for part in sentence.split("`")]
    return Markup("").join(Markup("<code>{}</code>").format(part) if i % 2 else part for i, part in enumerate(pieces))


def render_png(figure: Figure) -> bytes:
    """Render a figure as PNG, without warnings for missing glyphs."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(buffer, format="rgba", dpi=DPI)
    width, height = (int(inches * DPI) for inches in figure.get_size_inches())
    image = Image.frombytes("RGBA", (width, height), buffer.getvalue())
    # 256 colours need less than half of the bytes, without a visible difference.
    palette = image.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    file = io.BytesIO()
    palette.save(file, "png", dpi=(DPI, DPI))  # the highest compression takes seven times as long and saves 10 %
    return file.getvalue()


def html_of_responses(content: ResponsesContent, figures: Collection[EmbeddedFigure]) -> str:
    """Render the page of responses; every text from a study or a file is escaped."""
    responses = explorer(list(zip(content.responses, content.synthesised, strict=True)))
    viewer = mode_viewer(content.mode_rows, content.has_rate)
    scripts = (*curve_scripts(), asset("mode_viewer.js")) if viewer else curve_scripts()
    return render(
        "responses.html.j2", content, figures, responses, scripts, mode_viewer=viewer,
        frequency_unit=style.frequency_unit(content.has_rate), questions=questions_of_responses(content),
    )  # fmt: skip
