r"""A second source of one robot beside the responses of its motors: load tests, or responses at the tool.

The fit to the motors' responses alone, x_m with covariance C, and the residuals r of the second source,

.. math:: T = \min_x \; |r(x)|^2 + (x - x_m)^T C^{-1} (x - x_m) \sim \chi^2

by a few damped steps of Gauss and Newton. Where T, or the factor by which all that the source measured is larger, is
beyond chance, the cause is that of some further unknowns c, r - c W \partial y, or other readings, with the least T.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.statistics import chi_square_limit
from elastid.fit.result import Result, largest_by_chance


@dataclass(frozen=True)
class Limits:
    """Thresholds of a disagreement: each test errs once in 700 fits (scripts/studies/results.csv)."""

    tail: float = 1 / 700  # probability of T, and of the factor, by chance
    unreached: float = 30.0  # std of x in a direction that the motors' responses do not reach
    steps: int = 12
    progress: float = 0.1  # of T, below which a step is the last
    share: float = 0.5  # of T beyond its degrees of freedom, that a cause must explain
    alternative: float = 12.0  # of T beyond 1.05 of the least, within which a further cause is named


LIMITS = Limits()
# r (n,) and its slopes (n, n_z) at x (n_x,) along a root of C, with a further unknown of some size, by parts.
Residuals: TypeAlias = Callable[[FloatArray, FloatArray, float], Iterable[tuple[FloatArray, FloatArray]]]


@dataclass(frozen=True, eq=False)
class Unknown:
    """A further unknown: residuals with it, whose last slope is to it, its words by its size, and its largest size."""

    residuals: Residuals
    words: Callable[[float], str]
    largest: float = np.inf


@dataclass(frozen=True, eq=False)
class SecondSource:
    """What the motors say, x_m (n_x,) and a root L of C = L L^T, x = x_m + L z, and the residuals of the source."""

    x: FloatArray
    root: FloatArray
    residuals: Residuals
    n_residuals: int

    @classmethod
    def of(cls, alone: Result, residuals: Residuals, n_residuals: int) -> SecondSource:
        """Beside `alone`, the fit to the motors' responses."""
        C = alone.covariance.copy()
        unknown = ~np.isfinite(np.diag(C))
        C[unknown] = C[:, unknown] = 0.0
        C[unknown, unknown] = LIMITS.unreached**2
        size = np.sqrt(np.maximum(np.diag(C), 1e-300))
        values, V = np.linalg.eigh(C / np.outer(size, size))
        return cls(alone.x, size[:, None] * V * np.sqrt(np.maximum(values, 0.0)), residuals, n_residuals)

    def least(self, unknown: Unknown | None = None) -> tuple[float, float, float]:
        """T and a further unknown with its std, NaN without one."""
        z = np.zeros(self.root.shape[1] + (unknown is not None))
        best, gradient, H = self._at(z, unknown)
        damping = 0.0
        for _ in range(LIMITS.steps):
            tried = z - np.linalg.lstsq(H + damping * np.diag(np.diag(H)), gradient)[0]
            cost, *slopes = self._at(tried, unknown)
            if not cost < best:
                damping = max(10 * damping, 1e-2)
                continue
            is_last = best - cost < LIMITS.progress
            z, best, (gradient, H), damping = tried, cost, slopes, damping / 10
            if is_last:
                break
        if unknown is None:
            return best, np.nan, np.nan
        std = np.sqrt(max(np.linalg.pinv(H)[-1, -1], 0.0)) if H[-1, -1] > 0 else np.inf
        return best, float(z[-1]), float(std)

    def _at(self, z: FloatArray, unknown: Unknown | None) -> tuple[float, FloatArray, FloatArray]:
        """T, half its gradient and J^T J at z (n,)."""
        n = self.root.shape[1]
        x, prior = self.x + self.root @ z[:n], np.where(np.arange(len(z)) < n, z, 0.0)
        cost, gradient, H = float(prior @ prior), prior, np.diag(np.where(np.arange(len(z)) < n, 1.0, 0.0))
        residuals = self.residuals if unknown is None else unknown.residuals
        with np.errstate(all="ignore"):
            try:
                for r, J in residuals(x, self.root, float(z[-1])):
                    cost, gradient, H = cost + float(r @ r), gradient + J.T @ r, H + J.T @ J
            except np.linalg.LinAlgError:  # no robot stands there
                return np.inf, gradient, H
        # Far away slopes overflow before the cost does.
        return cost if np.isfinite(cost) and np.isfinite(H).all() else np.inf, gradient, H


@dataclass(frozen=True)
class Agreement:
    """factor: of all that the source measured, less 1, with its std.  T: `chi_square`.  is_beyond: chance."""

    factor: float
    std: float
    T: float
    is_beyond: bool


def agreement(now: SecondSource, alone: Result, factor: Unknown) -> Agreement:
    """The source next to `alone`; factor: that of all that it measured."""
    scale = alone.model_error**2 if alone.exceeds_noise else 1.0
    dof, T = now.n_residuals, now.least()[0]
    _, by, std = now.least(factor)
    is_other_size = by**2 > scale * chi_square_limit(1, LIMITS.tail) * std**2
    return Agreement(by, std, T, scale * dof * largest_by_chance(dof) < T or is_other_size)


def likeliest(
    now: SecondSource, T: float, unknowns: Iterable[Unknown], readings: Sequence[tuple[float, str]] = ()
) -> Iterator[str]:
    """The likeliest cause in words and others that explain as much, three at most; none where no single one does.

    readings: T of other readings of the source, with words.
    """
    tried = list(readings)
    for unknown in unknowns:
        least, size, _ = now.least(unknown)
        if abs(size) < unknown.largest:  # beyond it another reading explains what this one imitates
            tried.append((least, unknown.words(size)))
    tried.sort(key=lambda trial: trial[0])
    best = tried[0][0]
    if T - best > LIMITS.share * (T - now.n_residuals):
        yield from [words for least, words in tried if least < 1.05 * best + LIMITS.alternative][:3]
