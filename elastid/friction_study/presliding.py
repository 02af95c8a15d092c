r"""Presliding friction by Maxwell slip elements: a convex problem where their thresholds are given.

.. math:: s_j(k) = \mathrm{clip}(s_j(k-1) + \Delta q(k), -D_j, D_j), \qquad
          \tau_f(k) = \sum_j k_j s_j(k), \quad k_j \ge 0

Non-negative least squares with many thresholds, spaced logarithmically over the travel of the joint, is the spectrum
k_j(D_j); then few elements with thresholds of their own, found from the spectrum's equal shares of torque by variable
projection, as few as predict other parts of the log as well (Rizos and Fassois, Chaos 14, 2004; Lawson and Hanson,
Solving Least Squares Problems, 1974).

Noise of the angle is a random walk through the elements and takes stiffness away, so the angle is smoothed first, with
zero phase and in the band with which the elements explain the torque best: wider passes noise, narrower the motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.friction.operators import Path, stop
from elastid.friction_study.least_squares import minimise
from elastid.friction_study.pass_detection import PASSES
from elastid.robot.friction import MaxwellSlip

# Few elements are tried up to this number.
MAX_ELEMENTS = 8


@frozen_value
class Loops:
    """A quasi-static log of one place that never leaves presliding for long: position (n,), torque (n,), SI, one side.

    resolution: of the position sensor.  frequency_hz: of the motion.  The first half loop only gives the elements their
    start, so `settled` is the sample from which on the torque counts.
    """

    place: str
    rate_hz: float
    position: FloatArray
    torque: FloatArray
    frequency_hz: float
    resolution: float = 0.0
    settled: int = 0


@dataclass(frozen=True)
class Elements:
    """Stiffnesses k_j and thresholds D_j, an offset of the torque, and the mean square of the residual."""

    stiffness: FloatArray
    threshold: FloatArray
    offset: float
    mean_square: float = 0.0

    def torque(self, position: FloatArray) -> FloatArray:
        """tau_f (n,) along positions, the elements at rest at the first."""
        states = operators(position, self.threshold)
        return np.asarray(states @ self.stiffness + self.offset)

    def to_maxwell_slip(self) -> MaxwellSlip:
        """As a robot's file has it."""
        used = self.stiffness > 0
        k, D = self.stiffness[used], self.threshold[used]
        shares = k * D / float(k @ D)
        # A hundred times the torque: an element that slips reaches its level at once.
        return MaxwellSlip(tuple(k.tolist()), tuple(shares.tolist()), 100.0 * float(k @ D), switching="events")


def fit_presliding(loops: Loops, elements: int | None = None) -> Elements:
    """Elements, by default as few as predict best within one std; DataError for loops of a few encoder counts."""
    reach = np.ptp(loops.position[loops.settled :]) / 2
    if not reach > max(PASSES.min_counts * loops.resolution, 0.0):
        raise DataError(
            "friction/presliding",
            f"the joint moved by {2 * reach:.3g} rad, "
            f"{2 * reach / max(loops.resolution, 1e-300):.2g} counts of its encoder; presliding takes more than "
            f"{2 * PASSES.min_counts:.0f}: raise the torque of the loops, or use a finer encoder",
            f"loops of {loops.place}",
        )
    finest = max(1e-3 * reach, loops.resolution)
    thresholds = np.geomspace(finest, 2 * reach, 40)
    used = np.arange(len(loops.position)) >= loops.settled
    candidates = ((q, _fit(q, loops.torque, thresholds, used)) for q in _smoothed(loops))
    q, spectrum = min(candidates, key=lambda each: each[1].mean_square)
    if elements is not None:
        return _few(q, loops.torque, spectrum, elements, used)
    folds = [np.isin(np.arange(len(used)), part) for part in np.array_split(np.flatnonzero(used), 5)]
    fits = [_few(q, loops.torque, spectrum, count, used) for count in range(1, MAX_ELEMENTS + 1)]
    return fits[_fewest([[_missed(q, loops.torque, fit.threshold, used, fold) for fold in folds] for fit in fits])]


def _smoothed(loops: Loops) -> Iterator[FloatArray]:
    """The position as it is, and without its noise in each band, where the sensor is not exact."""
    yield loops.position
    for band in (5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0) if loops.resolution > 0 else ():
        if (hz := band * loops.frequency_hz) < 0.45 * loops.rate_hz:
            filter_ = butter(4, hz, fs=loops.rate_hz, output="sos")
            yield np.asarray(sosfiltfilt(filter_, loops.position))


def operators(q: FloatArray, thresholds: FloatArray) -> FloatArray:
    """The stop operators (n, J) of a motion (n,), at rest at its first point."""
    path = Path.of(q)
    return np.stack([stop(path, float(D)) for D in thresholds], axis=1)


def _fit(q: FloatArray, u: FloatArray, thresholds: FloatArray, used: BoolArray) -> Elements:
    """Stiffnesses of given thresholds, none negative, and an offset of either sign."""
    A = operators(q, thresholds)[used]
    scale = np.linalg.norm(A, axis=0)
    constant = np.ones((len(A), 1))
    x, _ = nnls(np.hstack([A / scale, constant, -constant]), u[used])
    k, offset = x[:-2] / scale, float(x[-2] - x[-1])
    return Elements(k, thresholds, offset, float(np.mean((u[used] - A @ k - offset) ** 2)))


def _few(q: FloatArray, u: FloatArray, spectrum: Elements, count: int, used: BoolArray) -> Elements:
    torque = np.cumsum(spectrum.stiffness * spectrum.threshold)
    shares = (np.arange(count) + 0.5) / count * torque[-1]
    start = np.log(np.interp(shares, torque, spectrum.threshold))
    start = start + 1e-3 * np.arange(count)  # no two the same
    low, high = np.log(spectrum.threshold[0] / 2), np.log(spectrum.threshold[-1])
    within = np.clip(start, low + 1e-6, high - 1e-6)

    def residual(x: FloatArray) -> FloatArray:
        return (u - _fit(q, u, np.exp(x), used).torque(q))[used]

    # Steps of the thresholds are coarse: operators are piecewise linear in them.
    (end,) = minimise(residual, [within], bounds=(low, high), diff_step=1e-3, max_nfev=25)
    return _fit(q, u, np.sort(np.exp(end.x)), used)


def _missed(q: FloatArray, u: FloatArray, thresholds: FloatArray, used: BoolArray, fold: BoolArray) -> float:
    """Mean square of the residual in a part of the log, of elements fitted to the rest."""
    return float(np.mean((u - _fit(q, u, thresholds, used & ~fold).torque(q))[fold] ** 2))


def _fewest(missed: Sequence[Sequence[float]]) -> int:
    """Place of the first whose errors in the folds are the best ones within one std."""
    errors = np.array(missed)
    best = int(np.argmin(errors.mean(axis=1)))
    difference = errors - errors[best]
    bound = np.std(difference, axis=1, ddof=1) / np.sqrt(errors.shape[1])
    return int(np.flatnonzero(difference.mean(axis=1) <= bound)[0])
