"""The page of a fleet: what differs and drifts first, then every parameter over robots and dates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from elastid.report.figures.drawings import Drawing
from elastid.report.figures.fleet import fleet_parameter
from elastid.report.page.page import FigureFormat, template, write_figures, write_whole
from elastid.validation.fleet import Finding, FleetValue


@dataclass(frozen=True)
class Outcome:
    """How the study of a robot on a date ended."""

    robot: str
    date: str
    status: str
    message: str

    @property
    def failed(self) -> bool:
        """Whether it left no numbers."""
        return self.status in ("failed", "died")

    @property
    def words(self) -> str:
        """As messages name it."""
        return f"{self.robot} on {self.date}"


@dataclass(frozen=True)
class FleetContent:
    """What a fleet shows.

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
        """What was found, in a sentence."""
        robots = len({each.robot for each in self.outcomes})
        done = sum(not each.failed for each in self.outcomes)
        told = f"{robots} robots, {done} of {len(self.outcomes)} measurements identified: "
        if not self.findings:
            return told + "no parameter differs or drifts beyond its interval."
        first = "; ".join(finding.words for finding in self.findings[:3])
        more = f"; and {len(self.findings) - 3} more" if len(self.findings) > 3 else ""
        return f"{told}{first}{more}."


def write_page_of_fleet(content: FleetContent, folder: Path) -> Path:
    """folder/fleet.html and folder/figures/*.png; the path of the page."""
    formats: tuple[FigureFormat, ...] = ("png",)
    figures = write_figures(content.title, _drawings(content), (), folder, formats)
    page = folder / "fleet.html"
    write_whole(page, template("fleet.html.j2").render(content=content, figures=figures).encode("utf-8"))
    return page


def _drawings(content: FleetContent) -> Iterator[Drawing]:
    names = list(dict.fromkeys(value.parameter for value in content.values))
    for number, name in enumerate(names, start=1):
        marked = {finding.robot for finding in content.findings if finding.parameter == name}
        own = [value for value in content.values if value.parameter == name]
        caption = f"{name} of every robot and date with its 95 % interval."
        draw = partial(fleet_parameter, name, content.units[name], own, marked)
        yield Drawing(f"fleet-{number:03d}", "parameters", caption, draw)
