"""A slow movement that does not repeat, such as a carrier off the lines: its leakage reaches into the excited lines."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.repair.finding import Finding, Log
from elastid.recorded.repair.repeats import blocks, flat

# A line is excited where the drivers have this part of the power of their strongest one.
_EXCITED = 1e-3
# Worth a word where it is half as large as what repeats, and a hundredth of the power at the lowest excited lines.
_LARGE = 0.25
_AT_THE_LINES = 0.01


def wandering(signals: FloatArray, drivers: IntArray, L: int, sign: int, log: Log) -> tuple[Finding, ...]:
    """A word for each channel of signals (n, c), no driver, that wanders below the excited lines, slope aside."""
    means = np.stack([blocks(signals[:, d], L, sign).mean(axis=0) for d in drivers])
    sent = np.sum(np.abs(np.fft.rfft(means)) ** 2, axis=0)[1:]
    lowest = 1 + int(np.flatnonzero(sent > _EXCITED * sent.max())[0])
    findings = []
    for c in range(signals.shape[1]):
        repeating, rest = _spectra(signals[:, c], L, sign)
        octave = slice(lowest, 2 * lowest + 1)
        size = float(np.sqrt(rest[:lowest].sum() / max(repeating.sum(), 1e-300)))
        is_there = size**2 > _LARGE and rest[octave].sum() > _AT_THE_LINES * repeating[octave].sum()
        if c in drivers or not is_there:
            continue
        word = (
            f"{log.names[c]}: moves slowly without repeating, {size:.2g} times as far as with the excitation; what "
            "leaks into the lowest lines counts as noise there: let a carrier repeat with the period, or raise band_hz"
        )
        findings.append(Finding("channels that wander", 1, word))
    return tuple(findings)


def _spectra(x: FloatArray, L: int, sign: int) -> tuple[FloatArray, FloatArray]:
    """Power of the mean of the repetitions, and mean power of what is left in each, line by line from 0."""
    X = flat(x, L, sign)
    mean = X.mean(axis=0)
    repeating: FloatArray = np.abs(np.fft.rfft(mean)) ** 2
    rest: FloatArray = np.mean(np.abs(np.fft.rfft(X - mean, axis=1)) ** 2, axis=0)
    return repeating, rest
