r"""A spring between the motor of an axis and its link, in the residuals of a regression of it as a rigid body.

.. math:: u = J \ddot q + J_l (H - 1) \ddot q + \dots, \qquad
          H(s) = \frac{2 \zeta \omega s + \omega^2}{s^2 + 2 \zeta \omega s + \omega^2}

J_l of the inertia J moves behind the spring, and H \ddot q, its motion, swings at omega where the motor is held.
Torques that change faster than the motion excite it: reversals of friction, ends of ramps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import freqz, lfilter

from elastid.base.arrays import FloatArray
from elastid.friction_study.least_squares import FALSE_ALARM, Equations, Regression, solve
from elastid.friction_study.motion_signals import Motion, MotionSignals
from elastid.friction_study.motion_terms import MotionTerms, equations_of

# Frequencies at which links are tried, over the passband, and damping ratio.
_FREQUENCIES, _DAMPING = np.geomspace(0.125, 2.0, 13), 0.03


@dataclass(frozen=True)
class Spring:
    """between_hz: where the link swings with the motor held.  change (n_x,): of the numbers of the rigid axis with it.

    Slow motions show J_l / omega^2 alone: the upper end is the frequency for a link of all of the inertia.
    """

    between_hz: tuple[float, float]
    change: FloatArray


def find_spring(
    motions: Sequence[Motion], signals: Sequence[MotionSignals], terms: MotionTerms, rigid: Regression
) -> Spring | None:
    """The spring that explains most of the residuals of a rigid axis; None where it is within chance."""
    names, logs = equations_of(motions, signals, terms)
    every = [(log, own, _noise_variance(motion, own)) for log, motion, own in zip(logs, motions, signals, strict=True)]
    frequencies = _FREQUENCIES * signals[0].passband_hz
    i = _best(every, rigid["inertia"], frequencies)
    between = np.geomspace(frequencies[max(i - 1, 0)], frequencies[min(i + 1, len(frequencies) - 1)], 7)
    freq_hz = float(between[_best(every, rigid["inertia"], between)])
    elastic, part, by_noise = _with_link(every, rigid["inertia"], freq_hz)
    fit = solve(elastic, signals[0].kept_hz).of_joint(0, range(len(names) + 1), (*names, "spring"))
    clear = replace(fit, values=np.append(fit.values[:-1], fit["spring"] * (1 - by_noise / part)))
    if clear.chance("spring", 1) * len(frequencies) > FALSE_ALARM:
        return None
    change = dict(zip(names, fit.values[:-1] - solve(logs, signals[0].kept_hz).beta, strict=True))
    highest_hz = freq_hz * np.sqrt(max(rigid["inertia"] / clear["spring"], 1.0))
    return Spring((freq_hz, float(highest_hz)), np.array([change.get(name, 0.0) for name in rigid.names]))


_Log = tuple[Equations, MotionSignals, float]


def _best(every: Sequence[_Log], inertia: float, frequencies: FloatArray) -> int:
    """The place of the frequency (m,) whose link, of positive inertia, explains most of the torque."""
    parts = [_with_link(every, inertia, freq_hz)[1:] for freq_hz in frequencies]
    return int(np.argmax([part - by_noise for part, by_noise in parts]))


def _with_link(every: Sequence[_Log], inertia: float, freq_hz: float) -> tuple[list[Equations], float, float]:
    """With the column of a link as the last; its part of the torque's norm, and that which is by noise of the angle.

    The noise is in the acceleration of the rigid axis, whose inertia leaves it in the residuals, and in the column.
    """
    elastic = [_of_link(log, signals, freq_hz) for log, signals, _ in every]
    X, y = (np.concatenate([getattr(log, name)[:, 0] for log in elastic]) for name in ("X", "y"))
    Q, R = np.linalg.qr(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300))
    own = Q[:, -1] * np.sign(R[-1, -1])
    product = sum(_noise_product(signals, freq_hz, variance) for _, signals, variance in every)
    return elastic, float(own @ y), float(-inertia * product / max(own @ X[:, -1], 1e-300))


def _link(rate_hz: float, freq_hz: float) -> tuple[FloatArray, FloatArray]:
    """Coefficients of H, by the bilinear transform that is exact at the frequency of the link."""
    w, z = 2 * np.pi * min(freq_hz, 0.4 * rate_hz), _DAMPING
    K = w / np.tan(w / 2 / rate_hz)
    over = np.array([2 * z * w * K + w**2, 2 * w**2, w**2 - 2 * z * w * K])
    under = np.array([K**2 + 2 * z * w * K + w**2, 2 * w**2 - 2 * K**2, K**2 - 2 * z * w * K + w**2])
    return over / under[0], under / under[0]


def _of_link(log: Equations, signals: MotionSignals, freq_hz: float) -> Equations:
    """Of a log, with the column (H - 1) q'' as the last; without all that swings freely, as it may at the start."""
    first = signals.kept.start // 2  # derivatives before are spoilt
    acceleration = signals.derivatives[1, first:]
    moved = lfilter(*_link(signals.rate_hz, freq_hz), acceleration - acceleration[0]) + acceleration[0]
    swing = 2 * np.pi * freq_hz / signals.rate_hz * (1j * np.sqrt(1 - _DAMPING**2) - _DAMPING)
    free = np.exp(swing * np.arange(len(moved)))
    of_link = np.stack([moved - acceleration, free.real, free.imag], axis=1)
    columns = signals.filtered(np.concatenate([np.zeros((first, 3)), of_link])) * signals.used[:, None]
    both = np.concatenate([log.X[:, 0], columns[:, :1], log.y], axis=1)
    swings = np.linalg.qr(columns[:, 1:])[0]
    left = both - swings @ (swings.T @ both)
    return replace(log, X=left[:, None, :-1], y=left[:, -1:])


def _noise_variance(motion: Motion, signals: MotionSignals) -> float:
    """Of white noise of the angle, by what smoothing takes from it."""
    smoothed = min(6 * signals.passband_hz / motion.rate_hz, 0.9)  # share of all frequencies that passes
    inner = slice(signals.kept.start, signals.kept.stop)
    return float(np.var((motion.acting_position - signals.position)[inner]) / (1 - smoothed))


def _noise_product(signals: MotionSignals, freq_hz: float, variance: float) -> float:
    r"""Sum over the samples in use of q'' (H - 1) q'' of white noise, behind the filter of both sides."""
    freq, H = freqz(*_link(signals.rate_hz, freq_hz), worN=4096, fs=signals.rate_hz)
    _, smooth = freqz(signals.taps, worN=4096, fs=signals.rate_hz)
    return float(signals.used.sum() * variance * np.mean((2 * np.pi * freq) ** 4 * np.abs(smooth) ** 2 * (H - 1).real))
