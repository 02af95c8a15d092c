"""Pages of use: a map of the workspace to explore, and the answer of any other command."""

from __future__ import annotations

import base64
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.display import degrees, number
from elastid.base.escape import embedded_json
from elastid.base.files import write_whole
from elastid.report.answer import Answer
from elastid.report.figures.style import own_style
from elastid.report.figures.use import SHOWN, workspace_figure
from elastid.report.page.explorer import asset
from elastid.report.page.page import EmbeddedFigure, render, rendered
from elastid.use.map import WorkspaceMap

LISTED = 10


@dataclass(frozen=True)
class MapContent:
    """A map with its title, and who made the fit (`Stamp.shown`)."""

    workspace: WorkspaceMap
    title: str
    provenance: Mapping[str, str]

    @property
    def verdict(self) -> str:
        """Range, place and cause of the softest posture."""
        m = self.workspace
        own, order = m["softest_compliance"], m.softest
        soft, stiff = int(order[0]), int(order[-1])
        where = ", ".join(number(float(c), 3) for c in m.position[soft])
        return (
            f"{len(m)} postures: {_value(own.value[stiff], 'm/N')} to {_value(own.value[soft], 'm/N')} in the softest "
            f"direction, softest with {m.frame} at ({where}) m, where {m.limiting_springs[soft]} gives "
            f"{100 * float(m.share[soft].max(initial=0.0)):.0f} %."
        )

    @property
    def softest(self) -> list[dict[str, str]]:
        """The softest postures, as cells."""
        m, rows = self.workspace, []
        for i in m.softest[:LISTED].tolist():
            rows.append({
                "number": str(i), "posture": str(int(m.asked[i]) + 1),
                "angles": degrees(m.angles[i].tolist(), m.sliding),
                "direction": ", ".join(f"{c:.2f}" for c in m.axes[i, :, 0].tolist()),
                "compliance": _value(m["softest_compliance"].value[i], "m/N"),
                "std": f"{100 * float(m['softest_compliance'].relative_std[i]):.2g} %",
                "frequency": _value(m["frequency_1"].value[i], "Hz"), "cut": _value(m["depth_of_cut"].value[i], "m"),
                "spring": m.limiting_springs[i], "share": f"{100 * float(m.share[i].max(initial=0.0)):.0f} %",
            })  # fmt: skip
        return rows

    @property
    def springs(self) -> list[dict[str, str]]:
        """Springs: where each limits, its mean part, and the gain of one twice as stiff in the softest tenth."""
        m = self.workspace
        first = m.softest[: max(1, len(m) // 10)]
        limiting = np.array(m.limiting_springs)
        rows = [
            (float(m.share[first, i].mean()), name, float(np.mean(limiting == name)), float(m.share[:, i].mean()))
            for i, name in enumerate(m.springs)
        ]
        return [
            {"name": name}
            | {key: f"{100 * part:.0f} %" for key, part in (("limits", where), ("mean", mean), ("gain", soft / 2))}
            for soft, name, where, mean in sorted(rows, reverse=True)
        ]

    @property
    def load(self) -> str:
        """The load and the cutting coefficient in words."""
        m = self.workspace
        force = ", ".join(f"{part:g}" for part in m.load)
        return f"load ({force}) N; cutting coefficient {1e-6 * m.cutting_coefficient:g} N/mm²"


def _value(value: float, unit: str) -> str:
    shown, factor = SHOWN[unit]
    return f"{number(factor * float(value), 3)} {shown}" if np.isfinite(value) else "no limit"


def _packed(values: FloatArray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode("ascii")


def map_data(workspace: WorkspaceMap) -> str:
    """Postures, quantities and curves as JSON, numbers as base64 of float32."""
    m = workspace
    # Of more postures, evenly thinned ones are on the page.
    kept = np.unique(np.linspace(0, len(m) - 1, min(len(m), 2000)).round().astype(int))
    kept = np.union1d(kept, m.softest[:LISTED])
    place = {int(i): k for k, i in enumerate(kept)}
    x, y, z = m.position[kept].T
    quantities = []
    for own in m.quantities:
        unit, factor = SHOWN[own.unit]
        low, high = own.interval
        columns = [_packed(factor * part[kept]) for part in (own.value, low, high)]
        quantities.append({"name": own.name, "text": own.text, "unit": unit, "columns": columns})
    units = [(1.0, " m") if slides else (180 / np.pi, "°") for slides in m.sliding]
    angles = m.angles[kept] * [factor for factor, _ in units]
    content: dict[str, Any] = {
        "units": [unit for _, unit in units],
        "frame": m.frame, "joints": list(m.joints), "springs": list(m.springs), "is_path": m.is_path,
        "count": len(kept), "angles": _packed(angles), "asked": (m.asked[kept] + 1).tolist(),
        "places": [_packed(part) for part in (x, y, np.hypot(x, y), z)], "share": _packed(m.share[kept]),
        "quantities": quantities, "softest": [place[int(i)] for i in m.softest[:LISTED]],
        "lines": _packed(m.curve_hz), "curve": _packed(1e6 * m.magnitude[kept]),
        "std": _packed(1e6 * m.magnitude_std[kept]),
    }  # fmt: skip
    return embedded_json(content)


@own_style()
def write_page_of_map(workspace: WorkspaceMap, folder: Path, provenance: Mapping[str, str]) -> Path:
    """folder/map.html and folder/map.png; the path of the page."""
    content = MapContent(workspace, f"Map of {workspace.name}", provenance)
    page = render("map.html.j2", content, (), scripts=(asset("map.js"),), map_data=map_data(workspace))
    write_whole(folder / "map.png", rendered(workspace_figure(workspace)))
    write_whole(folder / "map.html", page.encode("utf-8"))
    return folder / "map.html"


@own_style()
def write_page_of_answer(
    answer: Answer, figure: Callable[[], Figure], path: Path, provenance: Mapping[str, str]
) -> Path:
    """The page of an answer with its figure, which is written beside it as PNG; its path."""
    picture = rendered(figure())
    png = base64.b64encode(picture).decode("ascii")
    page = html_of_answer(answer, provenance["made by"], [EmbeddedFigure("", "", f"The figure of {answer.title}", png)])
    write_whole(path.with_suffix(".png"), picture)
    write_whole(path, page.encode("utf-8"))
    return path


def html_of_answer(answer: Answer, made_by: str, figures: Collection[EmbeddedFigure]) -> str:
    """The page of an answer; several figures stand below its tables."""
    return render("answer.html.j2", answer, figures, made_by=made_by)
