"""Missing samples (NaN) of a record without a period, which no other period can fill.

Gaps of a sample or two are filled by the cubic through the samples beside them; a longer gap is refused with the
longest piece of the log that has none.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair.finding import Finding, Log, Repaired

FILLED = "missing samples interpolated"
# Samples of a gap at most, and the part of a channel that may be missing.
_MAX_GAP = 2
_MAX_MISSING_SHARE = 0.01
# Samples on each side of a gap that its cubic goes through.
_SAMPLES_BESIDE = 2


def bridged_gaps(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c) without NaN; DataError for long gaps, or too many, with the piece of the log that is complete."""
    result, findings = signals.copy(), []
    for c in range(signals.shape[1]):
        good = np.isfinite(signals[:, c])
        missing = np.flatnonzero(~good)
        if missing.size == 0:
            continue
        what = f"{log.names[c]}: {missing.size} of {len(good)} samples are missing (NaN or infinite), the first is "
        what += log.at(missing[0])
        runs = np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)
        is_inside = missing[0] >= _SAMPLES_BESIDE and missing[-1] < len(good) - _SAMPLES_BESIDE
        is_short = max(map(len, runs)) <= _MAX_GAP and missing.size <= _MAX_MISSING_SHARE * len(good)
        if not (is_inside and is_short):
            first, last = _longest_piece(np.asarray(np.isfinite(signals).all(axis=1)))
            raise DataError(
                f"{log.where}: {what}, and a record without a period has no other one to fill them from; the longest "
                f"piece without gaps is samples: [{log.first + first}, {log.first + last}]: use that, or measure again"
            )
        for run in runs:
            beside = np.flatnonzero(good[: run[0]])[-_SAMPLES_BESIDE:].tolist()
            beside += (run[-1] + 1 + np.flatnonzero(good[run[-1] + 1 :])[:_SAMPLES_BESIDE]).tolist()
            cubic = np.polynomial.Polynomial.fit(beside, signals[beside, c], 3)
            result[run, c] = cubic(run)
        findings.append(Finding(FILLED, int(missing.size), f"{what}: interpolated between the samples beside them"))
    return Repaired(result, tuple(findings))


def _longest_piece(good: BoolArray) -> tuple[int, int]:
    edges = np.diff(np.concatenate([[0], good.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if starts.size == 0:
        return 0, 0
    best = int(np.argmax(ends - starts))
    return int(starts[best]), int(ends[best])
