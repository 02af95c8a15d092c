"""The page of a fleet: what differs and drifts first, then every parameter over robots and dates."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.report.figures.drawings import Drawing
from elastid.report.page.page import FigureFormat, render, write_page
from elastid.validation.fleet import Finding, FleetValue


def fleet_parameter(name: str, unit: str, values: Sequence[FleetValue], marked: Collection[str]) -> Figure:
    """One column a robot, its its dates from left to right; marked: robots with a finding."""
    figure, panels = style.panels(1, 1, (style.WIDE, 3.2), (0.8, 0.25, 0.85, 0.9), (0.0, 0.0))
    axes = panels[0, 0]
    robots = list(dict.fromkeys(value.robot for value in values))
    days = sorted({value.day for value in values})
    width = 0.6 / max(1, len(days))
    for is_marked in (False, True):
        own = [value for value in values if (value.robot in marked) == is_marked]
        if not own:
            continue
        x = [robots.index(v.robot) + width * (days.index(v.day) - (len(days) - 1) / 2) for v in own]
        looks = {"ms": 2.5, "elinewidth": 0.9, "color": style.FITTED if is_marked else style.TOTAL}
        text = "differs or drifts" if is_marked else "robot, dates from left to right"
        y, std = np.array([(value.value, value.std) for value in own]).T
        style.plot_intervals(axes, np.array(x), y, std, **looks, label=text)
    names_fit = len(robots) <= 40
    if names_fit:
        style.set_names(axes.xaxis, robots, rotation=90)
    style.label(axes, "" if names_fit else "robot", f"{style.plain(name)} in {style.pretty_unit(unit)}")
    return style.finish(figure, f"{name} over the fleet", [axes], [axes])


@dataclass(frozen=True)
class Outcome:
    """How the study of a robot on a date ended."""

    robot: str
    date: str
    status: str
    message: str

    @property
    def failed(self) -> bool:
        """True where it has no numbers."""
        return self.status in ("failed", "died")

    @property
    def words(self) -> str:
        """As messages name it."""
        return f"{self.robot} on {self.date}"


@dataclass(frozen=True)
class FleetContent:
    """Parameters of the robots of a fleet over dates, and their findings.

    units: of the parameters.  rate: false discovery rate of the findings.  made_by: versions and platform, in words.
    """

    title: str
    values: tuple[FleetValue, ...]
    units: Mapping[str, str]
    findings: tuple[Finding, ...]
    outcomes: tuple[Outcome, ...]
    rate: float
    made_by: str

    @property
    def verdict(self) -> str:
        """The findings in a sentence."""
        robots = len({outcome.robot for outcome in self.outcomes})
        done = sum(not outcome.failed for outcome in self.outcomes)
        count = f"{robots} robots, {done} of {len(self.outcomes)} measurements identified: "
        if not self.findings:
            return count + "no parameter differs or drifts beyond its interval."
        first = "; ".join(finding.words for finding in self.findings[:3])
        more = f"; and {len(self.findings) - 3} more" if len(self.findings) > 3 else ""
        return f"{count}{first}{more}."


def write_page_of_fleet(content: FleetContent, folder: Path) -> Path:
    """folder/fleet.html and folder/figures/*.png; the path of the page."""
    page = partial(render, "fleet.html.j2", content)
    formats: tuple[FigureFormat, ...] = ("png",)
    return write_page(content.title, page, _drawings(content), (), folder, formats, name="fleet.html")


def _drawings(content: FleetContent) -> Iterator[Drawing]:
    names = list(dict.fromkeys(value.parameter for value in content.values))
    for number, name in enumerate(names, start=1):
        marked = {finding.robot for finding in content.findings if finding.parameter == name}
        own = [value for value in content.values if value.parameter == name]
        caption = f"{name} of every robot and date with its 95 % interval."
        draw = partial(fleet_parameter, name, content.units[name], own, marked)
        yield Drawing(f"fleet-{number:03d}", "parameters", caption, draw)
