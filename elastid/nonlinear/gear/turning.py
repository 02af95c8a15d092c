r"""Friction's sign along a velocity that is known at points, and that the friction itself bends at a reversal.

Between two points, 1 apart, u = v / s is a line with a bend c t (t - 1) / 2, c its second difference, and

.. math:: \int_0^1 \tanh u\, dt \approx \overline{\tanh}
          - \frac{c}{\Delta^2} \left( \frac{\Lambda_0 + \Lambda_1}{2} - \bar \Lambda \right), \qquad
          \Lambda = \ln \cosh u, \quad \Delta = u_1 - u_0

with means along the line. Where u turns within a few cells, friction bends it by b and the rest by a, which grows by c
from cell to cell and is known from the cells before and after, as b is:

.. math:: \dot u = a - b \tanh u: \quad \overline{\tanh} = \frac{b \Delta + a L}{a \Delta + b L}, \qquad
          L = \left[ \ln |a \cosh u - b \sinh u| \right]_0^1

The velocity of an inertia at the points depends on the means over cells alone, and is exact with their spectrum over
sinc.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.fft import irfft, rfft
from scipy.special import spence

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray

Signal = TypeVar("Signal", FloatArray, BoolArray)

_STUCK = 0.9  # of the torque at a reversal, above which friction nearly holds, and bends the velocity over many cells
_NEAR, _CELLS = 3.0, 6  # of u, beyond which a sign is one; of a reversal in which friction turns at once
_FAR = 20.0  # of u, beyond which no digit of tanh u is missing
_STEEP = 0.2  # change of u over a cell, below which its curve is that of its middle


def turning(v: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """tanh(v / scale), or sgn v at scale 0, and its slope (n,), along velocities v (n,) of a period."""
    size = scale or 1e-9 * float(np.abs(v).max()) + 1e-300
    u = v / size
    after, is_inner, tanh = following(u), np.abs(u) < _FAR, np.copysign(1.0, u)
    tanh[is_inner] = np.tanh(u[is_inner])
    step, means, slope, crosses = after - u, tanh.copy(), np.zeros_like(u), u * after < 0
    cells = np.flatnonzero((is_inner | following(is_inner) | crosses) & (np.abs(step) > 1e-9 * np.abs(u).max()))
    means[cells] = (_log_cosh(after[cells], 0.0) - _log_cosh(u[cells], 0.0)) / step[cells]
    slope[cells] = (following(tanh) - tanh)[cells] / (step[cells] * size)
    near = cells[crosses[cells] | (np.minimum(np.abs(u[cells]), np.abs(after[cells])) < _NEAR)]
    is_near, bend = np.zeros(len(u), bool), np.zeros_like(u)
    is_near[near] = True
    bend[near] = (step[(near + 1) % len(u)] - step[near - 1]) / 2
    if 0 < len(near) < len(u):
        short, a, b, c = _reversals(near, is_near, crosses, step, means)
        L = _log_cosh(after[short], b / a) - _log_cosh(u[short], b / a)
        means[short] = (b * step[short] + a * L) / (a * step[short] + b * L)
        bend[short] = c
    means[near] -= bend[near] * _sag(u[near], after[near])
    return points_of_means(means), (slope + np.concatenate([slope[-1:], slope[:-1]])) / 2


def points_of_means(means: FloatArray) -> FloatArray:
    """Values at the points (n,) of a period by means over the cells that begin there."""
    n = len(means)
    return np.asarray(irfft(rfft(means) * _from_means(n), n))


def _reversals(
    near: IntArray, is_near: BoolArray, crosses: BoolArray, step: FloatArray, means: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Cells (m,) of short reversals, and a, b and c (m,) there.

    near: cells in which a sign is none yet, is_near (n,); crosses, step, means (n,): of all cells.
    """
    n = len(step)
    begins = np.flatnonzero(np.diff(near, prepend=near[-1] - n) > 1)
    near, begins = np.roll(near, -begins[0]), begins - begins[0]
    length = np.diff(begins, append=len(near))
    first, last = (near[begins] - 1) % n, (near[begins + length - 1] + 1) % n  # the cells before and after
    apart = ~(is_near[first - 1] | is_near[(last + 1) % n])  # from the reversals before and after
    turned = means[last] - means[first]  # 1 or less where it stands still on one side
    is_short = apart & (length <= _CELLS) & (np.add.reduceat(crosses[near].astype(int), begins) == 1)
    is_short &= np.abs(turned) > 1
    c = (step[first] - step[first - 1] + step[(last + 1) % n] - step[last]) / 2
    b = (step[first] - step[last] + c * (length + 1)) / np.where(is_short, turned, 1.0)
    middle = (step[first] + step[last] + b * (means[last] + means[first])) / 2
    own = np.repeat(np.arange(len(begins)), length)
    a = middle[own] + c[own] * (np.arange(len(near)) - begins[own] - (length[own] - 1) / 2)
    moves = np.minimum.reduceat((np.abs(b[own]) < _STUCK * np.abs(a)).astype(int), begins) > 0
    kept = (is_short & moves)[own]
    return near[kept], a[kept], b[own][kept], c[own][kept]


def _sag(u: FloatArray, after: FloatArray) -> FloatArray:
    """Fall (n,) of a mean of tanh for each c of a bend: - int sech^2(u) t (t - 1) / 2 dt along a line."""
    step = after - u
    sag = (1 - np.tanh((u + after) / 2) ** 2) / 12
    steep = np.abs(step) > _STEEP
    u, after, step = u[steep], after[steep], step[steep]
    mean = (_integral(after) - _integral(u)) / step
    sag[steep] = ((_log_cosh(u, 0.0) + _log_cosh(after, 0.0)) / 2 - mean) / step**2
    return sag


def _integral(u: FloatArray) -> FloatArray:
    """Of ln cosh u from 0 on (n,)."""
    size = np.abs(u)
    beyond = (spence(1 + np.exp(-2 * size)) + np.pi**2 / 12) / 2
    return np.asarray(np.sign(u) * (size * (size / 2 - np.log(2)) + beyond))


@lru_cache(maxsize=4)
def _from_means(n: int) -> ComplexArray:
    """Spectrum (n // 2 + 1,) at the points by that of means over the cells that begin there."""
    half = np.arange(n // 2 + 1) / n  # of the angle between two points, over pi
    return np.asarray(np.exp(-1j * np.pi * half) / np.sinc(half))


def following(x: Signal) -> Signal:
    """Of each point (n,) of a period the value at the next."""
    return np.concatenate([x[1:], x[:1]])


def _log_cosh(u: FloatArray, ratio: FloatArray | float) -> FloatArray:
    """ln(cosh u - ratio sinh u) (n,), |ratio| < 1."""
    side = ratio * np.sign(u)
    return np.asarray(np.abs(u) + np.log((1 - side + (1 + side) * np.exp(-2 * np.abs(u))) / 2))
