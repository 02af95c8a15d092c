r"""What a robot's nonlinearity leaves at lines that were not excited, and how much of it there must be at the others.

An odd multisine (odd lines only) leaves even nonlinearities to the even lines; where single odd lines are left out,
those show the odd ones.  Under feedback a distorted y moves u as well; what remains of the linear path goes with

.. math:: Y_c = Y - \hat G U

with G between its lines by linear interpolation. (Pintelon and Schoukens, System Identification, 2nd ed., chapter 4.)
A carrier on an even line mixes both kinds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.frf.covariance import equation_error
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.response import Levels

# The fast method averages over so many odd detection lines, or over more where the outputs are many.
_LEAST_WINDOW = 3
# Fewer odd lines left out than this part of the excited ones were not left out on purpose.
_LEAST_SHARE = 0.1


@dataclass(frozen=True)
class Detected:
    """Levels at the even and at the odd detection lines; error (K_odd, n_y, n_y): mean of Y_c Y_c^H of an experiment.

    odd_lines (K_odd,): DFT lines of error; count: its experiments.
    """

    even: Levels | None
    odd: Levels | None
    odd_lines: IntArray
    error: ComplexArray
    count: int


def detection_lines(lines: IntArray, half_wave: bool) -> IntArray:
    """Lines (K,) inside the band of an odd multisine that were not excited; none where even lines were."""
    if half_wave or len(lines) < 2 or np.any(lines % 2 == 0):
        return np.zeros(0, dtype=np.int64)
    return np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)


def detected(
    detection: IntArray,
    lines: IntArray,
    spacing_hz: float,
    G: ComplexArray,
    data: MeanSpectra,
) -> Detected:
    """Distortion at the detection lines (K,) of the data, G (F, n_y, n_u) being known at lines (F,)."""
    every, G_k = data.every, interpolated(detection, lines, G)
    Y_c = every.Y - G_k @ every.U
    C_V = equation_error(data.scatter, G_k)
    amplitude: FloatArray = np.sqrt(np.mean(np.abs(Y_c) ** 2, axis=2)).astype(np.float64)
    noise = np.sqrt(np.maximum(np.einsum("fii->fi", C_V).real, 0.0) * np.mean(1 / every.periods)).astype(np.float64)
    odd = detection % 2 == 1
    error = Y_c[odd] @ np.swapaxes(Y_c[odd], 1, 2).conj() / Y_c.shape[2]
    freq_hz = np.asarray(detection * spacing_hz, dtype=np.float64)

    def levels(which: BoolArray) -> Levels | None:
        return Levels(freq_hz[which], amplitude[which], noise[which]) if which.any() else None

    return Detected(levels(~odd), levels(odd), detection[odd], error, Y_c.shape[2])


def interpolated(at: IntArray, lines: IntArray, G: ComplexArray) -> ComplexArray:
    """G (K, n_y, n_u) at DFT lines `at`, linear in frequency between lines (F,)."""
    right = np.clip(np.searchsorted(lines, at), 1, len(lines) - 1)
    left = right - 1
    part: FloatArray = ((at - lines[left]) / (lines[right] - lines[left]))[:, None, None]
    between: ComplexArray = (1 - part) * G[left] + part * G[right]
    return between


def fast_total_error(found: Detected, lines: IntArray) -> tuple[ComplexArray, int] | None:
    """C_T (F, n_y, n_y) of one experiment at the excited lines (F,) and its dof, from the odd detection lines near by.

    One realisation is enough (the fast method): a random grid distorts its excited and its left-out odd lines alike.
    None where hardly any odd line was left out.
    """
    n_y, K = found.error.shape[1], len(found.odd_lines)
    window = max(_LEAST_WINDOW, -(-2 * n_y // found.count))
    if max(window, _LEAST_SHARE * len(lines)) > K:
        return None
    first = np.clip(np.searchsorted(found.odd_lines, lines) - window // 2, 0, K - window)
    sums = np.concatenate([np.zeros((1, n_y, n_y)), np.cumsum(found.error, axis=0)])
    C_T: ComplexArray = (sums[first + window] - sums[first]) / window
    return C_T, window * found.count
