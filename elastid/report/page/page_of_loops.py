"""The page of joint loops: sensitivity against its limit, gains to paste, what limits them, margins by axis."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elastid.base.display import number
from elastid.base.files import write_whole
from elastid.report.figures.loops import loops_figure
from elastid.report.figures.style import own_style
from elastid.report.page.page import render, rendered
from elastid.use.loops.result import Loops
from elastid.use.loops.sensitivity import LIMIT_DB


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
        """Cells of each axis of each controller: the smallest over the postures, with the low end of its band."""
        rows = []
        for state in self.loops.states:
            for i, axis in enumerate(state.axes):
                low, own = state.margins_low, state.margins
                rise = 20 * np.log10(np.array([own.rise[:, i].min(), low.rise[:, i].min()]))
                phase = np.degrees([own.phase[:, i].min(), low.phase[:, i].min()])
                late = 1e3 * np.array([own.delay[:, i].min(), low.delay[:, i].min()])
                least = np.array([state.bandwidth_hz[:, i].min(), state.bandwidth_low[:, i].min()])
                rows.append([state.name, axis, *(_with_low(*pair) for pair in (least, rise, phase, late))])
        return rows


def _with_low(value: float, low: float) -> str:
    shown = number(float(value), 3) if np.isfinite(value) else "none"
    return f"{shown} ({number(float(low), 3)})" if np.isfinite(low) else shown


@own_style()
def write_page_of_loops(loops: Loops, snippet: str, folder: Path, provenance: Mapping[str, str]) -> Path:
    """folder/loops.html and folder/loops.png; the path of the page."""
    picture = rendered(loops_figure(loops), "png")
    figure = base64.b64encode(picture).decode("ascii")
    content = LoopContent(loops, f"Joint loops of {loops.name}", provenance, figure, snippet)
    write_whole(folder / "loops.png", picture)
    write_whole(folder / "loops.html", render("loops.html.j2", content, ()).encode("utf-8"))
    return folder / "loops.html"
