r"""Sample covariances of single lines, smoothed around a model of the noise so that they can weigh.

With the model C = L L^H (`noise_components`) the whitened covariances X_k = L_k^{-1} S_k L_k^{-H} would be 1. What the
model misses is taken from the neighbouring lines:

.. math:: \tilde C_k = c\, l_k\, L_k [\rho + (1 - \rho) \bar X_k] L_k^H

l is the geometric mean of tr(X) / n over w lines, Xbar the mean of X / (tr(X) / n) over them. The shrinkage rho is the
one of `SHRINKAGES` under which lines are most likely given their neighbours: the sum over lines of
-ln det C~ - tr(C~^-1 S), each without its own S in C~, is largest. c makes the weights unbiased, E[tr(C~^-1 C)] = n,
where the noise is as smooth as supposed. A line that is noisier than chance allows keeps its own level.
"""

from __future__ import annotations

import math

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.fit.weights.smoothed_variance import largest_by_chance, log_moment, moving_mean

# Degrees of freedom behind a weight, for each correlated element and for its level.
MIN_DOF_PER_ELEMENT = 10
MIN_DOF_OF_LEVEL = 24
# A line of so many for each element needs no neighbours: its weights cost 2 % of standard deviation.
ENOUGH_DOF_PER_ELEMENT = 30
SHRINKAGES = (1.0, 0.7, 0.4, 0.2, 0.1, 0.03, 0.01, 0.003)


@frozen_value
class SmoothedCovariance:
    """covariance: C~ (F, n, n).  own, own_variance (F,): kappa, how much of C~, or of its diagonal, is the line's own.

    tr(C~^-1 S) is 1 - kappa / nu of what a line's S independent of C~ would leave, to first order.
    """

    covariance: ComplexArray
    own: FloatArray
    own_variance: FloatArray


def smooth_covariance(S: ComplexArray, model: ComplexArray, dof: float, width: int = 0) -> SmoothedCovariance:
    """C~ of sample covariances S (F, n, n) of `dof` degrees of freedom each.

    model (F, n, n): of the noise.  width: lines; 0 takes as many as the degrees of freedom ask for.
    """
    F, n = S.shape[:2]
    width = min((width or _width(n, dof)) // 2 * 2 + 1, F)
    L = np.asarray(np.linalg.cholesky(model), np.complex128)
    whiten = np.asarray(np.linalg.inv(L), np.complex128)
    X = whiten @ S @ _H(whiten)
    level = np.einsum("faa->f", X).real / n
    known = level > 0
    level = np.interp(np.arange(F), np.flatnonzero(known), level[known]) if known.any() else np.ones(F)
    geometric = np.exp(moving_mean(np.log(level), width))
    mean = geometric / math.exp(log_moment(1, n * dof, width))
    for_weights = geometric * math.exp(log_moment(-1, n * dof, width))
    loud = level > mean * largest_by_chance(n * dof) if width > 1 else np.zeros(F, dtype=np.bool_)
    quiet = np.exp(moving_mean(np.log(np.where(loud, mean, level)), width)) / geometric
    for_weights = np.where(loud, level, for_weights * quiet)
    X = X / level[:, None, None]
    rho = _shrinkage(X, width)
    inner = rho * np.eye(n) + (1 - rho) * moving_mean(X, width)
    bias = 1 - (1 - rho) * (n**2 - 1) / (n * width * dof)
    smooth = np.asarray((for_weights / bias)[:, None, None] * (L @ inner @ _H(L)))
    return SmoothedCovariance(smooth, *_own(S, smooth, rho, width, dof))


def _width(n: int, dof: float) -> int:
    if dof >= ENOUGH_DOF_PER_ELEMENT * n:
        return 1
    return max(math.ceil(max(MIN_DOF_PER_ELEMENT * n, MIN_DOF_OF_LEVEL / n) / dof), 3)


def _shrinkage(X: ComplexArray, width: int) -> float:
    """rho; X (F, n, n): whitened, of mean diagonal 1."""
    n = X.shape[1]
    if width == 1 or n == 1:
        return 0.0
    others = (width * moving_mean(X, width) - X) / (width - 1)
    likelihood = []
    for rho in SHRINKAGES:
        values, vectors = np.linalg.eigh(rho * np.eye(n) + (1 - rho) * others)
        values = np.maximum(values, 1e-12)
        power = np.einsum("fab,fac,fcb->fb", vectors.conj(), X, vectors, optimize=True).real
        likelihood.append(float(np.sum(-np.log(values) - power / values)))
    return SHRINKAGES[int(np.argmax(likelihood))]


def _own(S: ComplexArray, smooth: ComplexArray, rho: float, width: int, dof: float) -> tuple[FloatArray, FloatArray]:
    """kappa (F,) of the whole and of the diagonal; both in proportion to how much of C~ the errors fill on average."""
    F, n = S.shape[:2]
    shares = (1 + (1 - rho) * (n**2 - 1)) / (n * width), (1 + (1 - rho) * (n - 1)) / (n * width)
    together = np.einsum("faa->f", np.linalg.solve(smooth, S)).real / n
    alone = np.mean(np.einsum("faa->fa", S).real / np.einsum("faa->fa", smooth).real, axis=1)
    filled = (float(np.mean(together)), float(np.mean(alone)))
    own = [k * z / max(1 - k * z / dof, 0.1) for k, z in zip(shares, filled, strict=True)]
    return np.full(F, own[0]), np.full(F, own[1])


def _H(A: ComplexArray) -> ComplexArray:
    return np.asarray(np.swapaxes(A, -1, -2).conj())
