r"""Judgement of a filter of friction by its own track: its innovations, and how far its numbers move.

Before a band is believed its innovations are tested,

.. math:: \mathrm{NIS} = \overline{e^2 / S}, \qquad
          \rho = \frac{\sum_k \nu_k \nu_{k+1}}{\sum_k \nu_k^2}, \quad \nu = e / \sqrt S, \qquad
          n_\mathrm{eff} = n \frac{1 - \rho}{1 + \rho}

(Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.) NIS does
not see errors of the model that the followed numbers take up: a number moves, within a lag up to the filter's memory,
by no more than noise and drift allow, where its band does not hold that,

.. math:: \overline{\frac{(p_{t + L} - p_t)^2}{\sigma_t^2 + \sigma_{t + L}^2}}
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.friction_study.extended_kalman_filter import Track


@dataclass(frozen=True)
class FilterThresholds:
    """Thresholds of the judgement of a filter.
    All three move at slow constant speeds, where noise of the angle is taken for viscous friction.  Of 100 clean logs
    two have a note, and hold F_c for 47 and 79 % of the time (scripts/studies/results.csv).
    """

    nis_band: tuple[float, float] = (0.5, 1.15)  # mean NIS of an honest filter; below 1 at rest and without drift
    max_correlation: float = 0.4  # of innovations from sample to sample; above, bands are 1.5 times too narrow
    least_moving: float = 0.1  # of the samples: below, innovations at standstill count for correlation too
    max_std_ratio: float = 0.9  # of a number's std over that without the log: above, the log does not identify it
    distinct_correlation: float = 0.9  # of two numbers: above, they cannot be distinguished
    lags_s: tuple[float, ...] = (0.3, 1.0, 3.0)  # over which a followed number is compared with itself
    max_movement: float = 0.2  # mean square, over the variances of both ends; 1 of errors that do not depend
    max_excess: float = 2.0  # the same over what noise and drift allow


FILTER = FilterThresholds()


@dataclass(frozen=True)
class Movement:
    """A followed number within lag_s: its change, root mean square.

    ratio: mean square over the variances of its band at both ends.  excess: over those without the errors of held
    numbers, and the drift of the lag.
    """

    name: str
    lag_s: float
    change: float
    ratio: float
    excess: float

    @property
    def size(self) -> float:
        """Above 1 where it is beyond what noise and drift allow, and the band cannot hold it."""
        return min(self.ratio / FILTER.max_movement, self.excess / FILTER.max_excess)


@frozen_value
class Consistency:
    """Of the samples after a filter has settled at which the joint moves (Track.moves).

    nis: mean.  autocorrelation (n_lags,): of the normalised innovations, from lag 0.  n_eff: independent samples.
    movements: of each followed number the largest.
    """

    nis: float
    autocorrelation: FloatArray
    n_eff: float
    movements: tuple[Movement, ...] = ()

    @property
    def is_honest(self) -> bool:
        """True if no test finds a band too narrow: size and correlation of innovations, and movements.

        Nothing sees an error of held numbers that the band does not have and the followed ones take up for good.
        """
        is_tested = self.nis <= FILTER.nis_band[1] and self.autocorrelation[1] < FILTER.max_correlation
        return is_tested and not self.restless

    @property
    def restless(self) -> tuple[Movement, ...]:
        """Numbers that move by more than their bands hold."""
        return tuple(movement for movement in self.movements if movement.size > 1)

    @property
    def is_white(self) -> bool:
        """True if innovations are barely correlated from sample to sample."""
        return bool(abs(self.autocorrelation[1]) < FILTER.max_correlation)


def consistency(track: Track, settled_s: float, lags: int = 50) -> Consistency:
    """Of a track after settled_s; ValueError where no more than `lags` samples are left."""
    first = round(settled_s * track.rate_hz)
    if len(track.innovation) - first <= lags:
        left = max(0, len(track.innovation) - first)
        raise ValueError(f"{left} samples after {settled_s:g} s are too few to judge a filter; record longer")
    # At standstill the error of a rounded angle is constant, and no noise.
    moves = track.moves[first:]
    moves = moves if moves.mean() > FILTER.least_moving else np.ones_like(moves)
    nu = np.where(moves, track.innovation[first:] / np.sqrt(track.variance[first:]), 0.0)
    power = float(nu @ nu)
    rho = np.array([float(nu[: len(nu) - lag] @ nu[lag:]) / power for lag in range(lags)])
    n_eff = float(np.clip(moves.sum() * (1 - rho[1]) / (1 + rho[1]), 1.0, moves.sum()))
    return Consistency(float(track.nis[first:][moves].mean()), rho, n_eff, tuple(_movements(track, first)))


def _movements(track: Track, first: int) -> Iterator[Movement]:
    """Of each followed number the largest over its lags, within motions."""
    p = len(track.joint.followed)
    x, variance = track.x[first:, -p:], track.std[first:, -p:] ** 2
    bounds = [max(0, start - first) for start in track.starts] + [len(x)]
    longest_s = max(b - a for a, b in pairwise(bounds)) / track.rate_hz
    # A number is a mean over its memory: its variance over the rate of its drift.
    own = np.diagonal(track.followed_covariance[first:], axis1=1, axis2=2)
    memories_s = (np.mean(own, axis=0) / np.maximum(track.drift, 1e-30) ** 2).tolist()
    for i, name in enumerate(track.joint.followed):
        found = []
        for lag_s in (*FILTER.lags_s, max(memories_s[i], FILTER.lags_s[0])):
            lag_s = min(lag_s, longest_s / 4)
            lag = max(1, round(lag_s * track.rate_hz))
            pairs = np.concatenate([np.arange(a, max(a, b - lag)) for a, b in pairwise(bounds)])
            square = (x[pairs + lag, i] - x[pairs, i]) ** 2
            ratio = float(np.mean(square / (variance[pairs, i] + variance[pairs + lag, i])))
            noise = own[pairs, i] + own[pairs + lag, i] + track.drift[i] ** 2 * lag_s
            excess = float(np.mean(square / noise))
            found.append(Movement(name, float(lag_s), float(np.sqrt(square.mean())), ratio, excess))
        yield max(found, key=lambda movement: movement.size)
