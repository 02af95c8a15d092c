"""Faults of the logs of a real robot: a Finding is repaired by a stated rule and counted, reported, or refused.

- time_stamps:   gaps in a column of times                 -> missing samples
                 uneven steps, or another rate than stated -> resampled
- clock:         a period of a fraction of samples         -> resampled
- lost_samples:  samples that the logger lost or doubled   -> missing samples
- missing:       NaN                                       -> the same phase of the other periods
- spikes:        single samples far off                    -> the same phase of the other periods
- clipping:      a channel that runs into its limit        -> reported, or refused
- quantisation:  the steps of an encoder                   -> reported with their noise
- drift:         a slow movement that does not repeat      -> reported
- delay:         two logs that started at different times  -> shifted

Arrays in, arrays and findings out. Signals are (n, c), periodic after L samples, with sign -1 as x(t + L) = -x(t).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import SupportsInt

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
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

    def time_of(self, sample: SupportsInt) -> str:
        """A sample by its number in the file and, where the rate is known, its time."""
        number = self.first + int(sample)
        return f"sample {number}" + ("" if self.rate_hz is None else f" ({number / self.rate_hz:.6g} s)")


def counts(findings: Iterable[Finding]) -> dict[str, int]:
    """The counts of each kind, added up."""
    total: dict[str, int] = {}
    for finding in findings:
        total[finding.kind] = total.get(finding.kind, 0) + finding.count
    return total


def runs(flags: BoolArray, least: int = 1) -> IntArray:
    """First sample and end (k, 2) of the runs of set flags (n,) that have at least so many samples."""
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)
    return np.asarray(bounds[bounds[:, 1] - bounds[:, 0] >= least])


def in_runs(flags: BoolArray, least: int) -> BoolArray:
    """The flags (n,) that belong to runs of at least so many."""
    result = np.zeros(len(flags), dtype=np.bool_)
    for start, end in runs(flags, least):
        result[start:end] = True
    return result
