r"""Tests of the innovations of an extended Kalman filter, to be passed before a band is believed; its noise from them.

.. math:: \mathrm{NIS} = \overline{e^2 / S}, \qquad
          \rho = \frac{\sum_k \nu_k \nu_{k+1}}{\sum_k \nu_k^2}, \quad \nu = e / \sqrt S, \qquad
          n_\mathrm{eff} = n \frac{1 - \rho}{1 + \rho}

(Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.)

Noise of torque and angle from the innovations of a filter.

.. math:: \min_{\sigma} \sum_k \ln S_k(\sigma) + e_k(\sigma)^2 / S_k(\sigma)

over the logarithms of the standard deviations, the likelihood of the innovations (Mehra, IEEE Trans. Automatic Control
15(2), 1970, has the idea). A real axis has torque noise that is correlated in time (ripple, cogging, cables), and a
filter that takes it for white has bands that are far too narrow: the state w carries it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.friction_study.extended_kalman_filter import Estimate, FilterNoise, JointSamples, KalmanFilter, Track


@dataclass(frozen=True)
class FilterThresholds:
    """Thresholds of the judgement of a filter."""

    nis_band: tuple[float, float] = (0.9, 1.1)  # mean NIS of an honest filter, wider than the chi-squared band
    around_a_stop_s: float = 0.2  # in which a filter that takes its bristle for certain goes wrong
    standing_share: float = 0.02  # of the largest velocity: a joint stands below
    max_correlation: float = 0.3  # of innovations from sample to sample; those of white noise have less
    max_std_ratio: float = 0.9  # of a number's std over that without the log: above, the log does not identify it
    weak_std_ratio: float = 0.5  # the same of a direction that is weakly identified
    distinct_correlation: float = 0.9  # of two numbers: above, they cannot be distinguished
    diverged_stds: float = 5.0  # of the prior, by which a filter has diverged


FILTER = FilterThresholds()


@frozen_value
class Consistency:
    """Of the samples after a filter has settled.

    nis, nis_at_stops: means; NaN at stops where there are none.  band: 95 % of the mean of white innovations.
    autocorrelation (n_lags,): of the normalised innovations, from lag 0.  n_eff: independent samples.
    """

    nis: float
    nis_at_stops: float
    band: tuple[float, float]
    autocorrelation: FloatArray
    n_eff: float

    @property
    def is_white(self) -> bool:
        """True if innovations are barely correlated from sample to sample."""
        return bool(abs(self.autocorrelation[1]) < FILTER.max_correlation)

    @property
    def is_honest(self) -> bool:
        """True if innovations are as large as expected, at stops too, and white."""
        means = [self.nis] if np.isnan(self.nis_at_stops) else [self.nis, self.nis_at_stops]
        low, high = FILTER.nis_band
        return self.is_white and all(low <= mean <= high for mean in means)


@dataclass(frozen=True)
class Direction:
    """A combination of followed numbers: weights by name, and its std over that before the log."""

    weights: dict[str, float]
    ratio: float

    @property
    def words(self) -> str:
        """The names that matter in it, as "Fc against offset"."""
        largest = max(self.weights.values(), key=abs)
        parts = {name: weight / largest for name, weight in self.weights.items() if abs(weight) > 0.3 * abs(largest)}
        together = [name for name, weight in parts.items() if weight > 0]
        against = [name for name, weight in parts.items() if weight < 0]
        return " with ".join(together) + (" against " + " with ".join(against) if against else "")


def consistency(track: Track, settled_s: float, lags: int = 50) -> Consistency:
    """Of a track after settled_s; ValueError where no more than `lags` samples are left."""
    first = round(settled_s * track.rate_hz)
    nis = track.nis[first:]
    if len(nis) <= lags:
        raise ValueError(f"{len(nis)} samples after {settled_s:g} s are too few to judge a filter; record longer")
    at_stops = _around_stops(track)[first:]
    nu = track.innovation[first:] / np.sqrt(track.variance[first:])
    power = float(nu @ nu)
    rho = np.array([float(nu[: len(nu) - lag] @ nu[lag:]) / power for lag in range(lags)])
    n_eff = max(1.0, len(nu) * (1 - rho[1]) / (1 + rho[1]))
    return Consistency(
        nis=float(nis.mean()),
        nis_at_stops=float(nis[at_stops].mean()) if at_stops.any() else float("nan"),
        band=(float(chi2.ppf(0.025, n_eff) / n_eff), float(chi2.ppf(0.975, n_eff) / n_eff)),
        autocorrelation=rho,
        n_eff=float(min(n_eff, len(nu))),
    )


def weakest_direction(track: Track, prior_std: FloatArray) -> Direction:
    """The combination of followed numbers that the log constrains least; prior_std (p,): of each before the log."""
    names = track.joint.followed
    scaled = track.followed_covariance[-1] / np.outer(prior_std, prior_std)
    values, vectors = np.linalg.eigh(scaled)
    weights = dict(zip(names, vectors[:, -1].tolist(), strict=True))
    return Direction(weights, float(np.sqrt(values[-1])))


def most_correlated(track: Track) -> tuple[tuple[str, str], float]:
    """The two followed numbers with the largest correlation at the end of a track, and that; 0 for a single number."""
    names, P = track.joint.followed, track.followed_covariance[-1]
    std = np.sqrt(np.diag(P))
    correlation = np.triu(P / np.outer(std, std), 1)
    i, j = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    return (names[i], names[j]), float(correlation[i, j])


def unknown(track: Track, prior_std: FloatArray) -> BoolArray:
    """True where a followed number is no better known than before (n, p): it is held and reported.

    prior_std (n, p) or (p,): what its std would be without the log, the drift included.
    """
    std = np.sqrt(np.diagonal(track.followed_covariance, axis1=1, axis2=2))
    return np.asarray(std > FILTER.max_std_ratio * prior_std)


def _around_stops(track: Track) -> BoolArray:
    """Samples within `around_a_stop_s` of one at which the joint stands."""
    speed = np.abs(track.values("v_m"))
    stands = speed < FILTER.standing_share * float(np.quantile(speed, 0.99))
    reach = round(FILTER.around_a_stop_s * track.rate_hz)
    if not stands.any() or stands.all():
        return np.zeros(len(stands), bool)
    return np.asarray(np.convolve(stands, np.ones(2 * reach + 1), "same") > 0.5)


def estimate_noise(
    kalman: KalmanFilter, samples: JointSamples, guess: FilterNoise, start: Estimate, settled_s: float
) -> FilterNoise:
    """The noise whose innovations are most likely, from a guess; angle noise is never below the guess.

    samples: a stretch of some seconds that moves and stops as the log does.
    """
    names = ["angle", "torque", *(["correlated"] if kalman.joint.correlation_s > 0 else [])]
    first = round(settled_s * kalman.rate_hz)
    limit = np.log(1e3)

    def noise_at(x: FloatArray) -> FilterNoise:
        factors = np.exp(np.clip(x, -limit, limit))
        factors[0] = max(factors[0], 1.0)
        return guess.scaled(**dict(zip(names, factors.tolist(), strict=True)))

    def cost(x: FloatArray) -> float:
        track = kalman.run(samples, noise_at(x), start)
        S, e = track.variance[first:], track.innovation[first:]
        value = float(np.mean(np.log(S) + e**2 / S))
        return value if np.isfinite(value) else 1e6

    # Factors of three about the guess; noise that is known to 2 % is known well enough.
    n = len(names)
    simplex = np.vstack([np.zeros(n), 1.1 * np.eye(n)])
    options = {"xatol": 0.02, "fatol": 1e-5, "maxfev": 150, "initial_simplex": simplex}
    return noise_at(np.asarray(minimize(cost, np.zeros(n), method="Nelder-Mead", options=options).x))
