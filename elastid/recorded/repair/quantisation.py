r"""The steps of an encoder or converter, and the noise that they make.

.. math:: \sigma_q = q / \sqrt{12}

Where other noise is below half a step the error is no noise: it repeats with the signal, and the scatter from period
to period does not show it (Widrow and Kollar, Quantization Noise, 2008).
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.repair.finding import Finding, Log
from elastid.recorded.repair.repeats import blocks, flat

# Noise of steps below this part of the signal is not worth a word.
WORTH_A_WORD = 2e-3
# A signal of steps takes few values: on average each at least so often.
_OFTEN = 3.0
# How far from a whole number of steps a value may be.
_TOLERANCE = 0.02


def step(x: FloatArray) -> float:
    """The step q of a signal (n,), 0 where it has none: all finite values are whole steps apart, many of them alike."""
    values = np.unique(x[np.isfinite(x)])
    if len(values) < 2 or len(x) < _OFTEN * len(values):
        return 0.0
    gaps = np.diff(values)
    rounding = 1e-9 * np.abs(values).max()
    gaps = gaps[gaps > rounding]
    if gaps.size == 0:
        return 0.0
    smallest = float(gaps.min())
    # Over many steps together their size is known better than from one.
    q = float(gaps.sum() / np.round(gaps / smallest).sum())
    return q if np.all(np.abs(gaps / q - np.round(gaps / q)) < _TOLERANCE) else 0.0


def quantised(signals: FloatArray, L: int, sign: int, log: Log) -> tuple[Finding, ...]:
    """A word for each channel of signals (n, c) whose steps make noise that counts beside what repeats in it."""
    findings = []
    for c, name in enumerate(log.names):
        q = step(signals[:, c])
        if q == 0:
            continue
        X = flat(signals[:, c], L, sign)
        size, noise = float(X.mean(axis=0).std()), q / np.sqrt(12)
        if noise < WORTH_A_WORD * size:
            continue
        change = np.diff(blocks(signals[:, c], L, sign), axis=0).std() / np.sqrt(2)
        hidden = " that repeats with the signal, so that the scatter of the periods hides it" if change < noise else ""
        word = (
            f"{name}: steps of {q:.4g} make noise of {noise:.3g}, {100 * noise / max(size, 1e-300):.2g} % of the "
            f"signal{hidden}"
        )
        findings.append(Finding("quantised channels", 1, word))
    return tuple(findings)
