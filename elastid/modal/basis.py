r"""Columns of a modal model along frequency: poles, and the residual terms of modes outside the band.

.. math:: G(s) = \sum_r \left( \frac{R_r}{s - \lambda_r} + \frac{\bar R_r}{s - \bar\lambda_r} \right)
          + \sum_p C_p\, s^{k+p}, \quad s = j\omega,\ p = -2, -1, 0, 1, 2

k is 0, 1, 2 for position, velocity, acceleration: p = -2 is the lower residual (a mass), p = 0 the upper residual (a
compliance), and the other terms continue the series.  The window of the segments smooths a response by Welch's method,

.. math:: \frac{1}{s - \lambda} \to \int_0^T \rho_w(\tau)\, e^{(\lambda - j\omega) \tau} d\tau, \qquad
          \rho_w(\tau) = \frac{\int w(t)\, w(t + \tau)\, dt}{\int w^2(t)\, dt}

if the input is white within the width of a line.  The smoothed columns have no leakage error.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.record import MOTION_ORDER
from elastid.response import Response

RESIDUALS = (-2, -1, 0, 1, 2)


@dataclass(frozen=True)
class Basis:
    """Columns at the lines freq_hz (F,) for responses of order k.

    scale: of frequency, rad/s, so that columns have size 1.  correlation (n,): rho_w at the samples of a segment of
    segment_s; None without a window.
    """

    freq_hz: FloatArray
    order: int
    scale: float
    correlation: FloatArray | None = None
    segment_s: float = 0.0

    @classmethod
    def of(cls, response: Response) -> "Basis":
        """Return the columns for a response, smoothed if its segments had a window."""
        correlation = window_correlation(response) if response.window else None
        scale = 2 * np.pi * float(response.freq_hz[-1])
        return cls(response.freq_hz, MOTION_ORDER[response.quantity], scale, correlation, response.segment_s)

    @cached_property
    def omega(self) -> FloatArray:
        """Angular frequencies (F,) relative to the scale."""
        return 2 * np.pi * self.freq_hz / self.scale

    @cached_property
    def spacing(self) -> float:
        """Median distance of DFT lines, as angular frequency relative to the scale."""
        return float(np.median(np.diff(self.omega)))

    def poles(self, poles: ComplexArray, derivative: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return real and imaginary parts (n, F) of 1 / (s - lambda), or of its derivative by lambda; poles (n,)."""
        if self.correlation is None:
            offset = poles.imag[:, None] - self.omega
            size = poles.real[:, None] ** 2 + offset**2
            real, imag = -poles.real[:, None] / size, offset / size
            return (real**2 - imag**2, 2 * real * imag) if derivative else (real, imag)
        n, lines = len(self.correlation), np.round(self.freq_hz * self.segment_s).astype(int)
        step = self.scale * self.segment_s / n
        time = step * np.arange(n)
        decay = self.correlation * np.exp(poles[:, None] * time)
        decay[:, 0] /= 2  # trapezoidal rule
        # The discrete sum has aliases, unlike a continuous pole; they are smooth, and the residual terms fit them.
        columns = step * np.fft.fft(decay * time if derivative else decay)[:, lines % n]
        return columns.real, columns.imag

    def residuals(self) -> ComplexArray:
        """Return columns (F, 5) of the residual terms."""
        s = 1j * self.omega / np.sqrt(self.omega[0] * self.omega[-1])
        return np.stack([s ** (self.order + p) for p in RESIDUALS], axis=1)


def window_correlation(response: Response) -> FloatArray:
    """Return rho_w (n,) over one segment, with at least two samples in a period of the highest line."""
    from scipy.signal import get_window

    n = 2 << int(np.ceil(np.log2(response.freq_hz[-1] * response.segment_s + 2)))
    w = np.asarray(get_window(response.window, n), dtype=float)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(w, 2 * n)) ** 2)[:n]
    return np.asarray(correlation / correlation[0])
