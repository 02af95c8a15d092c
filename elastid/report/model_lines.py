"""The model on lines of its own, dense where it resonates, so that no mode falls between the measured lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.propagation import response_deviation
from elastid.linear.response.transfer import to_response
from elastid.response import FrequencyResponse

# Lines over the whole band, and about each resonance, there at most so many half-widths (damping ratio times f) away.
N_OVERALL, N_RESONANCE, HALF_WIDTHS = 200, 17, 4.0
# Of all elements in all configurations together: with them a page of 20 configurations of six axes stays below 10 MB.
MAX_VALUES = 330_000


def model_lines(
    freq_hz: FloatArray, resonances_hz: Sequence[float], zeta: Sequence[float], most: int = MAX_VALUES
) -> FloatArray:
    """The measured lines freq_hz (F,), lines between them, and more about each resonance within the band, rising.

    Of more than `most` lines, those that were not measured are thinned.
    """
    low, high = float(freq_hz[0]), float(freq_hz[-1])
    about = [
        f * (1 + max(ratio, 1e-4) * np.linspace(-HALF_WIDTHS, HALF_WIDTHS, N_RESONANCE))
        for f, ratio in zip(resonances_hz, zeta, strict=True)
    ]
    between = np.geomspace(low, high, N_OVERALL) if low > 0 else np.linspace(low, high, N_OVERALL)
    every = np.unique(np.concatenate([between, *about]))
    further = np.setdiff1d(every[(every > low) & (every < high)], freq_hz)
    room = min(max(most - len(freq_hz), 0), len(further))
    kept = np.linspace(0, len(further) - 1, room).astype(int)
    return np.union1d(freq_hz, further[kept])


def dense_models(fitted: FittedRobot) -> tuple[tuple[FrequencyResponse, FloatArray], ...]:
    """Of each measured configuration the model on `model_lines` and its standard deviation (L, n_y, n_u)."""
    result, found = fitted.result, []
    modes = fitted.uncertain_modes
    most = MAX_VALUES // max(sum(G.G[0].size for G in fitted.measured), 1)
    for linear, differentiated, measured, mode in zip(
        fitted.linear, fitted.differentiated, fitted.measured, modes, strict=True
    ):
        lines = model_lines(measured.freq_hz, mode.freq_hz.tolist(), mode.zeta.tolist(), most)
        theta = fitted.theta_of(linear.configuration.name)
        response = replace(to_response(linear, theta, lines), rate_is_known=measured.rate_is_known)
        std = response_deviation(differentiated, lines, result.parameters, result.x, result.covariance)[1]
        found.append((response, std))
    return tuple(found)
