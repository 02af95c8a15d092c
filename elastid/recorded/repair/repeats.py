"""The common part of the repetitions of a signal, and each of them without its own offset and slope."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray

# Offsets and shape depend on each other where samples are missing; so many rounds make them converge.
_ROUNDS = 5
# A sample further from its line than so many median distances has no weight in it.
_MAX_MEDIAN_DISTANCES = 9.0


def blocks(x: FloatArray, L: int, sign: int = 1) -> FloatArray:
    """X (P, L): the whole repetitions of a signal (n,), every second one with opposite sign where sign is -1."""
    P = len(x) // L
    return np.asarray(x[: P * L].reshape(P, L) * float(sign) ** np.arange(P)[:, None])


def expected(x: FloatArray, L: int, sign: int, good: BoolArray, robust: bool) -> FloatArray:
    """Prediction of each sample of a signal (P L,) from all repetitions: their mean or median plus its own line.

    x_p(t) ~ a_p + b_p t + s(t), s from the good samples; s = 0 where no repetition has one.
    """
    X = np.where(blocks(good.astype(float), L) > 0, blocks(x, L, sign), np.nan)
    t = np.linspace(-0.5, 0.5, L)
    line = np.zeros_like(X)
    for _ in range(_ROUNDS):
        away = X - _average(X - line, robust=True)
        from_line = np.abs(away - line)
        # A repetition without a good sample has no line of its own.
        from_line[~np.isfinite(from_line).any(axis=1)] = 0.0
        near = from_line <= _MAX_MEDIAN_DISTANCES * np.nanmedian(from_line, axis=1, keepdims=True) + 1e-300
        line = _lines(np.where(near, away, np.nan), t)
    common = line + _average(X - line, robust)
    return np.asarray((common * float(sign) ** np.arange(len(X))[:, None]).ravel())


def flat(x: FloatArray, L: int, sign: int = 1) -> FloatArray:
    """X (P, L): the repetitions of a signal, each without its mean and its slope (least squares)."""
    X = blocks(x, L, sign)
    return np.asarray(X - _lines(X, np.linspace(-0.5, 0.5, L)))


def _average(X: FloatArray, robust: bool) -> FloatArray:
    """Median or mean (L,) of the finite samples of each column of X (P, L); 0 where there is none."""
    n = np.isfinite(X).sum(axis=0)
    if not robust:
        return np.asarray(np.nansum(X, axis=0) / np.maximum(n, 1))
    # NaN is sorted to the end.
    ordered = np.sort(X, axis=0)
    middle = np.stack([np.maximum(n - 1, 0) // 2, np.minimum(n // 2, len(X) - 1)])
    return np.where(n > 0, np.take_along_axis(ordered, middle, axis=0).mean(axis=0), 0.0)


def _lines(X: FloatArray, t: FloatArray) -> FloatArray:
    """The straight line through the finite samples of each row of X (P, L)."""
    good = np.isfinite(X)
    n = np.maximum(good.sum(axis=1), 1)
    values = np.where(good, X, 0.0)
    mean_x, mean_t = values.sum(axis=1) / n, (good * t).sum(axis=1) / n
    t_centred = np.where(good, t - mean_t[:, None], 0.0)
    spread = (t_centred**2).sum(axis=1)
    slope = (t_centred * values).sum(axis=1) / np.where(spread > 0, spread, 1.0)
    return np.asarray(mean_x[:, None] + slope[:, None] * (t - mean_t[:, None]))
