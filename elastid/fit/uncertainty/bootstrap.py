r"""Bootstrap: the fit repeated on data that are drawn again about its optimum.

.. math:: \hat G^{(b)} = G(\hat\theta) + e^{(b)}

parametric: e is drawn from the measured covariance, or where none is known from the weights. residual: the whitened
residuals of a configuration are drawn with replacement, in blocks as long as neighbouring lines are correlated, with a
random phase each. (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, 6.5, 8.6.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import FitError
from elastid.base.execution import Execution, in_order
from elastid.fit.problem.elastic import ElasticFit, Part
from elastid.fit.problem.least_squares import RESIDUALS, LocalOptimum
from elastid.fit.problem.weights import Weights, vec
from elastid.fit.solve.solvers import FINE, solve
from elastid.fit.uncertainty.line_sums import correlation_length

BootstrapKind: TypeAlias = Literal["parametric", "residual"]


def bootstrap(
    fit: ElasticFit,
    weights: Sequence[Weights],
    x: FloatArray,
    repetitions: int,
    kind: BootstrapKind = "parametric",
    seed: int = 0,
    execution: Execution | None = None,
) -> FloatArray:
    """Estimates (repetitions, n_x) from data drawn about the optimum x (n_x,); NaN rows where a fit failed.

    Each repetition has its own random numbers, so that the result does not depend on the execution.
    """
    draws = np.random.SeedSequence(seed).spawn(repetitions)
    source = _parametric if kind == "parametric" else _residual
    sources = tuple(source(part, weight, fit.theta(part, x)) for part, weight in zip(fit.parts, weights, strict=True))
    names = [f"bootstrap-{i}" for i in range(repetitions)]
    ends = in_order((execution or Execution()).resumed(_Repetition(fit, sources, x), draws, names))
    return np.array([end.x if end.converged else np.full(len(x), np.nan) for end in ends])


@dataclass(frozen=True)
class _Repetition:
    fit: ElasticFit
    sources: tuple[_Source, ...]
    x: FloatArray

    def __call__(self, draw: np.random.SeedSequence) -> LocalOptimum:
        rng = np.random.default_rng(draw)
        parts = tuple(
            replace(part, measured=source.draw(rng)) for part, source in zip(self.fit.parts, self.sources, strict=True)
        )
        try:
            return solve(replace(self.fit, parts=parts).problem, self.x, FINE)
        except FitError as error:
            return LocalOptimum(self.x, self.x, math.inf, 0, False, str(error))


@dataclass(frozen=True)
class _Source:
    """The distribution of a measured response: the model's G (F, n_y, n_u), and errors in blocks of lines.

    root (F, m, m): the errors of G, row by row, are root z; z is white noise where residual is None, else drawn from
    residual (F, m) in blocks.
    """

    G: ComplexArray
    root: ComplexArray
    used: BoolArray
    residual: ComplexArray | None
    block: int
    logarithmic: bool

    def draw(self, rng: np.random.Generator) -> ComplexArray:
        """A measured response."""
        F, m = self.root.shape[:2]
        if self.residual is None:
            z = (rng.standard_normal((F, m)) + 1j * rng.standard_normal((F, m))) / np.sqrt(2)
        else:
            starts = rng.integers(0, F, math.ceil(F / self.block))
            lines = (starts[:, None] + np.arange(self.block)).ravel()[:F] % F
            turns = np.repeat(np.exp(2j * np.pi * rng.random(len(starts))), self.block)[:F]
            z = self.residual[lines] * turns[:, None]
        e = (self.root @ z[:, :, None])[:, :, 0].reshape(self.G.shape)
        with np.errstate(over="ignore", invalid="ignore"):
            drawn = self.G * np.exp(e) if self.logarithmic else self.G + e
        return np.where(self.used, drawn, self.G)


def _parametric(part: Part, weights: Weights, theta: FloatArray) -> _Source:
    G, used = part.kernel.response(theta), part.gain > 0
    C = weights.noise_covariance()
    F, n_y, n_u = G.shape
    if C is None:
        root = np.where(used, weights.sigma, 0.0).reshape(F, -1)[:, :, None] * np.eye(n_y * n_u)
    else:
        row_by_row = vec(np.arange(n_y * n_u).reshape(n_y, n_u)).argsort()
        C = C[:, row_by_row[:, None], row_by_row]
        values, vectors = np.linalg.eigh(C)
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return _Source(G, root.astype(complex), used, None, 1, False)


def _residual(part: Part, weights: Weights, theta: FloatArray) -> _Source:
    G, used = part.kernel.response(theta), part.gain > 0
    F = len(G)
    e = np.where(used, RESIDUALS[part.criterion](part.measured, G)[0], 0.0)
    r = np.where(used, part.gain * np.where(used, e, 0.0), 0.0).reshape(F, -1)
    gain = np.where(used, part.gain, 1.0).reshape(F, -1)
    mixing = part.mixing
    whiten = gain[:, None, :] * (np.eye(r.shape[1]) if mixing is None else mixing)
    if mixing is not None:
        r = (mixing @ r[:, :, None])[:, :, 0]
    block = min(F, math.ceil(correlation_length([r])))
    return _Source(G, np.linalg.inv(whiten).astype(complex), used, r, block, part.criterion == "log")
