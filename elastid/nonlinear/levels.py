r"""Levels of friction by regression: the f for which G is the same in all realisations.

For each line, with the net torques U_n = U - Phi f and the projector Q that takes their span out of the K experiments,

.. math:: e = (U - G^{-1} Y)\, Q = \Phi Q\, f + noise, \qquad G = Y U_n^H (U_n U_n^H)^{-1}

G is eliminated by variable projection; since it depends on f, the regression is repeated. At lines that were not
excited, torque is there by feedback alone: G is interpolated, and Q = 1. Motors and their levels are the same in all
configurations. (Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973; Kaufman, BIT 15, 1975.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.nonlinear.spectra import ConfigurationSpectra, Net, taken

_BLOCKS = 5  # of lines, which replace realisations where there is one


@dataclass(frozen=True)
class NormalEquations:
    """Sums over lines and configurations for each fold and motor, weighted to residuals of variance 1 about f.

    A fold is a realisation, or a block of lines where there is one realisation.  A (M, n_f, n_f), b (M, n_f): X^H X and
    X^H e.  c (M, n_m): e^H e.  level (C, n_m): amplitude of e - X f at a line, the median, which a few lines
    near sharp resonances do not move.  dof_share: share of the residuals that the elimination of G leaves.
    """

    A: FloatArray
    b: FloatArray
    c: FloatArray
    level: FloatArray
    dof_share: float


def normal_equations(data: Sequence[ConfigurationSpectra], levels: FloatArray, motor_of: IntArray) -> NormalEquations:
    """The sums about given levels (n_f,) of shapes at motors motor_of (n_f,)."""
    n_m, n_f = data[0].U.shape[1], len(levels)
    realisations = np.unique(np.concatenate([spectra.realisation for spectra in data]))
    M = len(realisations) if len(realisations) > 1 else _BLOCKS
    A, b, c = np.zeros((M, n_f, n_f)), np.zeros((M, n_f)), np.zeros((M, n_m))
    level, shares = np.zeros((len(data), n_m)), np.ones(len(data))
    for i, spectra in enumerate(data):
        net = spectra.net(taken(levels, spectra.Phi, motor_of, n_m))
        excited = spectra.excited[net.counts]
        shares[i] = 1 - n_m / spectra.U.shape[2] * excited.mean() if excited.size else 1.0
        fold, of_shapes = _folds(spectra, net, realisations), np.moveaxis(net.X[net.counts], 1, 0)
        for motor in range(n_m):
            own = np.flatnonzero(motor_of == motor)
            e, X = net.e[net.counts][:, motor], of_shapes[own]
            left = np.mean(np.abs(e - np.tensordot(levels[own], X, axes=1)) ** 2, axis=1)
            level[i, motor] = np.sqrt(np.median(left)) if left.size else 0.0
            w = np.sqrt(_weights(left, excited))[:, None]
            e, X = w * e, w * X
            for m in range(M):
                e_m, X_m = e[fold == m], X[:, fold == m]
                A[m][np.ix_(own, own)] += (X_m.conj() @ X_m.T).real
                b[m, own] += (X_m.conj() @ e_m).real
                c[m, motor] += float(np.sum(np.abs(e_m) ** 2))
    return NormalEquations(A, b, c, level, float(shares.mean()))


def find_levels(data: Sequence[ConfigurationSpectra], motor_of: IntArray) -> tuple[FloatArray, NormalEquations]:
    """Levels (n_f,), none negative, of shapes at motors motor_of (n_f,), and the sums about them."""
    levels = np.zeros(len(motor_of))
    for _ in range(4):  # the change falls by more than ten each time
        equations = normal_equations(data, levels, motor_of)
        levels = solve(equations.A.sum(axis=0), equations.b.sum(axis=0))
    return levels, normal_equations(data, levels, motor_of)


def solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """The f (n,) >= 0 that minimises f^T A f - 2 b^T f."""
    from scipy.optimize import nnls  # slow to load, for records without friction

    if not len(b):
        return b
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    power, V = np.linalg.eigh(A / np.outer(size, size))
    root = np.sqrt(np.maximum(power, 0.0) + 1e-9)  # a small ridge: shapes may be the same in all that was measured
    return np.asarray(nnls(root[:, None] * V.T, V.T @ (b / size) / root)[0] / size)


def covariance(equations: NormalEquations) -> FloatArray:
    """Covariance (n_f, n_f) of the levels by the residuals' scatter over experiments and lines."""
    A = equations.A.sum(axis=0) * equations.dof_share
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    both = np.outer(size, size)
    return np.asarray(0.5 * np.linalg.pinv(A / both, hermitian=True) / both) if len(A) else A


def _folds(data: ConfigurationSpectra, net: Net, realisations: IntArray) -> IntArray:
    """The fold (F, K) of each residual at the lines that count."""
    F, K = int(net.counts.sum()), data.U.shape[2]
    if len(realisations) > 1:
        return np.broadcast_to(np.searchsorted(realisations, data.realisation), (F, K))
    return np.broadcast_to((np.arange(F) * 4 * _BLOCKS // max(F, 1) % _BLOCKS)[:, None], (F, K))


def _weights(power: FloatArray, excited: BoolArray) -> FloatArray:
    """1 / power (F,) of the residuals, each over neighbouring lines of the same kind."""
    smooth = np.empty_like(power)
    for kind in (excited, ~excited):
        if not kind.any():
            continue
        window = np.ones(min(9, int(kind.sum())))
        smooth[kind] = np.convolve(power[kind], window, "same") / np.convolve(np.ones(kind.sum()), window, "same")
    return np.asarray(1 / np.maximum(smooth, 1e-12 * smooth.max(initial=0.0) + 1e-300))
