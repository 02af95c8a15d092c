r"""The three-mass plant under a speed controller, and its records of sine sweeps.

.. math:: [M s^2 + D s + K]\, q = b_u u + b_d d, \qquad u = r - c\, s q_1

with the records of band-limited signals: exact whatever the rate.
"""

import numpy as np
from scipy.signal import chirp

from elastid.base.arrays import ComplexArray, FloatArray
from plants.three_mass import plant

RATE_HZ, DURATION = 250.0, 20.0
OUTPUTS = ("motor_speed", "tip")
SPEED_GAIN = 0.05
TORQUE, TORQUE_NOISE, SPEED_NOISE, TIP_NOISE, DISTURBANCE = 1.0, 1e-3, 2e-3, 0.2, 0.02
PLANT = plant()


def response(freq_hz: FloatArray) -> ComplexArray:
    """G (F, 2, 1): acceleration of motor and tip per torque of the motor."""
    s = 2j * np.pi * freq_hz[:, None, None]
    q = np.linalg.inv(PLANT.M * s**2 + PLANT.D * s + PLANT.K)[:, [0, 2], :1]
    return np.asarray(s**2 * q)


def sweep(band_hz: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """reference, torque, speed of the motor, acceleration of the tip (n, 4) of one sweep from rest, with noise."""
    t = np.arange(round(RATE_HZ * DURATION)) / RATE_HZ
    reference, n = TORQUE * chirp(t, band_hz[0], DURATION, band_hz[1], phi=-90), len(t)
    disturbance = DISTURBANCE * rng.standard_normal(n)
    # As long again of rest, in which the motion dies out, so that the spectra are those of the motion from rest.
    R, E = (np.fft.rfft(x, 2 * n) for x in (reference, disturbance))
    freq_hz = np.fft.rfftfreq(2 * n, 1 / RATE_HZ)
    s = 2j * np.pi * freq_hz
    G = np.zeros((len(s), 2), complex)
    G[1:] = response(freq_hz[1:])[:, :, 0]
    speed = np.full(len(s), 1 / PLANT.D.sum(), complex)
    speed[1:] = G[1:, 0] / s[1:]
    U = (R - SPEED_GAIN * speed * E) / (1 + SPEED_GAIN * speed)
    spectra = (R, U, speed * (U + E), G[:, 1] * (U + E))
    clean = np.stack([np.fft.irfft(X)[:n] for X in spectra], axis=1)
    return clean + [0, TORQUE_NOISE, SPEED_NOISE, TIP_NOISE] * rng.standard_normal(clean.shape)
