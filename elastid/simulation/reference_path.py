r"""The path of sampled references to the joint controller: interpolation, moving average, low pass.

.. math:: F_r(z) = \frac{1}{n} \Big( \sum_j h_j z^{-j} \Big) \Big( \frac{1 - a}{1 - a z^{-1}} \Big)^{order},
          \qquad a = e^{-2 \pi f_c / f_s}

n: samples of the controller, at f_s, in a cycle of the references; h: impulse response of interpolator and moving
average. Response and played signal use the same h and a, so that they agree exactly at the samples. `spline` is the
cubic through the references whose velocities are central differences (Catmull and Rom, 1974).
"""

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.simulation.spec import ReferencePathSpec


@dataclass(frozen=True)
class ReferencePath:
    """The path of a section `reference` in a controller that is sampled at rate_hz."""

    spec: ReferencePathSpec
    rate_hz: float

    @property
    def taps(self) -> tuple[FloatArray, int]:
        """Impulse response h (m,), and the samples by which it starts before its reference."""
        n, window = self.spec.cycle_samples(self.rate_hz), max(1, round(self.spec.moving_average * self.rate_hz))
        early = 2 * n - 1 if self.spec.interpolation == "spline" else 0
        t = np.abs(np.arange(-early, early + 1)) / n
        near, far = 1.5 * t**3 - 2.5 * t**2 + 1, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
        hold = np.ones(n)
        shapes = {"hold": hold, "linear": np.convolve(hold, hold) / n, "spline": np.where(t <= 1, near, far)}
        return np.convolve(shapes[self.spec.interpolation], np.ones(window) / window), early

    @property
    def lag(self) -> float:
        """Pole a of the low pass, 0 without one."""
        return 0.0 if self.spec.filter_hz is None else float(np.exp(-2 * np.pi * self.spec.filter_hz / self.rate_hz))

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """Compute F_r (F,) at freq_hz (F,)."""
        (h, early), z_inverse = self.taps, np.exp(-2j * np.pi * freq_hz / self.rate_hz)
        interpolate = z_inverse[:, None] ** (np.arange(len(h)) - early) @ h / self.spec.cycle_samples(self.rate_hz)
        return np.asarray(interpolate * ((1 - self.lag) / (1 - self.lag * z_inverse)) ** self.spec.filter_order)

    def played(self, rows: FloatArray) -> FloatArray:
        """Compute the reference inside the controller (m n, n_u) from rows (m, n_u) that are at rest at both ends."""
        from scipy.signal import lfilter, upfirdn  # takes a while

        (h, early), n = self.taps, self.spec.cycle_samples(self.rate_hz)
        offsets = np.vstack([rows, np.repeat(rows[-1:], 2, axis=0)]) - rows[0]
        x = upfirdn(h, offsets, up=n, axis=0)[early : early + len(rows) * n]
        for _ in range(self.spec.filter_order):
            x = lfilter([1 - self.lag], [1.0, -self.lag], x, axis=0)
        return np.asarray(rows[0] + x)
