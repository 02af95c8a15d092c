"""Friction's sign along a velocity that is known at points of a period, by its means over the cells between them.

The velocity of an inertia at the points depends on the means over cells alone, and is exact with their spectrum over
sinc.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.nonlinear.shapes import Shape, sliding_means

Signal = TypeVar("Signal", FloatArray, BoolArray)


def turning(v: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """tanh(v / scale), or sgn v at scale 0, and its slope (n,), along velocities v (n,) of a period."""
    after = following(v)
    means = sliding_means(np.stack([v, after], axis=1), [(Shape("", "sign", scale), 1.0)])[:, 0]
    step, phi = after - v, np.tanh(v / scale) if scale else np.sign(v)
    slope = np.divide(following(phi) - phi, step, out=np.zeros_like(v), where=np.abs(step) > 1e-9 * np.abs(v).max())
    return points_of_means(means), (slope + np.concatenate([slope[-1:], slope[:-1]])) / 2


def points_of_means(means: FloatArray) -> FloatArray:
    """Values at the points (n,) of a period by means over the cells that begin there."""
    n = len(means)
    return np.asarray(irfft(rfft(means) * _from_means(n), n))


@lru_cache(maxsize=4)
def _from_means(n: int) -> ComplexArray:
    """Spectrum (n // 2 + 1,) at the points by that of means over the cells that begin there."""
    half = np.arange(n // 2 + 1) / n  # of the angle between two points, over pi
    return np.asarray(np.exp(-1j * np.pi * half) / np.sinc(half))


def following(x: Signal) -> Signal:
    """Of each point (n,) of a period the value at the next."""
    return np.concatenate([x[1:], x[:1]])
