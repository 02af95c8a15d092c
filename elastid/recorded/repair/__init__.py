"""Faults of the logs of a real robot: a Finding is repaired by a stated rule and counted, reported, or refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import SupportsInt

from elastid.base.arrays import FloatArray
from elastid.base.note import Note


@dataclass(frozen=True)
class Finding:
    """kind: of the repair, by which counts are added up.  text: the fault, its place, its size, and the repair."""

    kind: str
    count: int
    text: str

    def note(self, place: str) -> Note:
        """The finding as a note on a record."""
        return Note(self.kind.replace(" ", "-"), self.text, place)


@dataclass(frozen=True)
class Repaired:
    """signals (n, c) after a repair; left_out: repetitions, counted from 0, that no longer count as measured."""

    signals: FloatArray
    findings: tuple[Finding, ...] = ()
    left_out: tuple[int, ...] = ()


@dataclass(frozen=True)
class Log:
    """Names of a log, its channels and its times in messages. first: number in the file of the first sample."""

    where: str
    names: tuple[str, ...]
    rate_hz: float | None = None
    first: int = 0

    def at(self, sample: SupportsInt) -> str:
        """A sample by its number in the file and, where the rate is known, its time."""
        number = self.first + int(sample)
        return f"sample {number}" + ("" if self.rate_hz is None else f" ({number / self.rate_hz:.6g} s)")


def counts(findings: Iterable[Finding]) -> dict[str, int]:
    """The counts of each kind, added up."""
    total: dict[str, int] = {}
    for finding in findings:
        total[finding.kind] = total.get(finding.kind, 0) + finding.count
    return total
