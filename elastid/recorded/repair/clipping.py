"""A channel that runs into its limit: several samples in a row at its highest or lowest value, again and again."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair.finding import Finding, Log
from elastid.recorded.repair.quantisation import step

CLIPPED = "samples at a limit"
# So many equal samples in a row are no peak.
_RUN = 2
# Between two visits to a limit the signal leaves it by this part of its span.
_AWAY = 0.05
# A lone peak of a period may be flat; a limit is met at several places of a period.
_PLACES = 3
# Below this part of a channel a limit is worth a word, above it the response is another one.
MOST = 0.05
_FEWEST = 0.002
_SAME = 1e-9


def clipped(signals: FloatArray, L: int, log: Log) -> tuple[Finding, ...]:
    """A word for each channel of signals (n, c), finite, that meets its limits; DataError above 5 % of its samples."""
    findings = []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        at_limit = _at_limit(x)
        runs = _long_runs(at_limit)
        places = _visits(x, runs)
        share = float(runs.mean())
        if share < _FEWEST or places < _PLACES * max(1, len(x) // L):
            continue
        what = f"{name}: {int(runs.sum())} of {len(x)} samples ({100 * share:.2g} %) are at its limits of "
        what += f"{np.min(x):.4g} and {np.max(x):.4g}"
        if share > MOST:
            raise DataError(f"{log.where}: {what}: it is clipped; measure again with less torque or a wider range")
        findings.append(Finding(CLIPPED, int(runs.sum()), f"{what}: clipped there, measure with less torque"))
    return tuple(findings)


def _at_limit(x: FloatArray) -> BoolArray:
    """A limit is a value that the signal reaches from one side only and holds exactly."""
    span = np.max(x) - np.min(x)
    # Coarse steps make flat peaks, of which nobody can tell whether they are clipped.
    if step(x) > 0.01 * span:
        return np.zeros(len(x), dtype=np.bool_)
    near: BoolArray = (np.max(x) - x <= _SAME * span) | (x - np.min(x) <= _SAME * span)
    return near


def _long_runs(flags: BoolArray) -> BoolArray:
    edges = np.diff(np.concatenate([[0], flags.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long_runs = np.zeros(len(flags), dtype=np.bool_)
    for start, end in zip(starts, ends, strict=True):
        long_runs[start:end] = end - start >= _RUN
    return long_runs


def _visits(x: FloatArray, runs: BoolArray) -> int:
    """How often a signal comes to a limit from well away of it."""
    span = np.ptp(x)
    is_away = (np.max(x) - x > _AWAY * span) & (x - np.min(x) > _AWAY * span)
    state = (runs.astype(int) - is_away)[runs | is_away]
    return int(np.sum(np.diff(state) == 2))
