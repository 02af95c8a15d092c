"""Answer of a fleet: robots that differ or drift, outcome of each study, and a figure of each parameter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from elastid.base.display import Answer, Display, number, percent
from elastid.report.figures.drawings import Drawing
from elastid.report.figures.fit import fleet_parameter

if TYPE_CHECKING:
    from elastid.validation.fleet import Finding, FleetValue  # brings SciPy's statistics


@dataclass(frozen=True)
class Outcome:
    """Outcome of the study of a robot on a date."""

    robot: str
    date: str
    status: str
    message: str

    @property
    def failed(self) -> bool:
        """True if there are no parameters."""
        return self.status in ("failed", "died")

    @property
    def label(self) -> str:
        """Robot and date for messages."""
        return f"{self.robot} on {self.date}"


def answer_of_fleet(title: str, findings: Sequence[Finding], outcomes: Sequence[Outcome], rate: float) -> Answer:
    """Answer the three questions of every page; rate: false discovery rate of the findings."""
    n_robots, failures = len({run.robot for run in outcomes}), [run for run in outcomes if run.failed]
    robots = f"{n_robots} robot{'s' if n_robots > 1 else ''}"
    identified_text = f"{robots}, {len(outcomes) - len(failures)} of {len(outcomes)} measurements identified."
    answer, advice = "None beyond the natural spread.", "Measure again at the next service."
    if findings:
        answer = "; ".join(change.sentence for change in findings[:3])
        answer += f"; and {len(findings) - 3} more." if len(findings) > 3 else "."
        advice = f"Measure {findings[0].parameter} of {findings[0].robot} again first."
    elif max(n_robots, *Counter(run.robot for run in outcomes).values()) < 3:
        answer = "Not known: at least 3 robots, or 3 dates of one robot, are needed to estimate the natural spread."
    questions = (
        ("Are the numbers good?", (identified_text,)),
        ("Which robots differ or drift?", (answer,)),
        ("What next?", (advice,)),
    )
    runs = [(run.robot, run.date, run.status, run.message) for run in outcomes]
    tables = (
        Display("Findings", ("of", "finding", "change", "change / std", "chance"), list(map(_cells, findings))),
        Display("Robots and dates", ("robot", "date", "status", "message"), runs),
    )
    note = (
        "Findings are differences from other robots and trends over dates that exceed the intervals and the natural "
        f"spread. False discovery rate: {percent(rate)}."
    )
    return Answer(title, questions, tables if findings else tables[1:], (note,))


def _cells(finding: Finding) -> tuple[str, ...]:
    """Return the row of a finding in the table of findings."""
    meaning = f": {finding.meaning}" if finding.meaning else ""
    change = f"{number(100 * finding.change, 3)} %" if finding.is_relative else number(finding.change, 3)
    subject = f"{finding.parameter} of {finding.robot}"
    return subject, f"{finding.kind}{meaning}", change, number(finding.z, 3), number(finding.p, 2)


def drawings_of_fleet(
    values: Sequence[FleetValue], units: Mapping[str, str], findings: Sequence[Finding]
) -> Iterator[Drawing]:
    """Yield a figure of each parameter over robots and dates."""
    for count, name in enumerate(dict.fromkeys(value.parameter for value in values), start=1):
        robots = {finding.robot for finding in findings if finding.parameter == name}
        rows = [value for value in values if value.parameter == name]
        caption = f"{name} of every robot and date with its 95 % interval."
        draw = partial(fleet_parameter, name, units[name], rows, robots)
        yield Drawing(f"fleet-{count:03d}", "parameters", caption, draw)
