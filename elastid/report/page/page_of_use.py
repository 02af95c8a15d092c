"""Pages of use: a map of the workspace, a tuned move, joint loops; what limits each and what helps."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import degrees, number, percent
from elastid.base.escape import embedded_json
from elastid.base.files import write_whole
from elastid.report.figures.style import own_style
from elastid.report.figures.use import SHOWN, loops_figure, move_figure, workspace_figure
from elastid.report.overview import Questions
from elastid.report.page.explorer import asset
from elastid.report.page.page import render, rendered
from elastid.use.command.moves import KINDS
from elastid.use.command.tune import TunedMove
from elastid.use.loops.result import Loops
from elastid.use.loops.sensitivity import LIMIT_DB, Margins
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
        """Each spring: where it limits, its mean part, and the gain of one twice as stiff in the softest tenth."""
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
    return _written(folder / "map.html", page, rendered(workspace_figure(workspace)))


def _written(path: Path, page: str, picture: bytes) -> Path:
    write_whole(path.with_suffix(".png"), picture)
    write_whole(path, page.encode("utf-8"))
    return path


@dataclass(frozen=True)
class MoveContent:
    """A move with its figure as PNG in base64, and who made the fit (`Stamp.shown`)."""

    move: TunedMove
    title: str
    provenance: Mapping[str, str]
    figure: str

    @property
    def verdict(self) -> str:
        """Time, error and the limit that is used most."""
        rigid, own = self.move.outcomes[0], self.move.outcomes[-1]
        return (
            f"{self.move.duration:.4g} s: {self.move.frame} stays within {number(1e3 * own.largest, 3)} mm of its path "
            f"on the {self.move.judge}, with rigid feedforward within {number(1e3 * rigid.largest, 3)} mm."
        )

    @property
    def questions(self) -> Questions:
        """The three questions of the page, each with its sentences."""
        move = self.move
        largest = np.array([np.abs(getattr(move, kind)).max(axis=0) for kind in KINDS])
        used = largest / move.limits
        kind, i = np.unravel_index(int(np.argmax(used)), used.shape)
        most = f"the {list(KINDS)[kind]} of motor {move.joints[i]} is used most, {percent(used[kind, i], 3)} of it"
        kept = f"Yes: of all limits {most}." if used.any() else "No limit is given."
        advice = f"{move.advice}." if move.advice else "Give the drives tune.csv, or a file of the folder tune."
        return (
            ("How exactly does the tool follow?", (self.verdict,)),
            ("Do the motors keep their limits?", (kept,)),
            ("What next?", (advice[0].upper() + advice[1:],)),
        )

    @property
    def outcomes(self) -> list[list[str]]:
        """Cells of each command."""
        rows = []
        for own in self.move.outcomes:
            figures = [own.largest, own.rms, own.static, own.residual]
            figures += [] if own.high is None else [float(own.high.max())]
            rows.append([own.name, *(number(1e3 * each, 3) for each in figures), *[""][own.high is not None :]])
        return rows

    @property
    def limits(self) -> list[list[str]]:
        """Cells of each motor: the largest of each kind with its limit, and the torque on draws."""
        rows = []
        for i, (joint, unit) in enumerate(zip(self.move.joints, self.move.units, strict=True)):
            cells = [f"{joint} ({unit})"]
            for kind, limit in zip(KINDS, self.move.limits[:, i], strict=True):
                most = number(float(np.abs(getattr(self.move, kind)[:, i]).max()), 3)
                cells.append(f"{most} of {number(float(limit), 3)}" if np.isfinite(limit) else most)
            rows.append([*cells, number(float(self.move.most[i]), 4)])
        return rows


@own_style()
def write_page_of_move(move: TunedMove, folder: Path, provenance: Mapping[str, str]) -> Path:
    """folder/tune.html and folder/tune.png; the path of the page."""
    picture = rendered(move_figure(move))
    figure = base64.b64encode(picture).decode("ascii")
    page = render("move.html.j2", MoveContent(move, f"Move of {move.name}", provenance, figure), ())
    return _written(folder / "tune.html", page, picture)


@dataclass(frozen=True)
class LoopContent:
    """Loops with their figure as PNG in base64, the section to paste, and who made the fit (`Stamp.shown`)."""

    loops: Loops
    title: str
    provenance: Mapping[str, str]
    figure: str
    snippet: str

    @property
    def verdict(self) -> str:
        """Bandwidths, the limit and the mode that sets it."""
        own = self.loops.designed
        worst, least = int(np.argmax(own.peak_db)), own.bandwidth_hz.min(axis=0)
        each = ", ".join(f"{number(float(f), 3)} Hz in axis {axis}" for axis, f in zip(own.axes, least, strict=True))
        return (
            f"Bandwidths of {each} keep the sensitivity below {LIMIT_DB:g} dB in all {len(own.postures)} postures; "
            f"limited in {own.postures[worst]} by {own.limited_by[worst]}."
        )

    @property
    def margins(self) -> list[list[str]]:
        """Cells of each axis of each controller, the smallest over the postures, then as measured."""
        known: list[tuple[str, tuple[str, ...], FloatArray | None, Margins]] = [
            (state.name, state.axes, state.bandwidth_hz, state.margins) for state in self.loops.states
        ]
        known += [(f"measured, {own.configuration}", own.axes, None, own.margins) for own in self.loops.measured]
        rows = []
        for name, axes, bandwidth_hz, own in known:
            for i, axis in enumerate(axes):
                numbers = [np.nan if bandwidth_hz is None else bandwidth_hz[:, i].min()]
                numbers += [20 * np.log10(own.rise[:, i].min()), np.degrees(own.phase[:, i].min())]
                cells = (number(float(each), 3) for each in (*numbers, 1e3 * own.delay[:, i].min()))
                rows.append([name, axis, *cells])
        return rows


@own_style()
def write_page_of_loops(loops: Loops, snippet: str, folder: Path, provenance: Mapping[str, str]) -> Path:
    """folder/loops.html and folder/loops.png; the path of the page."""
    picture = rendered(loops_figure(loops))
    figure = base64.b64encode(picture).decode("ascii")
    content = LoopContent(loops, f"Joint loops of {loops.name}", provenance, figure, snippet)
    return _written(folder / "loops.html", render("loops.html.j2", content, ()), picture)
