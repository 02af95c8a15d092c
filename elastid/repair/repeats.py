"""What the repetitions of a signal have in common, each freed of its own offset and slope."""

from __future__ import annotations

import warnings

import numpy as np

from elastid.arrays import BoolArray, FloatArray

# Offsets and shape depend on each other where samples are missing; this many rounds settle them.
_ROUNDS = 4


def blocks(x: FloatArray, L: int, sign: int = 1) -> FloatArray:
    """X (P, L): the whole repetitions of a signal (n,), every second one turned round where sign is -1."""
    P = len(x) // L
    X: FloatArray = x[: P * L].reshape(P, L) * float(sign) ** np.arange(P)[:, None]
    return X


def expected(x: FloatArray, L: int, sign: int, good: BoolArray, robust: bool) -> FloatArray:
    """What the repetitions together say of each sample of a signal (P L,): their mean or median plus own line.

    x_p(t) ~ a_p + b_p t + s(t), s from the good samples; 0 in s where no repetition has one.
    """
    X = np.where(blocks(good.astype(float), L) > 0, blocks(x, L, sign), np.nan)
    t = np.linspace(-0.5, 0.5, L)
    line = np.zeros_like(X)
    for _ in range(_ROUNDS):
        shape = _average(X - line, robust=True)
        line = _lines(X - shape, t)
    common = line + _average(X - line, robust)
    result: FloatArray = (common * float(sign) ** np.arange(len(X))[:, None]).ravel()
    return result


def flat(x: FloatArray, L: int, sign: int = 1) -> FloatArray:
    """X (P, L): the repetitions of a signal, each without its mean and its slope (least squares)."""
    X = blocks(x, L, sign)
    result: FloatArray = X - _lines(X, np.linspace(-0.5, 0.5, L))
    return result


def _average(X: FloatArray, robust: bool) -> FloatArray:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice|Mean of empty slice", RuntimeWarning)
        average: FloatArray = np.nanmedian(X, axis=0) if robust else np.nanmean(X, axis=0)
    return np.nan_to_num(average).astype(np.float64)


def _lines(X: FloatArray, t: FloatArray) -> FloatArray:
    """The straight line through the finite samples of each row of X (P, L)."""
    good = np.isfinite(X)
    n = np.maximum(good.sum(axis=1), 1)
    values = np.where(good, X, 0.0)
    mean_x, mean_t = values.sum(axis=1) / n, (good * t).sum(axis=1) / n
    t_centred = np.where(good, t - mean_t[:, None], 0.0)
    spread = (t_centred**2).sum(axis=1)
    slope = (t_centred * values).sum(axis=1) / np.where(spread > 0, spread, 1.0)
    lines: FloatArray = mean_x[:, None] + slope[:, None] * (t - mean_t[:, None])
    return lines
