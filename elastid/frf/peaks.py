r"""Peaks of a measured response: frequency and damping of each resonance with their intervals, without a model.

About a peak every element is a polynomial over one complex pole, which all elements share:

.. math:: G_{ij}(\omega) \approx \frac{b_{ij,0} + b_{ij,1} x + b_{ij,2} x^2}{x - z}, \quad x = \omega - \omega_0

The pole :math:`z + \omega_0 = \omega_n (\sqrt{1 - \zeta^2} + j \zeta)` is found by weighted least squares (Gauss-Newton
with the polynomials projected out); these take up the other modes. The window is a few half-power widths, and ends half
way to the next peaks. The variance of the pole is that of the response or that of the residuals from line to line (each
over the part that the polynomials leave free), whichever is larger: elements of one line have noise in common, and a
model that does not fit shows in the residuals alone.  Leakage of windows flattens a peak on all of its lines at once,
so that the change of the pole by all of it is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import nnls
from scipy.signal import find_peaks

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.statistics import QUANTILE_95
from elastid.response import Covariance, FrequencyResponse


@dataclass(frozen=True)
class Limits:
    """Thresholds of a peak.  False alarms of 300 clean logs: false-peak 0."""

    prominence_db: float = 3.0  # above the neighbouring valleys
    lines: int = 6  # of a window: fewer do not distinguish a pole from its polynomials
    lines_of_degree_2: int = 9  # of a window, from which on the polynomials are of degree 2, else 1
    lines_to_either_side: int = 6  # of a window, where the neighbours leave room
    half_window: float = 2.0  # in half-power widths of the peak
    significance: float = 3.0  # of the damping, in standard deviations
    damping: float = 0.5  # at most
    snr: float = 30.0  # mean power over variance of some element in the window (15 dB)
    dof_of_a_line: float = 20.0  # complex: variances with fewer are smoothed over a window
    free_share: float = 0.1  # least part of a residual that is taken for free of the polynomials
    step: float = 1e-10  # of the pole, over half the window, below which it has converged
    diverged_step: float = 1e6  # of the pole, beyond which it has left the lines


LIMITS = Limits()


@dataclass(frozen=True)
class Peak:
    """A resonance.  freq_hz and damping (ratio to critical) with standard deviations; lines: of the window it is from.

    output, input: of the element that is largest there.  misfit: RMS of the residuals over what the variance of the
    response explains; NaN for a response without a variance.
    """

    freq_hz: float
    freq_std: float
    damping: float
    damping_std: float
    output: str
    input: str
    lines: int
    misfit: float

    @property
    def freq95(self) -> tuple[float, float]:
        """95 % interval of the frequency."""
        return self.freq_hz - QUANTILE_95 * self.freq_std, self.freq_hz + QUANTILE_95 * self.freq_std

    @property
    def damping95(self) -> tuple[float, float]:
        """95 % interval of the damping."""
        return self.damping - QUANTILE_95 * self.damping_std, self.damping + QUANTILE_95 * self.damping_std


def peaks(response: FrequencyResponse) -> tuple[Peak, ...]:
    """The resonances of a response by frequency; none where its lines are too few or its peaks too flat."""
    power = _power(response.G)
    tops, _ = find_peaks(10 * np.log10(power), prominence=LIMITS.prominence_db)
    if not len(tops):
        return ()
    borders = [0, *((a + b) // 2 for a, b in pairwise(tops.tolist())), response.n_lines - 1]
    resonances: dict[float, Peak] = {}
    for top, low, high in zip(tops.tolist(), borders[:-1], borders[1:], strict=True):
        if (peak := _peak(response, top, low, high)) is not None:
            resonances[peak.freq_hz] = peak
    return tuple(resonances[freq_hz] for freq_hz in sorted(resonances))


def _power(G: ComplexArray) -> FloatArray:
    """Sum (F,) of |G|^2 over the elements, each in units of its median, so that units do not matter."""
    power = np.abs(G) ** 2
    middle = np.median(power, axis=0)
    return np.asarray(np.sum(power / np.where(middle > 0, middle, 1.0), axis=(1, 2))) + np.finfo(float).tiny


def _peak(response: FrequencyResponse, top: int, low: int, high: int) -> Peak | None:
    """The peak by lines low to high at most, each part of its pole with half the variance; None where there is none."""
    f, G = response.freq_hz, response.G
    width, found = _half_power_width(f, _power(G), top), None
    for _ in range(2):
        half, least = LIMITS.half_window * width, LIMITS.lines_to_either_side
        first = max(low, min(top - least, int(np.searchsorted(f, f[top] - half))))
        last = min(high, max(top + least, int(np.searchsorted(f, f[top] + half, "right")) - 1))
        window = np.arange(first, last + 1)
        if len(window) < LIMITS.lines:
            return None
        found = _pole(response, window, f[top], width)
        if found is None:
            return None
        width = found[0].imag / np.pi  # the half-power width 2 zeta f
    assert found is not None
    z, variance, misfit = found
    size, std = abs(z), np.sqrt(variance / 2)
    if response.uncertainty is not None:
        # Far above the noise in some element: neighbouring lines may share theirs, which has bumps.
        power = np.mean(np.abs(G[window]) ** 2, axis=0)
        if not np.any(power > LIMITS.snr * np.mean(response.uncertainty.variance[window], axis=0)):
            return None
    inside = f[window[0]] <= size / (2 * np.pi) <= f[window[-1]]
    if not inside or not LIMITS.significance * (std / size) < z.imag / size < LIMITS.damping:
        return None
    row, column = np.unravel_index(int(np.argmax(np.abs(G[top]))), G[top].shape)
    return Peak(
        freq_hz=float(size / (2 * np.pi)),
        freq_std=float(std / (2 * np.pi)),
        damping=float(z.imag / size),
        damping_std=float(std / size),
        output=response.outputs[int(row)],
        input=response.inputs[int(column)],
        lines=len(window),
        misfit=misfit,
    )


def _half_power_width(f: FloatArray, power: FloatArray, top: int) -> float:
    """Width in Hz of the lines about a peak with at least half its power, at least one spacing."""
    below = power < power[top] / 2
    left = np.flatnonzero(below[:top])
    right = np.flatnonzero(below[top:])
    first = f[left[-1]] if left.size else f[0]
    last = f[top + right[0]] if right.size else f[-1]
    return float(last - first) / 2


def _pole(
    response: FrequencyResponse, window: IntArray, freq_hz: float, width: float
) -> tuple[complex, float, float] | None:
    """The pole in rad/s that all elements share on a window of lines, its variance E|dz|^2, and the misfit.

    By Gauss-Newton from a peak and its half-power width; None where it is lost.
    """
    K, uncertainty = len(window), response.uncertainty
    G = response.G[window].reshape(K, -1)
    variance = None if uncertainty is None else _smooth(uncertainty, window, np.abs(G) ** 2)
    known = variance is not None and bool(np.all(variance > 0))
    largest = np.abs(G).max(axis=0)
    same = np.ones(G.shape) / np.where(largest > 0, largest, 1.0)
    weights = 1 / np.sqrt(variance) if variance is not None and known else same
    omega = 2 * np.pi * response.freq_hz[window]
    center, scale = 2 * np.pi * freq_hz, float(np.ptp(omega)) / 2
    x = (omega - center) / scale
    degree = 2 if LIMITS.lines_of_degree_2 <= K else 1
    z = complex(0.0, max(np.pi * width / scale, 1e-3))
    cost, residuals, slopes, free = _projected(G, weights, x, z, degree)
    for _ in range(30):
        power = float(np.vdot(slopes, slopes).real)
        if not power > 0:
            return None
        step = complex(np.vdot(slopes, residuals) / power)
        # The pole has left the lines, and the polynomials fit them without it.
        if not abs(step) < LIMITS.diverged_step:
            return None
        while True:
            trial = z + step
            if trial.imag > 0 and (tried := _projected(G, weights, x, trial, degree))[0] <= cost:
                break
            step /= 2
            if abs(step) < LIMITS.step:
                tried, trial = (cost, residuals, slopes, free), z
                break
        z, (cost, residuals, slopes, free) = trial, tried
        if abs(step) < LIMITS.step:
            break
    if not abs(z) < LIMITS.significance:  # far outside the window
        return None
    dof = G.size - G.shape[1] * (degree + 1) - 1
    if dof < 1:
        return None
    misfit = cost / dof
    stated = (max(misfit, 1.0) if known else misfit) / power
    # Elements of one line share the noise of their inputs: its scatter from line to line shows that, where the pole
    # has not followed it.
    by_line = np.abs(np.sum(slopes.conj() * residuals / np.maximum(free, LIMITS.free_share), axis=0)) ** 2
    share = np.sum(np.abs(slopes) ** 2, axis=0) / power
    scattered = float(np.sum(by_line / np.maximum(1 - share, LIMITS.free_share))) / power**2
    # Leakage has one sign in a window: it moves the pole as a whole, and not along one part alone.
    leaked = 0.0 if response.leakage is None else 2 * _moved(response.leakage[window], weights, slopes, power)
    # A sum over lines whose errors are correlated has so many times the variance at most; slopes that alternate within
    # as many lines have less.
    scattered = response.correlated_lines * max(stated, scattered)
    variance_of_z = float((scattered + leaked) * scale**2)
    return center + scale * z, variance_of_z, float(np.sqrt(misfit)) if known else np.nan


def _moved(error: ComplexArray, weights: FloatArray, slopes: ComplexArray, power: float) -> float:
    """|dz|^2 by an error of G (K, n_y, n_u)."""
    weighted = (weights * error.reshape(weights.shape)).T[:, :, None]
    return float(np.abs(np.vdot(slopes, weighted) / power) ** 2)


def _smooth(covariance: Covariance, window: IntArray, power: FloatArray) -> FloatArray:
    """Variance (K, n) on a window; with few degrees of freedom as a + b |G|^2 of each element, by least squares.

    a is from the outputs, b from the inputs: single variances of few degrees of freedom would weigh by chance.
    """
    variance = covariance.variance[window].reshape(power.shape)
    if covariance.dof >= LIMITS.dof_of_a_line or not np.all(variance > 0):
        return variance
    smooth = np.empty(variance.shape)
    for i, (v, p) in enumerate(zip(variance.T, power.T, strict=True)):
        columns = np.stack([np.full(len(v), v.mean()), p * v.mean() / max(p.mean(), np.finfo(float).tiny)], axis=1)
        level = np.full(len(v), v.mean())
        for _ in range(3):
            share, _ = nnls(columns / level[:, None], v / level)
            level = columns @ share + np.finfo(float).eps * v.mean()
        smooth[:, i] = level
    return smooth


def _projected(
    G: ComplexArray, weights: FloatArray, x: FloatArray, z: complex, degree: int
) -> tuple[float, ComplexArray, ComplexArray, FloatArray]:
    """Cost, residuals (n, K, 1) and their slope by the pole, the share of the polynomials projected out of both.

    And the part (n, K, 1) of the variance of each residual that the polynomials leave free.
    """
    basis = x[:, None] ** np.arange(degree + 1) / (x - z)[:, None]
    Q, _ = np.linalg.qr(weights.T[:, :, None] * basis)  # (n, K, degree + 1) of each element
    data = (weights * G).T[:, :, None]
    inside = Q @ (Q.conj().swapaxes(1, 2) @ data)
    slopes = inside / (x - z)[:, None]
    slopes = slopes - Q @ (Q.conj().swapaxes(1, 2) @ slopes)
    residuals = data - inside
    free = 1 - np.sum(np.abs(Q) ** 2, axis=2, keepdims=True)
    return float(np.vdot(residuals, residuals).real), residuals, slopes, free
