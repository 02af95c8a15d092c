r"""A motor and a link with two bending modes under a speed controller, and its records of sine sweeps.

.. math:: [M s^2 + D s + K]\, q = b_u u + b_d d, \qquad u = r - c\, s q_1

with the records of band-limited signals: exact whatever the rate.
"""

import numpy as np
from scipy.signal import chirp

from elastid.base.arrays import ComplexArray, FloatArray

RATE_HZ, DURATION = 250.0, 20.0
OUTPUTS = ("motor_speed", "tip")
# kg m^2 of the motor and two parts of the link, N m/rad between them, N m s/rad of bearing and joints.
INERTIA, SPRINGS = (2e-3, 1e-3, 0.5e-3), (8.0, 20.0)
FRICTION, DAMPING = 0.02, (2e-3, 3e-3)
SPEED_GAIN = 0.05
TORQUE, TORQUE_NOISE, SPEED_NOISE, TIP_NOISE, DISTURBANCE = 1.0, 1e-3, 0.02, 2.0, 0.02


def _matrices() -> tuple[FloatArray, FloatArray, FloatArray]:
    def of(values: tuple[float, float]) -> FloatArray:
        a, b = values
        return np.array([[a, -a, 0], [-a, a + b, -b], [0, -b, b]])

    return np.diag(INERTIA), of(DAMPING) + np.diag([FRICTION, 0, 0]), of(SPRINGS)


def response(freq_hz: FloatArray) -> ComplexArray:
    """G (F, 2, 1): acceleration of motor and tip per torque of the motor."""
    s = 2j * np.pi * freq_hz[:, None, None]
    M, D, K = _matrices()
    q = np.linalg.inv(M * s**2 + D * s + K)[:, [0, 2], :1]
    return np.asarray(s**2 * q)


def peaks_hz() -> FloatArray:
    """Natural frequencies of the two modes."""
    M, D, K = _matrices()
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    poles = np.linalg.eigvals(A)
    return np.sort(np.abs(poles[poles.imag > 1])) / (2 * np.pi)


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
    speed = np.full(len(s), 1 / FRICTION, complex)
    speed[1:] = G[1:, 0] / s[1:]
    U = (R - SPEED_GAIN * speed * E) / (1 + SPEED_GAIN * speed)
    spectra = (R, U, speed * (U + E), G[:, 1] * (U + E))
    clean = np.stack([np.fft.irfft(X)[:n] for X in spectra], axis=1)
    return clean + [0, TORQUE_NOISE, SPEED_NOISE, TIP_NOISE] * rng.standard_normal(clean.shape)
