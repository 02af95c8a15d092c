"""Pages of the commands map, tune, loops and fleet: their answers, and the data of the interactive map."""

import base64
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from elastid.base.display import Answer
from elastid.base.escape import embedded_json
from elastid.base.files import write_atomically
from elastid.report.figures.style import default_style
from elastid.report.figures.use import DISPLAY_UNITS
from elastid.report.page.explorer import asset, pack
from elastid.report.page.page import EmbeddedFigure, render, render_png
from elastid.use.map import N_SOFTEST, WorkspaceMap


def map_data(workspace: WorkspaceMap) -> str:
    """Return postures, quantities and curves as JSON, numbers as base64 of float32."""
    m = workspace.sample
    x, y, z = m.position.T
    quantities = []
    for quantity in m.quantities:
        unit, factor = DISPLAY_UNITS[quantity.unit]
        low, high = quantity.interval
        columns = [pack(factor * values) for values in (quantity.value, low, high)]
        quantities.append({"name": quantity.name, "text": quantity.text, "unit": unit, "columns": columns})
    units = [(1.0, " m") if slides else (180 / np.pi, "°") for slides in m.sliding]
    angles = m.angles * [factor for factor, _ in units]
    content: dict[str, Any] = {
        "units": [unit for _, unit in units],
        "frame": m.frame, "joints": list(m.joints), "springs": list(m.springs), "is_path": m.is_path,
        "count": len(m), "angles": pack(angles), "asked": (m.asked + 1).tolist(),
        "places": [pack(values) for values in (x, y, np.hypot(x, y), z)], "share": pack(m.compliance_fraction),
        "quantities": quantities, "softest": m.softest[:N_SOFTEST].tolist(),
        "lines": pack(m.curve_hz), "curve": pack(1e6 * m.magnitude), "std": pack(1e6 * m.magnitude_std),
    }  # fmt: skip
    return embedded_json(content)


@default_style()
def write_page_of_answer(
    answer: Answer, figure: Callable[[], Figure], path: Path, made_by: str, data: str = ""
) -> Path:
    """Write the page of an answer with its figure, also as PNG; a map's data replace the figure on the page."""
    picture = render_png(figure())
    png = base64.b64encode(picture).decode("ascii")
    figures = [] if data else [EmbeddedFigure("", "", f"The figure of {answer.title}", png)]
    write_atomically(path.with_suffix(".png"), picture)
    write_atomically(path, html_of_answer(answer, made_by, figures, data).encode("utf-8"))
    return path


def html_of_answer(answer: Answer, made_by: str, figures: Collection[EmbeddedFigure], data: str = "") -> str:
    """Render the page of an answer; several figures are below its tables."""
    scripts = (asset("map.js"),) if data else ()
    return render("answer.html.j2", answer, figures, scripts=scripts, made_by=made_by, map_data=data)
