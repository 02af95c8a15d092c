"""Guesses of what signals are by what they hold: rows of one sample, a clock, derivatives, and torques by Newton's law.

For logs without headings, or with such that say nothing.  All signals are compared as they are behind one Gaussian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.evidence import WIDTHS, derivative
from elastid.recorded.repair.time_stamps import even_grid

_WIDTH = WIDTHS[1]
_MAX_ROWS = 16  # of one sample: the joints of two arms
# Change from one sample to the next of a signal that is smooth, over that within a sample of several rows.
_MAX_SMOOTH = 0.05
# Of a clock: steps that differ from their median by more are none, and the share of them that may.
_MAX_STEP, _MAX_UNEVEN_SHARE = 1.0, 0.02
_MIN_CORRELATION = 0.98  # of a derivative with the signal that is it
_MIN_EXPLAINED = 0.75  # share of a torque that the motion of its joint explains
_MAX_SAMPLES = 1 << 15  # that suffice for a guess


@dataclass(frozen=True)
class MotionGuess:
    """Places, among some signals, of a torque, the position that explains it, and the velocity of that (or None)."""

    torque: int
    position: int
    velocity: int | None
    explained: float


def rows_of_a_sample(values: FloatArray) -> int:
    """How many rows of a table (n, c) make one sample: 1, or as many as lie between values that follow each other."""
    change = [np.nan_to_num(np.nanmean((values[k:] - values[:-k]) ** 2, axis=0)) for k in range(1, _MAX_ROWS + 1)]
    moving = change[0] > 0
    if len(values) < 20 * _MAX_ROWS or not moving.any():
        return 1
    shares = [float(np.max(each[moving] / change[0][moving])) for each in change]
    best = int(np.argmin(shares[1:])) + 2
    return best if shares[best - 1] < _MAX_SMOOTH and len(values) % best == 0 else 1


def is_clock(x: FloatArray) -> bool:
    """True for a signal (n,) that rises as time stamps do, by steps that are alike but for a few gaps."""
    steps = np.diff(x)
    if len(x) < 20 or not np.isfinite(x).all() or not steps.min() > 0:
        return False
    usual = float(np.median(steps))
    return even_grid(x - x[0]) is not None or float(np.mean(np.abs(steps / usual - 1) > _MAX_STEP)) < _MAX_UNEVEN_SHARE


def motions_in(signals: Sequence[FloatArray]) -> tuple[tuple[MotionGuess, ...], tuple[float, ...]]:
    """The joints whose torque, position and velocity are among signals (n,), by place, and rates in Hz.

    Rates are those at which each velocity is the derivative of its position, in the same unit.
    """
    if not signals or len(signals[0]) < 40 * _WIDTH:
        return (), ()
    X = np.stack([x[:_MAX_SAMPLES] for x in signals], axis=1)
    smooth, speed, change = (np.stack([derivative(x, k, 1.0, _WIDTH) for x in X.T], axis=1) for k in (0, 1, 2))
    velocity_of, rates = _velocities(smooth, speed)
    derived = set(velocity_of.values())
    found = [
        MotionGuess(j, i, velocity_of.get(i), explained)
        for i in range(X.shape[1])
        if i not in derived
        for j, explained in _explained(smooth, speed[:, i], change[:, i], i)
        if j not in derived | set(velocity_of)
    ]
    result: list[MotionGuess] = []
    for guess in sorted(found, key=lambda g: (g.velocity is None, -round(g.explained, 2), g.position)):
        if all(len({guess.torque, guess.position} & {other.torque, other.position}) == 0 for other in result):
            result.append(guess)
    return tuple(sorted(result, key=lambda g: g.position)), tuple(rates)


def _velocities(smooth: FloatArray, speed: FloatArray) -> tuple[dict[int, int], list[float]]:
    """The place of the velocity of each position that has one, and their ratio to the change from sample to sample."""
    a, b = (x - x.mean(axis=0) for x in (speed, smooth))
    size = np.maximum(np.linalg.norm(a, axis=0)[:, None] * np.linalg.norm(b, axis=0), 1e-300)
    rho = (a.T @ b) / size
    pairs = {i: int(np.argmax(row)) for i, row in enumerate(rho) if row.max() > _MIN_CORRELATION}
    # A velocity has an acceleration where it is logged too, and is no position then.
    pairs = {i: j for i, j in pairs.items() if i not in pairs.values()}
    return pairs, [float(np.linalg.norm(b[:, j]) / np.linalg.norm(a[:, i])) for i, j in pairs.items()]


def _explained(smooth: FloatArray, v: FloatArray, a: FloatArray, i: int) -> list[tuple[int, float]]:
    """The signals that a position explains as torques, by positive inertia and friction, and their shares."""
    q, s = smooth[:, i], np.sign(v) * (np.abs(v) > 1e-3 * np.abs(v).max())
    turn = np.pi / 180 if np.ptp(q) > 8 * np.pi else 1.0
    A = np.stack([a, v, s, np.ones_like(v), np.cos(turn * q), np.sin(turn * q)], axis=1)
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    theta = np.linalg.lstsq(A / size, smooth, rcond=1e-9)[0]
    total = np.maximum(np.var(smooth, axis=0), 1e-300)
    share = 1 - np.var(smooth - (A / size) @ theta, axis=0) / total
    friction = A[:, 1:3] / size[1:3] @ theta[1:3]
    is_torque = (theta[0] > 0) & (v @ friction > 0) & (share > _MIN_EXPLAINED)
    return [(int(j), float(share[j])) for j in np.flatnonzero(is_torque) if j != i]
