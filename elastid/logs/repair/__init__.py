"""Faults in the logs of a real robot: each fault is repaired by a stated rule and counted, reported, or rejected.

This module has the functions that all rules share: the repetitions of a signal. Inputs are arrays; outputs are arrays
and findings. Signals are (n, c) with a period of L samples; sign -1 means x(t + L) = -x(t).
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import SupportsInt

import numpy as np

from elastid.base.arrays import FloatArray, IntArray, fold_periods
from elastid.base.errors import DataError, Note, Severity

MAX_WRONG_FRACTION = 0.01  # largest fraction of wrong samples, cells or time steps that are treated as missing


@dataclass
class Findings:
    """Notes without a location, counts of corrections by kind, and indices of repetitions that are no measurement."""

    notes: list[Note] = field(default_factory=list)
    repairs: Counter[str] = field(default_factory=Counter)
    discarded_periods: list[int] = field(default_factory=list)

    def at(self, location: str) -> tuple[Note, ...]:
        """Return the notes with their place."""
        return tuple(replace(note, place=location) for note in self.notes)


@dataclass(frozen=True)
class LogReport:
    """Names of a log, its channels and its times in messages, and all findings in it.

    first: row of the first sample in the file.  rows (n,): row of each sample in the file if its time stamps have gaps,
    else None.  scale: samples at the rate of the study per sample.
    """

    where: str
    names: tuple[str, ...]
    rate_hz: float | None = None
    first: int = 0
    rows: IntArray | None = None
    scale: float = 1.0
    findings: Findings = field(default_factory=Findings)

    def note(self, code: str, text: str, severity: Severity = "warning") -> None:
        """Add a note."""
        self.findings.notes.append(Note(code, text, severity=severity))

    def error(self, code: str, text: str) -> DataError:
        """Return the error of a log that is of no use."""
        return DataError(code, text, self.where)

    def report(self, kind: str, count: SupportsInt, text: str, code: str = "records/corrected") -> None:
        """Count the samples or repetitions of a fault by kind, and add a note on it unless `text` is empty."""
        if text:
            self.note(code, text)
        self.findings.repairs[kind] += int(count)

    def after(self, first: int) -> "LogReport":
        """Return the log from a sample on."""
        rows = None if self.rows is None else self.rows[first:]
        return replace(self, first=self.first + round(first * self.scale), rows=rows)

    def number(self, sample: SupportsInt) -> int:
        """Return the number in the file of a sample, or of the end of all."""
        i = int(sample)
        if self.rows is None:
            return self.first + round(i * self.scale)
        return int(self.rows[i]) if i < len(self.rows) else int(self.rows[-1]) + 1 + i - len(self.rows)

    def time_of(self, sample: SupportsInt) -> str:
        """Return a sample by its number in the file and, where the rate is known, its time."""
        seconds = 0.0 if self.rate_hz is None else (self.first / self.scale + int(sample)) / self.rate_hz
        instant = "" if self.rate_hz is None else f" ({seconds:.6g} s)"
        return f"sample {self.number(sample)}{instant}"


def blocks(x: FloatArray, L: int, sign: int = 1) -> FloatArray:
    """Fold to X (P, L): the whole repetitions of a signal (n,), every second one with opposite sign if sign is -1."""
    X = fold_periods(x, L)
    return X * float(sign) ** np.arange(len(X))[:, None]


def interpolate_linearly(x: FloatArray) -> FloatArray:
    """Interpolate missing samples of a signal (n,) linearly; 0 without any sample."""
    finite = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(len(x)), finite, x[finite]) if finite.size else np.zeros(len(x))


def detrend_repetitions(x: FloatArray, L: int, sign: int = 1) -> FloatArray:
    """Return the repetitions of a signal (n,) as rows (P, L) without their means and slopes.  sign: as for `blocks`."""
    return without_line(blocks(x, L, sign))


def without_line(X: FloatArray) -> FloatArray:
    """Remove from each row of X (..., L), NaN where missing, its mean and slope (least squares)."""
    good, t = np.isfinite(X), np.linspace(-0.5, 0.5, X.shape[-1])
    n = np.maximum(good.sum(axis=-1, keepdims=True), 1)
    t_centred = np.where(good, t - (good @ t)[..., None] / n, 0.0)
    away = X - np.where(good, X, 0.0).sum(axis=-1, keepdims=True) / n
    slope = np.nansum(t_centred * away, axis=-1) / np.maximum(np.sum(t_centred**2, axis=-1), 1e-300)
    return np.asarray(away - t_centred * slope[..., None])
