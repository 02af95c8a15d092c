r"""Friction over speed from run-downs: a joint coasts one way until it stands, and its rigid body is known.

.. math:: g(|\dot q|) = s\, [u - \tau_r(q, \dot q, \ddot q)], \quad s = \mathrm{sgn}\, \dot q

with tau_r the torque of rigid body, rotor and payload of the robot's file, and u = 0 where the drive is off. Of a
motion one way an offset of the torque cannot be distinguished from Coulomb friction, nor an error of the inertia from a
factor of all friction. A level is the mean over a range of speeds, both sides of the equation behind the filter of
`motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_study.levels import LEVELS, Levels, PassLevels
from elastid.friction_study.motion_signals import MotionSignals
from elastid.record import FrictionRecord


@dataclass(frozen=True)
class RunDownLimits:
    """Ranges of speed of a run-down."""

    min_speed: float = 0.02  # of the highest, below which the filter mixes sliding with standstill
    ranges: int = 16  # of equal ratios
    min_samples: int = 4  # behind the filter in a range, a period of its passband
    lags: int = 16  # of the autocovariance of residuals
    min_variance_share: float = 0.1  # of the mean of white residuals: they are blue, being differentiated twice


LIMITS = RunDownLimits()


def levels_of_run_downs(
    records: Sequence[FrictionRecord], signals: Sequence[MotionSignals], rigid: Sequence[FloatArray], inertia: float
) -> PassLevels:
    """The levels of run-downs of one joint; DataError where it does not coast, or friction drives.

    signals: those of the motion of each record.  rigid (n,): torque of rigid body, rotor and payload.
    """
    rows = [row for each in zip(records, signals, rigid, strict=True) for row in _rows(*each)]
    first = records[0]
    if not rows:
        raise DataError(
            f"{first.place}: joint {first.joint} does not coast through any range of speeds for longer than "
            f"{LIMITS.min_samples / signals[0].kept_hz:.2g} s; record run-downs from higher speeds"
        )
    speed, direction, torque, std, load, temperature = np.array(rows).T
    known = std < LEVELS.max_relative_std * np.abs(torque)
    levels = Levels(f"joint {first.joint}", speed, direction, torque, std, load, temperature, first.slides)
    if not known.any():
        raise DataError(
            f"{first.place}: no level of joint {first.joint} is known to {LEVELS.max_relative_std:.0%}, the best is "
            f"{torque[np.argmin(std)]:.3g} +- {std.min():.2g}; repeat the run-down, with a finer encoder"
        )
    unit = "kg" if first.slides else "kg*m^2"
    one_way = "" if len({*direction.tolist()}) > 1 else ", and an offset of the torque is part of Coulomb friction"
    text = (
        f"its run-downs give friction relative to the inertia of the robot's file, {inertia:.4g} {unit}: 1 % of it is "
        f"1 % of every level, which no interval has in it{one_way}"
    )
    note = Note("known-inertia", text, f"joint {first.joint}", severity="information")
    rms = float(np.sqrt(np.mean(std[known] ** 2)))
    return PassLevels(levels.select(known), {"inertia": (inertia, 0.0)}, rms, (note,))


def _rows(record: FrictionRecord, signals: MotionSignals, rigid: FloatArray) -> list[tuple[float, ...]]:
    """Speed, direction, torque, std, load and temperature of each range of speeds of one run-down."""
    v, direction = signals.filtered(signals.velocity), signals.filtered(signals.direction)
    s = float(np.sign(v[np.argmax(np.abs(v))]))
    friction, speed = s * signals.filtered(record.torque - rigid), s * v
    highest = float(speed.max())
    edges = np.geomspace(LIMITS.min_speed * highest, highest * (1 + 1e-9), LIMITS.ranges + 1)
    in_range = np.digitize(speed, edges) * (s * direction > 0.98)
    rows, residuals = [], []
    for number in range(1, LIMITS.ranges + 1):
        own = np.flatnonzero(in_range == number)
        if len(own) < LIMITS.min_samples:
            continue
        X = np.stack([np.ones(len(own)), speed[own] - speed[own].mean()], axis=1)
        X = X if np.ptp(speed[own]) > 1e-9 * highest else X[:, :1]
        level = np.linalg.lstsq(X, friction[own], rcond=None)[0]
        residuals.append(friction[own] - X @ level)
        rows.append((float(speed[own].mean()), float(level[0]), len(own)))
    gamma = _autocovariance(residuals)
    variance = [max(gamma[0] * LIMITS.min_variance_share, _of_mean(gamma, n)) / n for _, _, n in rows]
    return [
        (mean, s, level, float(np.sqrt(own)), record.load_torque, record.mean_temperature)
        for (mean, level, _), own in zip(rows, variance, strict=True)
    ]


def _autocovariance(residuals: Sequence[FloatArray]) -> FloatArray:
    """gamma (lags,) of residuals that have one in all ranges; each range took two numbers from them."""
    lags = range(min([LIMITS.lags, *map(len, residuals)]))
    sums = [sum(float(e[k:] @ e[: len(e) - k]) for e in residuals) for k in lags]
    return np.array([x / max(1, sum(len(e) - 2 - k for e in residuals)) for k, x in zip(lags, sums, strict=True)])


def _of_mean(gamma: FloatArray, n: int) -> float:
    """n times the variance of the mean of n samples, Bartlett's weights on the lags."""
    k = np.arange(1, min(len(gamma), n))
    return float(gamma[0] + 2 * np.sum((1 - k / len(gamma)) * (1 - k / n) * gamma[1 : len(k) + 1]))
