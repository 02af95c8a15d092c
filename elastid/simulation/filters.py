r"""Filters behind the feedback of each motor: notches, a low pass, and the samples that computing takes.

.. math:: N(s) = \frac{s^2 + d\, w\, \omega s + \omega^2}{s^2 + w\, \omega s + \omega^2}, \qquad
          L(s) = \frac{\omega^2}{s^2 + \sqrt{2}\, \omega s + \omega^2}, \qquad
          s = \frac{\omega}{\tan(\omega T_s / 2)}\, \frac{1 - z^{-1}}{1 + z^{-1}}

each by Tustin's rule, exact at its own frequency omega; d: gain that a notch leaves there, w: its width between -3 dB
points over omega, of a notch with d = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.linalg import block_diag

from elastid.base.arrays import ComplexArray, FloatArray

# Numerator and denominator in powers of 1 / z, as second-order sections of SciPy.
Section: TypeAlias = tuple[float, float, float, float, float, float]


def notch(freq_hz: FloatArray, width: FloatArray, depth: FloatArray, rate_hz: float) -> FloatArray:
    """Sections (..., 6) of notches N."""
    omega = 2 * np.pi * np.asarray(freq_hz)
    one, square = np.ones_like(omega), omega**2
    return _sampled((one, depth * width * omega, square), (one, width * omega, square), omega, rate_hz)


def low_pass(freq_hz: FloatArray, rate_hz: float) -> FloatArray:
    """Sections (..., 6) of Butterworth filters L of second order."""
    omega = 2 * np.pi * np.asarray(freq_hz)
    none, square = np.zeros_like(omega), omega**2
    return _sampled((none, none, square), (np.ones_like(omega), np.sqrt(2) * omega, square), omega, rate_hz)


def _sampled(b: tuple[FloatArray, ...], a: tuple[FloatArray, ...], omega: FloatArray, rate_hz: float) -> FloatArray:
    """Sections (..., 6) of (b_0 s^2 + b_1 s + b_2) / (a_0 s^2 + a_1 s + a_2), exact at omega."""
    K = omega / np.tan(omega / (2 * rate_hz))
    parts = [(p * K**2 + q * K + r, 2 * (r - p * K**2), p * K**2 - q * K + r) for p, q, r in (b, a)]
    return np.stack([*parts[0], *parts[1]], axis=-1) / parts[1][0][..., None]


def section_response(sections: FloatArray, z_inverse: ComplexArray) -> ComplexArray:
    """H of sections (..., 6) at 1 / z, of shapes that broadcast."""
    b, a = np.moveaxis(sections, -1, 0)[:3], np.moveaxis(sections, -1, 0)[3:]
    over = b[0] + z_inverse * (b[1] + z_inverse * b[2])
    return np.asarray(over / (a[0] + z_inverse * (a[1] + z_inverse * a[2])))


@dataclass(frozen=True)
class Filters:
    """sections of each of n_u motors, and the samples after which their torque acts."""

    sections: tuple[tuple[Section, ...], ...]
    delay: int = 0

    def response(self, freq_hz: FloatArray, rate_hz: float) -> ComplexArray:
        """H (..., n_u) at freq_hz (...)."""
        z_inverse = np.exp(-2j * np.pi * np.asarray(freq_hz) / rate_hz)
        columns = []
        for own in self.sections:
            H = z_inverse**self.delay
            for each in own:
                H = H * section_response(np.array(each), z_inverse)
            columns.append(H)
        return np.stack(columns, axis=-1)

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A (n, n), B (n, n_u), C (n_u, n), D (n_u, n_u): x_(k+1) = A x_k + B e_k, u_k = C x_k + D e_k."""
        each = [self._of_motor(own) for own in self.sections]
        A, B, C, D = (block_diag(*parts) for parts in zip(*each, strict=True))
        return A, B, C, D

    def _of_motor(self, sections: tuple[Section, ...]) -> tuple[FloatArray, ...]:
        A, B, C, D = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
        parts = [_state_space(each) for each in sections] + [_DELAY] * self.delay
        for a, b, c, d in parts:
            A = np.block([[A, np.zeros((len(A), len(a)))], [b @ C, a]])
            B, C, D = np.vstack([B, b @ D]), np.hstack([d @ C, c]), d @ D
        return A, B, C, D


_DELAY = (np.zeros((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))


def _state_space(section: Section) -> tuple[FloatArray, ...]:
    """Controllable canonical form of a section."""
    b0, b1, b2, _, a1, a2 = section
    A, B = np.array([[-a1, -a2], [1.0, 0.0]]), np.array([[1.0], [0.0]])
    return A, B, np.array([[b1 - b0 * a1, b2 - b0 * a2]]), np.array([[b0]])
