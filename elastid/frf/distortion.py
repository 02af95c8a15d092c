r"""Nonlinear distortion at lines that were not excited, and the level at the excited ones that it implies.

An odd multisine (odd lines only) leaves even nonlinearities to the even lines; where single odd lines are left out,
those show the odd ones.  Under feedback a distorted y moves u as well; the linear path is removed by

.. math:: Y_c = Y - \hat G U

with G between its lines by linear interpolation. (Pintelon and Schoukens, System Identification, 2nd ed., chapter 4.)
A carrier on an even line mixes both kinds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, IntArray
from elastid.frf.covariance import equation_error
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.frf.matrices import adjoint, power
from elastid.response import Levels


@dataclass(frozen=True)
class Detected:
    """Levels at the even and at the odd detection lines; excess (K_odd, n_y, n_y): mean Y_c Y_c^H less its noise.

    odd_lines (K_odd,): DFT lines of excess; count: its experiments.
    """

    even: Levels | None
    odd: Levels | None
    odd_lines: IntArray
    excess: ComplexArray
    count: int


def detection_lines(lines: IntArray, half_wave: bool) -> IntArray:
    """Lines (K,) inside the band of an odd multisine that were not excited; none where even lines were."""
    if half_wave or len(lines) < 2 or np.any(lines % 2 == 0):
        return np.zeros(0, dtype=np.int64)
    return np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)


def detect(detection: IntArray, lines: IntArray, spacing_hz: float, G: ComplexArray, data: MeanSpectra) -> Detected:
    """Distortion at the detection lines (K,) of the data, G (F, n_y, n_u) being known at lines (F,)."""
    every, G_k = data.every, interpolated(detection, lines, G)
    Y_c = every.Y - G_k @ every.U
    C_V = equation_error(data.scatter, G_k)
    odd = detection % 2 == 1
    error = Y_c[odd] @ adjoint(Y_c[odd]) / Y_c.shape[2]
    amplitude = np.sqrt(np.mean(np.abs(Y_c) ** 2, axis=2))
    of_noise = C_V * np.mean(1 / every.periods)
    noise = np.sqrt(power(of_noise))

    def levels(which: BoolArray) -> Levels | None:
        parts = (np.asarray(x[which], dtype=np.float64) for x in (detection * spacing_hz, amplitude, noise))
        return Levels(*parts) if which.any() else None

    return Detected(levels(~odd), levels(odd), detection[odd], error - of_noise[odd], Y_c.shape[2])


def interpolated(wanted: IntArray, lines: IntArray, G: ComplexArray) -> ComplexArray:
    """G (K, n_y, n_u) at DFT lines `at`, linear in frequency between lines (F,)."""
    right = np.clip(np.searchsorted(lines, wanted), 1, len(lines) - 1)
    left = right - 1
    part = ((wanted - lines[left]) / (lines[right] - lines[left]))[:, None, None]
    return np.asarray((1 - part) * G[left] + part * G[right])


def fast_total_error(
    detected: Detected, lines: IntArray, of_noise: ComplexArray, dof: int
) -> tuple[ComplexArray, float] | None:
    """C_T (F, n_y, n_y) of one experiment at the excited lines (F,) and its dof, from the odd detection lines near by.

    One realisation is enough (the fast method): a random grid distorts excited and left-out odd lines equally.
    Not so the noise, which at the inputs follows the resonances: of_noise (F, n_y, n_y), of `dof`, is each line's own.
    None where too few odd lines were left out.
    """
    n_y, K = detected.excess.shape[1], len(detected.odd_lines)
    window = max(3, -(-2 * n_y // detected.count))
    # Odd lines that are left out on purpose are at least a tenth of the excited ones.
    if max(window, 0.1 * len(lines)) > K:
        return None
    first = np.clip(np.searchsorted(detected.odd_lines, lines) - window // 2, 0, K - window)
    sums = np.concatenate([np.zeros((1, n_y, n_y)), np.cumsum(detected.excess, axis=0)])
    values, vectors = np.linalg.eigh((sums[first + window] - sums[first]) / window)
    # Without what is negative by chance.
    of_distortion = np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ adjoint(vectors))
    parts = [float(np.einsum("fii->", covariance).real) for covariance in (of_noise, of_distortion)]
    spread = parts[0] ** 2 / dof + parts[1] ** 2 / (window * detected.count)
    return of_noise + of_distortion, sum(parts) ** 2 / spread if spread > 0 else float(dof)
