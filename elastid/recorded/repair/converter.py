r"""Limits and steps of a converter: clipping at the highest or lowest value, and quantisation with its noise.

.. math:: \sigma_q = q / \sqrt{12}

Where other noise is below half a step the error repeats with the signal, so that the scatter from period to period
does not show it (Widrow and Kollar, Quantization Noise, 2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, flat, in_runs, runs

CLIPPED = "samples at a limit"


@dataclass(frozen=True)
class ConverterLimits:
    """Limits of the findings on clipping and quantisation."""

    min_noise_share: float = 2e-3  # noise of steps is reported from this part of the signal on
    min_repeats: float = 3.0  # a signal of steps takes few values: on average each at least so many times
    min_values: int = 4  # fewer are levels that a torque was given: of a hammer, a binary or a ternary sequence
    step_tolerance: float = 0.02  # distance of a value from a whole number of steps, in steps, at most
    # Steps of more than this part of the span make flat peaks that cannot be distinguished from clipped ones.
    max_step_share: float = 0.01
    min_run: int = 2  # so many equal samples in a row are no peak
    min_departure: float = 0.05  # between two visits to a limit the signal leaves it by this part of its span
    min_places: int = 3  # a single peak of a period may be flat; a limit is met at several places of a period
    # Parts of a channel at its limits from which on they are reported, and from which on the response is spoilt.
    min_clipped_share: float = 0.002
    max_clipped_share: float = 0.05
    # A rounded signal that turns exceeds its limit by so many steps of rounding at most, by a parabola through at least
    # so many samples on each side.
    max_rounding: float = 2.0
    min_side_samples: int = 3
    equal_tolerance: float = 1e-9  # values this close, as a part of the span, are equal


LIMITS = ConverterLimits()


def step(x: FloatArray) -> float:
    """The step q of a signal (n,), 0 where it has none: all finite values are whole steps apart, many of them equal."""
    finite = x[np.isfinite(x)]
    # Half of the samples may already have more values than all may.
    if len(x) < LIMITS.min_repeats * len(np.unique(finite[: len(finite) // 2])):
        return 0.0
    values = np.unique(finite)
    if len(values) < 2 or len(x) < LIMITS.min_repeats * len(values):
        return 0.0
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * np.abs(values).max()]
    if gaps.size == 0:
        return 0.0
    # Many steps together give a more exact size than one.
    q = float(gaps.sum() / np.round(gaps / gaps.min()).sum())
    return q if np.all(np.abs(gaps / q - np.round(gaps / q)) < LIMITS.step_tolerance) else 0.0


def find_steps(signals: FloatArray, L: int, sign: int, log: Log) -> tuple[Finding, ...]:
    """A finding for each channel of signals (n, c) with a noise of steps that counts relative to its repeating part."""
    findings = []
    for c, name in enumerate(log.names):
        q = step(signals[:, c])
        if q == 0 or np.ptp(signals[:, c]) < (LIMITS.min_values - 1.5) * q:
            continue
        X = flat(signals[:, c], L, sign)
        size, noise = float(X.mean(axis=0).std()), q / np.sqrt(12)
        if noise < LIMITS.min_noise_share * size:
            continue
        text = (
            f"{name}: steps of {q:.4g} make noise of {noise:.3g}, {100 * noise / max(size, 1e-300):.2g} % of the "
            "signal, which the scatter of the periods may not show"
        )
        findings.append(Finding("quantised channels", 1, text))
    return tuple(findings)


def find_clipping(signals: FloatArray, L: int, log: Log) -> tuple[Finding, ...]:
    """A finding for each channel of finite signals (n, c) that meets its limits; DataError above 5 % of its samples."""
    findings = []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        at_limit = _at_limit(x)
        if not at_limit.any():
            continue
        clipped = in_runs(at_limit, LIMITS.min_run) & ~_dwells(x, at_limit)
        share, n_clipped = float(clipped.mean()), int(clipped.sum())
        if share < LIMITS.min_clipped_share or _visits(x, clipped) < LIMITS.min_places * max(1, len(x) // L):
            continue
        text = f"{name}: {n_clipped} of {len(x)} samples ({100 * share:.2g} %) are at its limits of "
        text += f"{np.min(x):.4g} and {np.max(x):.4g}"
        if share > LIMITS.max_clipped_share:
            raise DataError(
                "records/clipped", f"{text}: it is clipped; measure again with less torque or a wider range", log.where
            )
        findings.append(Finding(CLIPPED, n_clipped, f"{text}: clipped there, measure with less torque"))
    return tuple(findings)


def _at_limit(x: FloatArray) -> BoolArray:
    """Flags (n,) of the samples at a limit, none set where they are too few to be reported or the steps too coarse."""
    low, high = np.min(x), np.max(x)
    near = LIMITS.equal_tolerance * (high - low)
    # Exactly 0 is rest, not a limit: of the force of a hammer under a force window.
    at_limit = (x != 0) & ((high - x <= near) | (x - low <= near))
    is_limit = at_limit.mean() >= LIMITS.min_clipped_share and step(x) <= LIMITS.max_step_share * (high - low)
    return np.asarray(at_limit & is_limit)


def _dwells(x: FloatArray, at_limit: BoolArray) -> BoolArray:
    """Flags (n,) of the runs in which a rounded signal turns: a parabola through the neighbours explains the limit."""
    gaps = np.diff(np.sort(x))
    gaps = gaps[gaps > LIMITS.equal_tolerance * float(np.ptp(x))]
    rounding = float(gaps.min()) if gaps.size else 0.0
    dwells = np.zeros(len(x), dtype=np.bool_)
    for start, end in runs(at_limit):
        reach = max(LIMITS.min_side_samples, int(end - start))
        sides = np.r_[max(0, start - reach) : start, end : min(len(x), end + reach)]
        if len(sides) < 2 * reach:
            continue
        t = (sides - (start + end - 1) / 2) / reach
        peak = np.linalg.lstsq(np.vander(t, 3), x[sides] - x[start], rcond=None)[0][2]
        dwells[start:end] = abs(peak) <= LIMITS.max_rounding * rounding
    return dwells


def _visits(x: FloatArray, clipped: BoolArray) -> int:
    """Number of times that a signal comes to a limit from well away of it."""
    span = np.ptp(x)
    is_away = (np.max(x) - x > LIMITS.min_departure * span) & (x - np.min(x) > LIMITS.min_departure * span)
    state = (clipped.astype(int) - is_away)[clipped | is_away]
    return int(np.sum(np.diff(state) == 2))
