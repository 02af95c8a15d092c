"""Samples of a channel that stays at one value while it moves at that phase in other repetitions: missing ones.

An encoder or a converter that hangs repeats its last value exactly; a joint that stands has noise, or stands in every
repetition, and where all channels are at one value the robot stops (`stops`) or has not started.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.repair import Finding, Log, Repaired, runs
from elastid.recorded.repair.converter import step


@dataclass(frozen=True)
class StuckLimits:
    """Limits of a channel that is stuck.  False alarms of 300 clean logs: stuck-samples 0."""

    min_run: int = 20  # samples with one value
    # Range of the other repetitions there: over the scatter of the channel, and in its steps.
    min_range: float = 0.25
    min_steps: float = 4.0


LIMITS = StuckLimits()


def without_stuck(signals: FloatArray, L: int, log: Log) -> Repaired:
    """Signals (n, c), some samples NaN, with NaN for samples that are stuck, where repetitions of L samples move."""
    result, findings = signals.copy(), []
    hold = np.diff(signals, axis=0) == 0
    for c, x in enumerate(signals.T):
        least = max(LIMITS.min_range * float(np.nanstd(x)), LIMITS.min_steps * step(x[np.isfinite(x)]))
        stuck = np.zeros(len(x), dtype=np.bool_)
        for start, end in runs(hold[:, c] & ~hold.all(axis=1), LIMITS.min_run - 1):
            others = [x[a : a + end + 1 - start] for a in range(start % L, len(x) - end + start, L) if a != start]
            if len(others) and min(float(np.ptp(other)) for other in others) > least:
                # The first value may be a measured one.
                stuck[start + 1 : end + 1] = True
        if not stuck.any():
            continue
        result[stuck, c] = np.nan
        text = f"{log.names[c]} is stuck for {stuck.sum()} samples from {log.time_of(np.flatnonzero(stuck)[0])} on"
        findings.append(Finding("stuck samples", int(stuck.sum()), f"{text}, while other periods move: not used"))
    return Repaired(result, tuple(findings))
