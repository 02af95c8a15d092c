"""The page of a tuned move: error of the tool by command with its band, torques against limits, and what to do next."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from elastid.base.display import number, percent
from elastid.base.files import write_whole
from elastid.report.figures.move import move_figure
from elastid.report.figures.style import own_style
from elastid.report.overview import Questions
from elastid.report.page.page import render, rendered
from elastid.use.command.limits import KINDS
from elastid.use.command.tune import TunedMove


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
    picture = rendered(move_figure(move), "png")
    figure = base64.b64encode(picture).decode("ascii")
    page = render("move.html.j2", MoveContent(move, f"Move of {move.name}", provenance, figure), ())
    write_whole(folder / "tune.png", picture)
    write_whole(folder / "tune.html", page.encode("utf-8"))
    return folder / "tune.html"


@own_style()
def write_figure(path: Path, figure: Figure) -> Path:
    """A figure as PNG."""
    write_whole(path, rendered(figure, "png"))
    return path
