r"""Noise of torque and angle from the innovations of a filter.

.. math:: \min_{\sigma} \sum_k \ln S_k(\sigma) + e_k(\sigma)^2 / S_k(\sigma)

over the logarithms of the standard deviations, the likelihood of the innovations (Mehra, IEEE Trans. Automatic Control
15(2), 1970, has the idea). A real axis has torque noise that is correlated in time (ripple, cogging, cables), and a
filter that takes it for white has bands that are far too narrow: the state w carries it.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import FloatArray
from elastid.observer.kalman import Estimate, JointSamples, KalmanFilter
from elastid.observer.noise import FilterNoise

# Factors by which a noise may be off its first guess.
LARGEST_FACTOR = 1e3
# Of the logarithm of a factor: noise that is known to 2 % is known well enough.
PRECISION = 0.02


def estimate_noise(
    kalman: KalmanFilter, samples: JointSamples, guess: FilterNoise, start: Estimate, settled_s: float
) -> FilterNoise:
    """The noise whose innovations are most likely, from a guess; angle noise is never below the guess.

    samples: a stretch of some seconds that moves and stops as the log does.
    """
    names = ["angle", "torque", *(["correlated"] if kalman.joint.correlation_s > 0 else [])]
    first = round(settled_s * kalman.rate_hz)
    limit = np.log(LARGEST_FACTOR)

    def at(x: FloatArray) -> FilterNoise:
        factors = np.exp(np.clip(x, -limit, limit))
        factors[0] = max(factors[0], 1.0)
        return guess.scaled(**dict(zip(names, factors.tolist(), strict=True)))

    def cost(x: FloatArray) -> float:
        track = kalman.run(samples, at(x), start)
        S, e = track.variance[first:], track.innovation[first:]
        value = float(np.mean(np.log(S) + e**2 / S))
        return value if np.isfinite(value) else 1e6

    found = minimize(
        cost, np.zeros(len(names)), method="Nelder-Mead",
        options={"xatol": PRECISION, "fatol": 1e-5, "maxfev": 150, "initial_simplex": _simplex(len(names))},
    )  # fmt: skip
    return at(np.asarray(found.x))


def _simplex(n: int) -> FloatArray:
    """A first simplex of factors of three about the guess."""
    return np.vstack([np.zeros(n), 1.1 * np.eye(n)])
