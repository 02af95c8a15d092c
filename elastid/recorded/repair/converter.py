"""Limits and steps of a converter: clipping at the highest or lowest value, and quantisation with its noise."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log
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


CLIPPED = "samples at a limit"
# So many equal samples in a row are no peak.
_MIN_RUN = 2
# Between two visits to a limit the signal leaves it by this part of its span.
_MIN_DEPARTURE = 0.05
# A single peak of a period may be flat; a limit is met at several places of a period.
_MIN_PLACES = 3
# Parts of a channel at its limits from which on they are reported, and from which on the response is spoilt.
_MIN_CLIPPED_SHARE = 0.002
_MAX_CLIPPED_SHARE = 0.05
# A rounded signal that turns exceeds its limit by so many steps of rounding at most, by a parabola through at least so
# many samples on each side.
_MAX_ROUNDING = 2.0
_MIN_BESIDE = 3
# Values this close, as a part of the span, are equal.
_EQUAL_TOLERANCE = 1e-9
# Steps of more than this part of the span make flat peaks that cannot be distinguished from clipped ones.
_MAX_STEP_SHARE = 0.01


def find_clipping(signals: FloatArray, L: int, log: Log) -> tuple[Finding, ...]:
    """A finding for each channel of finite signals (n, c) that meets its limits; DataError above 5 % of its samples."""
    findings = []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        at_limit = _at_limit(x)
        runs = _long_runs(at_limit) & ~_dwells(x, at_limit)
        places = _visits(x, runs)
        share = float(runs.mean())
        if share < _MIN_CLIPPED_SHARE or places < _MIN_PLACES * max(1, len(x) // L):
            continue
        what = f"{name}: {int(runs.sum())} of {len(x)} samples ({100 * share:.2g} %) are at its limits of "
        what += f"{np.min(x):.4g} and {np.max(x):.4g}"
        if share > _MAX_CLIPPED_SHARE:
            raise DataError(f"{log.where}: {what}: it is clipped; measure again with less torque or a wider range")
        findings.append(Finding(CLIPPED, int(runs.sum()), f"{what}: clipped there, measure with less torque"))
    return tuple(findings)


def _at_limit(x: FloatArray) -> BoolArray:
    """Flags (n,) of the samples at the highest or lowest value."""
    span = np.max(x) - np.min(x)
    if step(x) > _MAX_STEP_SHARE * span:
        return np.zeros(len(x), dtype=np.bool_)
    return np.asarray((np.max(x) - x <= _EQUAL_TOLERANCE * span) | (x - np.min(x) <= _EQUAL_TOLERANCE * span))


def _dwells(x: FloatArray, at_limit: BoolArray) -> BoolArray:
    """Flags (n,) of the runs in which a rounded signal turns: a parabola beside them goes no further than rounding."""
    gaps = np.diff(np.sort(x))
    gaps = gaps[gaps > _EQUAL_TOLERANCE * float(np.ptp(x))]
    rounding = float(gaps.min()) if gaps.size else 0.0
    edges = np.diff(np.concatenate([[0], at_limit.astype(int), [0]]))
    dwells = np.zeros(len(x), dtype=np.bool_)
    for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        reach = max(_MIN_BESIDE, int(end - start))
        beside = np.r_[max(0, start - reach) : start, end : min(len(x), end + reach)]
        if len(beside) < 2 * reach:
            continue
        t = (beside - (start + end - 1) / 2) / reach
        peak = np.linalg.lstsq(np.vander(t, 3), x[beside] - x[start], rcond=None)[0][2]
        dwells[start:end] = abs(peak) <= _MAX_ROUNDING * rounding
    return dwells


def _long_runs(flags: BoolArray) -> BoolArray:
    edges = np.diff(np.concatenate([[0], flags.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long_runs = np.zeros(len(flags), dtype=np.bool_)
    for start, end in zip(starts, ends, strict=True):
        long_runs[start:end] = end - start >= _MIN_RUN
    return long_runs


def _visits(x: FloatArray, runs: BoolArray) -> int:
    """Number of times that a signal comes to a limit from well away of it."""
    span = np.ptp(x)
    is_away = (np.max(x) - x > _MIN_DEPARTURE * span) & (x - np.min(x) > _MIN_DEPARTURE * span)
    state = (runs.astype(int) - is_away)[runs | is_away]
    return int(np.sum(np.diff(state) == 2))
