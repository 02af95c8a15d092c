r"""Three masses in a row on springs to the ground, shaken at two of them: a structure without joints, as a log has it.

.. math:: M \ddot x + D \dot x + K x = B u, \qquad Y = -\omega^2 C\, [K - \omega^2 M + j \omega D]^{-1} B\, U
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray

# kg, N/m (ground to first, first to second ...), and modal damping.
MASSES = (2.0, 1.5, 1.0)
STIFFNESSES = (30e3, 40e3, 25e3)
DAMPING = (0.010, 0.015, 0.020)
# The masses that a shaker pushes, and the lines, as parts of the rate, that both shakers excite.
SHAKEN = (0, 2)
BAND = (0.01, 0.4)


@dataclass(frozen=True)
class ShakenMasses:
    """One experiment at even times: force (n, 2) in N, acceleration (n, 3) in m/s^2."""

    force: FloatArray
    acceleration: FloatArray


def true_modes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Natural frequencies in rad/s, damping ratios, and mode shapes (3, 3) of unit modal mass, column by column."""
    root = np.diag(1 / np.sqrt(MASSES))
    k = np.array([*STIFFNESSES, 0.0])
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    squares, vectors = np.linalg.eigh(root @ K @ root)
    return np.sqrt(squares), np.array(DAMPING), root @ vectors


def true_response(freq_hz: FloatArray) -> ComplexArray:
    """G (F, 3, 2): acceleration of each mass per force of each shaker, m/s^2 per N."""
    natural, damping, shapes = true_modes()
    omega = 2 * np.pi * freq_hz[:, None]
    modal = -(omega**2) / (natural**2 - omega**2 + 2j * damping * natural * omega)
    return np.asarray(np.einsum("ir,fr,jr->fij", shapes, modal, shapes[list(SHAKEN)]))


def shake(rate_hz: float, period_samples: int, periods: int, seed: int) -> tuple[ShakenMasses, ShakenMasses]:
    """Both experiments of one realisation of a periodic multisine, in their steady state, with sensor noise.

    In the second the second shaker pushes with the other sign, so that the two separate the shakers at every line.
    """
    random = np.random.default_rng(seed)
    lines = np.arange(round(BAND[0] * period_samples), round(BAND[1] * period_samples))
    amplitude = 5.0 * np.sqrt(2 / len(lines)) * period_samples / 2
    U = amplitude * np.exp(2j * np.pi * random.random((len(lines), len(SHAKEN))))
    G = true_response(lines * rate_hz / period_samples)
    first, second = (
        _noisy(_signal(lines, F, period_samples), _signal(lines, G @ F[..., None], period_samples), periods, random)
        for F in (U, U * [1, -1])
    )
    return first, second


def _signal(lines: IntArray, spectrum: ComplexArray, period_samples: int) -> FloatArray:
    """One period (N, n) of a signal with its spectrum (F, n) at some lines."""
    padded = np.zeros((period_samples // 2 + 1, spectrum.shape[1]), complex)
    padded[lines] = spectrum.reshape(len(lines), -1)
    return np.asarray(np.fft.irfft(padded, period_samples, axis=0))


def _noisy(force: FloatArray, acceleration: FloatArray, periods: int, random: np.random.Generator) -> ShakenMasses:
    force, acceleration = np.tile(force, (periods, 1)), np.tile(acceleration, (periods, 1))
    return ShakenMasses(
        force + 0.05 * random.standard_normal(force.shape),
        acceleration + 0.1 * random.standard_normal(acceleration.shape),
    )
