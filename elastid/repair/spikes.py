"""Single samples far off are replaced by what the other repetitions say of them (Hampel's rule across periods).

    e = x - median over periods,   d = |e - running median of e|,   a spike where d > 8 sigma and d > 3 d beside it

The running median keeps drift, transients and slow changes out; a burst of oscillation has neighbours of its own size.
"""

from __future__ import annotations

import numpy as np

from elastid.arrays import FloatArray, IntArray
from elastid.repair.finding import Finding, Log, Repaired
from elastid.repair.quantisation import step
from elastid.repair.repeats import expected

REPLACED = "spikes replaced"
SIGMAS = 8.0
FEWEST_PERIODS = 3
# More than this part of a channel are no single spikes.
MOST = 0.01
_WINDOW = 11
_LONGEST = 3
_BESIDE = 12
_ABOVE_BESIDE = 3.0


def despiked(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """Signals (P L, c), finite, without spikes of up to three samples; as they are for fewer than three repetitions."""
    if len(signals) // L < FEWEST_PERIODS:
        return Repaired(signals)
    result, findings = signals.copy(), []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        usual, spikes = _spikes(x, L, sign)
        if spikes.size == 0:
            continue
        if spikes.size > MOST * len(x):
            word = f"{name}: {spikes.size} of {len(x)} samples stand out of the others; so many are left as they are"
            findings.append(Finding("spikes left", int(spikes.size), word))
            continue
        result[spikes, c] = usual[spikes]
        word = (
            f"{name}: {spikes.size} of {len(x)} samples are spikes, the first is {log.at(spikes[0])}: replaced by the "
            "median of the other periods"
        )
        findings.append(Finding(REPLACED, int(spikes.size), word))
    return Repaired(result, tuple(findings))


def _spikes(x: FloatArray, L: int, sign: int) -> tuple[FloatArray, IntArray]:
    """What is usual (n,) for each sample, and the numbers of the spikes."""
    from scipy.ndimage import median_filter

    e = x - expected(x, L, sign, np.ones(len(x), dtype=np.bool_), robust=True)
    local = median_filter(e, _WINDOW, mode="mirror")
    d = np.abs(e - local)
    usual = x - e + local
    far = np.flatnonzero(d > max(_threshold(d), 2 * step(x), 1e-9 * np.ptp(x)))
    if far.size == 0:
        return usual, far
    runs = np.split(far, np.flatnonzero(np.diff(far) > 1) + 1)
    return usual, np.concatenate([run for run in runs if _is_alone(d, run)] or [far[:0]])


def _threshold(d: FloatArray) -> float:
    """8 sigma, sigma from the median; where most samples agree exactly, from the smaller 99 %."""
    sigma = 1.4826 * float(np.median(d))
    if sigma == 0:
        sigma = float(np.sqrt(np.mean(np.sort(d)[: int(0.99 * len(d))] ** 2)))
    return SIGMAS * sigma


def _is_alone(d: FloatArray, run: IntArray) -> bool:
    if len(run) > _LONGEST:
        return False
    first, last = int(run[0]), int(run[-1])
    beside = np.concatenate([d[max(0, first - _BESIDE) : max(0, first - 1)], d[last + 2 : last + 2 + _BESIDE]])
    return bool(d[run].max() > _ABOVE_BESIDE * beside.max(initial=0.0))
