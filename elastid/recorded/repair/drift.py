"""A slow movement that does not repeat, such as a carrier off the lines: its leakage reaches into the excited lines."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.repair.finding import Finding, Log
from elastid.recorded.repair.repeats import blocks, flat

# A line is excited where the drivers have this part of the power of their strongest line.
_MIN_EXCITED_SHARE = 1e-3
# Power of the drift over the repeating part from which on it is reported: below the excited lines, and in their lowest
# octave.
_MIN_DRIFT_POWER = 0.25
_MIN_LEAKED_POWER = 0.01


def find_drift(signals: FloatArray, drivers: IntArray, L: int, sign: int, log: Log) -> tuple[Finding, ...]:
    """A finding for each channel of signals (n, c), no driver, that drifts below the excited lines, slope removed."""
    means = np.stack([blocks(signals[:, d], L, sign).mean(axis=0) for d in drivers])
    sent = np.sum(np.abs(np.fft.rfft(means)) ** 2, axis=0)[1:]
    lowest = 1 + int(np.flatnonzero(sent > _MIN_EXCITED_SHARE * sent.max())[0])
    findings = []
    for c in range(signals.shape[1]):
        repeating, rest = _spectra(signals[:, c], L, sign)
        octave = slice(lowest, 2 * lowest + 1)
        size = float(np.sqrt(rest[:lowest].sum() / max(repeating.sum(), 1e-300)))
        is_there = size**2 > _MIN_DRIFT_POWER and rest[octave].sum() > _MIN_LEAKED_POWER * repeating[octave].sum()
        if c in drivers or not is_there:
            continue
        text = (
            f"{log.names[c]}: moves slowly without repeating, {size:.2g} times as far as with the excitation; its "
            "leakage into the lowest lines counts as noise: let a carrier repeat with the period, or raise band_hz"
        )
        findings.append(Finding("drifting channels", 1, text))
    return tuple(findings)


def _spectra(x: FloatArray, L: int, sign: int) -> tuple[FloatArray, FloatArray]:
    """Power of the mean of the repetitions, and mean power of their deviations from it, line by line from 0."""
    X = flat(x, L, sign)
    mean = X.mean(axis=0)
    return np.abs(np.fft.rfft(mean)) ** 2, np.mean(np.abs(np.fft.rfft(X - mean, axis=1)) ** 2, axis=0)
