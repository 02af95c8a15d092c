r"""What Coulomb friction does to a frequency response: some damping, and a distortion that looks like noise.

.. math:: \tau_c\, \mathrm{sign}(v_c + v) = d\, v + s, \qquad
          d = \frac{\mathrm{Re} \sum_k V_k^* T_k}{\sum_k |V_k|^2}

T_k are the lines of the friction torque, V_k those of the motor's velocity under the multisine, v_c the velocity of the
carrier. d is the best linear approximation, which the fit finds as viscous friction; s hangs on the phases, returns in
every period and averages over realisations only.
"""

from __future__ import annotations

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.multisine import synthesise

# Lines over which the level of the distortion is averaged: it is drawn from few experiments.
SMOOTH = 9


def friction_level(
    V: ComplexArray, lines: IntArray, period_samples: int, coulomb: FloatArray, carrier_velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """d (n_u,) and E|s_k|^2 (F, n_u) of velocities V (K, F, n_u) in K experiments, link side.

    coulomb (n_u,): Nm.  carrier_velocity (period_samples, n_u): rad/s, of every motor.
    """
    v = np.stack([synthesise(lines, one, period_samples) for one in V]) + carrier_velocity
    T = np.fft.rfft(coulomb * np.sign(v), axis=1)[:, lines] * (2 / period_samples)
    d = np.sum(V.conj() * T, axis=(0, 1)).real / np.sum(np.abs(V) ** 2, axis=(0, 1))
    power = np.mean(np.abs(T - d * V) ** 2, axis=0)
    width = min(SMOOTH, len(lines))
    window = np.ones(width)
    weight = np.convolve(np.ones(len(lines)), window, "same")
    smooth = np.stack([np.convolve(column, window, "same") / weight for column in power.T], axis=1)
    return d, smooth
