r"""Columns of a modal model along frequency: poles and the residuals of modes outside the band.

.. math:: G(s) = \sum_r \left( \frac{R_r}{s - \lambda_r} + \frac{\bar R_r}{s - \bar\lambda_r} \right)
          + \sum_p C_p\, s^{k+p}, \quad s = j\omega,\ p = -2, -1, 0, 1, 2

k: 0, 1, 2 for position, velocity, acceleration, so that p = -2 is the lower residual (a mass), p = 0 the upper one (a
compliance) and the others are their next terms.  A response by Welch's method is smoothed by the window of segments,

.. math:: \frac{1}{s - \lambda} \to \int_0^T \rho_w(\tau)\, e^{(\lambda - j\omega) \tau} d\tau, \qquad
          \rho_w(\tau) = \frac{\int w(t)\, w(t + \tau)\, dt}{\int w^2(t)\, dt}

where the input is white within the width of a line; the smoothed columns have no leakage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.record import MOTION_ORDER
from elastid.response import FrequencyResponse

RESIDUALS = (-2, -1, 0, 1, 2)


@dataclass(frozen=True)
class Basis:
    """Columns at freq_hz (F,) for responses in a quantity of order k; correlation (n,): rho_w at samples of a segment.

    scale: of frequency in rad/s, so that columns have size 1.
    """

    freq_hz: FloatArray
    order: int
    scale: float
    correlation: FloatArray | None = None
    segment_s: float = 0.0

    @classmethod
    def of(cls, response: FrequencyResponse) -> Basis:
        """The columns for a response, smoothed where its segments had a window."""
        correlation = None
        if response.window and response.n_lines > 1:
            correlation = window_correlation(response)
        scale = 2 * np.pi * float(response.freq_hz[-1])
        order = MOTION_ORDER[response.quantity]
        return cls(response.freq_hz, order, scale, correlation, response.segment_s)

    @property
    def s(self) -> ComplexArray:
        """j omega (F,) over the scale."""
        return np.asarray(2j * np.pi * self.freq_hz / self.scale)

    def poles(self, poles: ComplexArray, derivative: bool = False) -> ComplexArray:
        """1 / (s - lambda) (F, n) for poles (n,) over the scale, or its derivative by lambda."""
        if self.correlation is not None:
            return self._smoothed(poles, derivative)
        columns = 1 / (self.s[:, None] - poles)
        return np.asarray(columns**2 if derivative else columns)

    def _smoothed(self, poles: ComplexArray, derivative: bool) -> ComplexArray:
        assert self.correlation is not None
        n = len(self.correlation)
        lines = np.round(self.freq_hz * self.segment_s).astype(int)
        step = self.scale * self.segment_s / n
        time = step * np.arange(n)
        columns = np.empty((len(lines), len(poles)), complex)
        for i, pole in enumerate(poles):
            decay = self.correlation * np.exp(pole.real * time + 1j * (pole.imag * time))
            decay[0] /= 2  # the trapezoidal rule
            columns[:, i] = step * np.fft.fft(decay * time if derivative else decay)[lines % n]
        # Of the discrete sum that which a continuous pole has not: images, as smooth as the residuals.
        return columns

    def residuals(self) -> FloatArray:
        """Real columns (2 F, 5), real over imaginary parts, of the residuals."""
        s = self.s
        middle = float(np.sqrt(np.abs(s[0] * s[-1])))
        columns = np.stack([(s / middle) ** (self.order + p) for p in RESIDUALS], axis=1)
        return stacked(columns)

    def real_columns(self, poles: ComplexArray, derivative: bool = False) -> FloatArray:
        """Columns (2 F, 2 n) of the real and imaginary parts of each pole's residue, or their derivatives by the pole.

        Column 2 r belongs to Re R_r, column 2 r + 1 to Im R_r; derivatives are those by Re lambda.
        """
        own, mirrored = self.poles(poles, derivative), self.poles(poles.conj(), derivative)
        columns = np.stack([own + mirrored, 1j * (own - mirrored)], axis=2)
        return stacked(columns.reshape(len(columns), -1))


def window_correlation(response: FrequencyResponse) -> FloatArray:
    """rho_w (n,) over one segment, with at least two samples in a period of the highest line."""
    from scipy.signal import get_window

    n = 2 << int(np.ceil(np.log2(response.freq_hz[-1] * response.segment_s + 2)))
    w = np.asarray(get_window(response.window, n), dtype=float)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(w, 2 * n)) ** 2)[:n]
    return np.asarray(correlation / correlation[0])


def stacked(columns: ComplexArray) -> FloatArray:
    """Real parts over imaginary parts (2 F, ...)."""
    return np.concatenate([columns.real, columns.imag], axis=0)


def unstacked(columns: FloatArray) -> ComplexArray:
    """Complex (F, ...) of real over imaginary parts."""
    real, imaginary = np.split(columns, 2)
    return np.asarray(real + 1j * imaginary)
