"""Consistency of a friction filter with its log: innovations, movements of the followed numbers, divergence."""

from collections.abc import Iterator

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import Note
from elastid.friction_study.extended_kalman_filter import Track, first_estimate

LAGS = 50  # of the autocorrelation


# Thresholds of the consistency tests. 2 of 100 logs without faults have a note (scripts/studies/results.csv).
NIS_BAND = (0.5, 1.15)  # mean NIS of a consistent filter; below 1 at zero velocity and without drift
MAX_CORRELATION = 0.4  # of innovations from sample to sample; above, bands are 1.5 times too narrow
MAX_STD_RATIO = 0.9  # std of a parameter with the log over its std without it; above, it is not identifiable
LAGS_S: tuple[float, ...] = (0.3, 1.0, 3.0)  # over which changes of a tracked parameter are tested
MAX_MOVEMENT = (0.2, 2.0)  # mean square over band, and over noise and drift: 1 of white errors
DIVERGED_NIS = 10.0  # mean NIS; above it, or below its inverse, the filter has diverged
MAX_DEPARTURE = 6.0  # of a tracked parameter from its start value, in stds of its prior and drift


@frozen_value
class Consistency:
    """Consistency of a filter with its log, over moving samples (Track.moves) after its settling time.

    nis: mean.  autocorrelation (n_lags,): of the normalised innovations, from lag 0.  n_eff: independent samples.
    restless: tracked parameters that change by more than their bands allow.  divergence: time and reason, or empty.
    """

    nis: float
    autocorrelation: FloatArray
    n_eff: float
    restless: tuple[str, ...] = ()
    divergence: str = ""

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why a band is too narrow: movements, correlation and size of innovations.

        A constant error of a fixed parameter that tracked ones compensate is not detectable.
        """
        reasons = [f"{name} moves by more than noise and filter.drift allow" for name in self.restless]
        if self.autocorrelation[1] > MAX_CORRELATION:  # alternating ones make no band too narrow
            reasons.append(f"innovations are correlated by {self.autocorrelation[1]:.2f} from sample to sample")
        if self.nis > NIS_BAND[1]:
            reasons.append(f"mean NIS is {self.nis:.2f}: innovations are larger than expected")
        return tuple(reasons)


def consistency(track: Track, settled_s: float) -> Consistency:
    """Return consistency of a track after settled_s (Bar-Shalom, Li and Kirubarajan, 2001, section 5.4)."""
    first = round(settled_s * track.rate_hz)
    moves = track.moves[first:]  # at standstill the error of a rounded angle is constant, and no noise
    nu = np.where(moves, track.innovation[first:] / np.sqrt(track.innovation_variance[first:]), 0.0)
    power = float(nu @ nu)
    rho = np.array([float(nu[: len(nu) - lag] @ nu[lag:]) / power for lag in range(LAGS)])
    n_eff = float(np.clip(moves.sum() * (1 - rho[1]) / (1 + rho[1]), 1.0, moves.sum()))
    nis = track.nis[first:][moves]
    return Consistency(float(nis.mean()), rho, n_eff, _restless(track, first), _divergence(track, first, nis))


def _prior_std(track: Track, time_s: FloatArray | float = 0.0) -> FloatArray:
    """Return std (..., p) of the followed numbers without the log, after a drift over times (..., 1)."""
    variance = np.diag(first_estimate(track.joint, 0.0)[1])[-len(track.joint.followed) :]
    return np.sqrt(variance + track.drift**2 * time_s)


def _divergence(track: Track, first: int, nis: FloatArray) -> str:
    """Return time and reason of a filter's divergence: a number far outside its prior, or innovations of wrong size."""
    start, time_s = first_estimate(track.joint, 0.0)[0][-len(track.joint.followed) :], track.time_s[first:]
    departure = (track.x[first:] - start) / _prior_std(track, time_s[:, None] - track.time_s[0])
    for i, k in np.argwhere(~(np.abs(departure) < MAX_DEPARTURE))[:1]:
        return f"at {time_s[i]:.4g} s: {track.joint.followed[k]} off {departure[i, k]:+.2g} std"
    if 1 / DIVERGED_NIS < nis.mean() < DIVERGED_NIS:
        return ""
    return f"at {time_s[track.moves[first:]][np.argmax(nis > DIVERGED_NIS)]:.4g} s: NIS {nis.mean():.3g}"


def _restless(track: Track, first: int) -> tuple[str, ...]:
    """Return followed numbers that move within some seconds by more than their bands, and noise and drift, allow."""
    restless, lags = np.zeros(len(track.joint.followed), bool), [round(lag_s * track.rate_hz) for lag_s in LAGS_S]
    time_s, drift = track.time_s[first:], track.drift**2
    for k in range(len(restless)):  # one at a time, as a log may be large
        x, variance, spread = track.x[first:, k], track.std[first:, k] ** 2, track.variance[first:, k]
        for lag in (max(1, min(lag, len(x) // 4)) for lag in lags):
            square = (x[lag:] - x[:-lag]) ** 2
            over_band = np.mean(square / (variance[lag:] + variance[:-lag]))
            over_noise = np.mean(square / (spread[lag:] + spread[:-lag] + drift[k] * (time_s[lag:] - time_s[:-lag])))
            restless[k] |= over_band > MAX_MOVEMENT[0] and over_noise > MAX_MOVEMENT[1]
    return tuple(name for name, moves in zip(track.joint.followed, restless, strict=True) if moves)


def is_not_observable(track: Track) -> BoolArray:
    """Return True (n, p) where the log does not reduce the std of a tracked parameter, drift included."""
    return track.variance > (MAX_STD_RATIO * _prior_std(track)) ** 2


def filter_notes(location: str, track: Track, assessment: Consistency) -> Iterator[Note]:
    """Yield notes on a filter: divergence, unobservable parameters, and reasons why its bands are too narrow."""
    names, P, divergence = track.joint.followed, track.covariance, assessment.divergence
    is_unobservable = np.all(is_not_observable(track), axis=0).tolist()
    std = np.sqrt(np.diag(P))
    pairs = np.argwhere(np.triu(np.abs(P), 1) > MAX_STD_RATIO * np.outer(std, std)).tolist()
    weak = [
        f"{name}, which keeps its initial value"
        for name, is_weak in zip(names, is_unobservable, strict=True)
        if is_weak
    ]
    weak += [f"{names[i]} apart from {names[j]}" for i, j in pairs]
    if weak and not divergence:
        text = (
            f"the motion does not identify {'; '.join(weak)}: reversals distinguish Coulomb friction from an offset, "
            "several speeds from viscous friction"
        )
        yield Note("filter/not-observable", text, location, severity="warning" if pairs else "information")
    if reasons := [f"diverged {divergence}"] if divergence else assessment.doubts:
        text = (
            f"{'; '.join(reasons)}; the model or its noise is wrong, and the bands are too narrow: correct "
            "inertia, spring, bristles, gravity and payload of the joint, or give filter.correlation_time, "
            "filter.torque_std or a larger filter.drift"
        )
        diverged_note, wide = Note("filter/diverged", text, location), Note("filter/inconsistent", text, location)
        yield diverged_note if divergence else wide
