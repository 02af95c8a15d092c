r"""Gain, phase and delay margins of single loops from their frequency responses, many at once.

.. math:: A_m = \frac{1}{|L(\omega_{180})|}, \qquad \varphi_m = \arg(-L(\omega_c)), \qquad
          T_m = \frac{\varphi_m \bmod 2 \pi}{\omega_c}

omega_180: where L is real and negative, omega_c: where |L| = 1, both between lines by ln L, which is linear there. Of
several crossings the smallest margin counts.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value, labelled


@frozen_value
class Margins:
    """Of loops (Q, n_u): factors by which a gain may rise, and to which it may fall, phase in rad, delay in s.

    Infinite, or 0 for `fall`, where no line has the crossing.
    """

    rise: FloatArray = labelled("factor by which the gain may rise", "", "postures axes")
    fall: FloatArray = labelled("factor to which the gain may fall", "", "postures axes")
    phase: FloatArray = labelled("phase margin", "rad", "postures axes")
    delay: FloatArray = labelled("delay margin", "s", "postures axes")


def margins(L: ComplexArray, freq_hz: FloatArray) -> Margins:
    """Of L (..., F) at freq_hz (..., F)."""
    ln, omega = np.log(np.abs(L)), 2 * np.pi * np.broadcast_to(freq_hz, L.shape)
    turn = np.angle(-L)
    step = np.diff(turn)
    share, crosses = _crossings(turn, np.abs(step) < np.pi)
    size = np.exp(-_between(ln, share))
    rise = np.where(crosses & (size > 1), size, np.inf).min(axis=-1)
    fall = np.where(crosses & (size < 1), size, 0.0).max(axis=-1)
    share, crosses = _crossings(ln, np.ones_like(step, bool))
    step = (step + np.pi) % (2 * np.pi) - np.pi
    left = turn[..., :-1] + share * step
    left = (left + np.pi) % (2 * np.pi) - np.pi
    phase = np.where(crosses, np.abs(left), np.inf).min(axis=-1)
    late = left % (2 * np.pi) / np.exp(_between(np.log(omega), share))
    return Margins(rise, fall, phase, np.where(crosses, late, np.inf).min(axis=-1))


def _crossings(values: FloatArray, is_short: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """Share of the way (..., F - 1) to the next line at which values pass 0, and where they do."""
    first, second = values[..., :-1], values[..., 1:]
    crosses = (np.sign(first) != np.sign(second)) & is_short
    away = np.where(crosses, first - second, 1.0)
    return np.where(crosses, first / np.where(away == 0, 1.0, away), 0.0), crosses


def _between(values: FloatArray, share: FloatArray) -> FloatArray:
    return np.asarray(values[..., :-1] + share * np.diff(values))
