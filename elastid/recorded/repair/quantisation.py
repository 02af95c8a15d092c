r"""Steps of an encoder or converter, and their noise.

.. math:: \sigma_q = q / \sqrt{12}

Where other noise is below half a step the error repeats with the signal, so that the scatter from period to period
does not show it (Widrow and Kollar, Quantization Noise, 2008).
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.repair.finding import Finding, Log
from elastid.recorded.repair.repeats import blocks, flat

# Noise of steps is reported from this part of the signal on.
_MIN_NOISE_SHARE = 2e-3
# A signal of steps takes few values: on average each at least so many times.
_MIN_REPEATS = 3.0
# Distance of a value from a whole number of steps, in steps, at most.
_STEP_TOLERANCE = 0.02


def step(x: FloatArray) -> float:
    """The step q of a signal (n,), 0 where it has none: all finite values are whole steps apart, many of them equal."""
    values = np.unique(x[np.isfinite(x)])
    if len(values) < 2 or len(x) < _MIN_REPEATS * len(values):
        return 0.0
    gaps = np.diff(values)
    rounding = 1e-9 * np.abs(values).max()
    gaps = gaps[gaps > rounding]
    if gaps.size == 0:
        return 0.0
    smallest = float(gaps.min())
    # Many steps together give a more exact size than one.
    q = float(gaps.sum() / np.round(gaps / smallest).sum())
    return q if np.all(np.abs(gaps / q - np.round(gaps / q)) < _STEP_TOLERANCE) else 0.0


def find_steps(signals: FloatArray, L: int, sign: int, log: Log) -> tuple[Finding, ...]:
    """A finding for each channel of signals (n, c) with a noise of steps that counts beside its repeating part."""
    findings = []
    for c, name in enumerate(log.names):
        q = step(signals[:, c])
        if q == 0:
            continue
        X = flat(signals[:, c], L, sign)
        size, noise = float(X.mean(axis=0).std()), q / np.sqrt(12)
        if noise < _MIN_NOISE_SHARE * size:
            continue
        change = np.diff(blocks(signals[:, c], L, sign), axis=0).std() / np.sqrt(2) if len(X) > 1 else np.inf
        hidden = " that repeats with the signal, so that the scatter of the periods hides it" if change < noise else ""
        text = (
            f"{name}: steps of {q:.4g} make noise of {noise:.3g}, {100 * noise / max(size, 1e-300):.2g} % of the "
            f"signal{hidden}"
        )
        findings.append(Finding("quantised channels", 1, text))
    return tuple(findings)
