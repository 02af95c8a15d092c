r"""Cascade of P position and PI velocity controllers with notches and a low pass on each axis, and its derivatives.

With filters N and L and a delay of d samples,

.. math:: F = K_v \Bigl(K_p + \frac{1 - z^{-1}}{T_s}\Bigr) \Bigl(1 + \frac{T_s}{T_i} \frac{z^{-1}}{1 - z^{-1}}\Bigr)
          \prod N \, L \, z^{-d}, \qquad T_i = 1 / K_p

With this T_i the loop has a double zero at K_p: it rejects disturbances as fast as it follows references.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.record import JointLoop
from elastid.simulation.controller import Filters, low_pass, notch
from elastid.simulation.spec import ControllerSpec, GainsSpec, NotchSpec
from elastid.use.closed_loops import Closed, Scene

WIDTHS, DEPTHS = (0.15, 3.0), (0.05, 1.0)  # ranges of notches
LOWEST, HIGHEST = 2e-3, 0.45  # frequency of a notch over the rate
CORNER = 0.4  # largest corner of a low pass over the rate


@frozen_value(eq=False)
class Cascade:
    """Positive K_p, K_v and corner of the low pass (n_u,), and notches (n, 3) of the motors `axes` (n,).

    delay: in samples.
    """

    position_gain: FloatArray = labelled("gain of the position loop", "1/s", "joints")
    velocity_gain: FloatArray = labelled("gain of the velocity loop, link side", "SI", "joints")
    low_pass_hz: FloatArray = labelled("corner of the low pass", "Hz", "joints")
    delay: int
    notches: FloatArray = labelled("frequency in Hz, width, depth", "", "axes quantity")
    axes: tuple[int, ...] = ()

    @property
    def vector(self) -> FloatArray:
        """Logarithms x (n_x,) of all numbers."""
        return np.log(np.concatenate((self.position_gain, self.velocity_gain, self.low_pass_hz, self.notches.ravel())))

    @property
    def owners(self) -> IntArray:
        """Axis (n_x,) of each entry of x."""
        return np.concatenate([*[np.arange(len(self.velocity_gain))] * 3, np.repeat(np.array(self.axes, int), 3)])

    def at(self, x: FloatArray) -> "Cascade":
        """Return the cascade with the numbers exp(x), x (n_x,)."""
        p, v, corner, notches = np.split(np.exp(x), np.cumsum([len(self.velocity_gain)] * 3))
        return replace(self, position_gain=p, velocity_gain=v, low_pass_hz=corner, notches=notches.reshape(-1, 3))

    def bounds(self, reach: float, rate_hz: float) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds (n_x,): x -+ reach, and realisable filters."""
        x, n = self.vector, len(self.velocity_gain)
        low, high = x - reach, x + reach
        high[2 * n : 3 * n] = np.minimum(high[2 * n : 3 * n], np.log(CORNER * rate_hz))
        ends = np.log([[LOWEST * rate_hz, HIGHEST * rate_hz], WIDTHS, DEPTHS]).T
        low[3 * n :] = np.maximum(low[3 * n :].reshape(-1, 3), ends[0]).ravel()
        high[3 * n :] = np.minimum(high[3 * n :].reshape(-1, 3), ends[1]).ravel()
        return np.minimum(low, x), np.maximum(high, x)

    def slower(self, position: float, velocity: float) -> "Cascade":
        """Return the cascade with position and velocity gains multiplied by factors, and the same filters."""
        return replace(self, position_gain=position * self.position_gain, velocity_gain=velocity * self.velocity_gain)

    @property
    def gains(self) -> JointLoop:
        """Gains (n_u,) of the equivalent PID loop, for simulations."""
        return JointLoop(self.position_gain * self.velocity_gain, self.velocity_gain, self.position_gain)

    def filters(self, rate_hz: float) -> Filters:
        """Return notches, low pass and delay."""
        sections = [[low_pass(corner, rate_hz)] for corner in self.low_pass_hz]
        for axis, row in zip(self.axes, self.notches, strict=True):
            sections[axis].insert(-1, notch(row[0], row[1], row[2], rate_hz))
        return Filters(tuple(sections), self.delay)

    def log_slopes(self, delay: ComplexArray, rate_hz: float) -> ComplexArray:
        r"""Return d ln F_i / dx (..., n_x) at delay = 1 / z (...); i is the axis of each entry of x.

        .. math:: L = \frac{1}{s^2 + \sqrt 2 s + 1}, \quad N = \frac{s^2 + d w s + 1}{s^2 + w s + 1}, \quad
                  s = \frac{1 - z^{-1}}{1 + z^{-1}} \Big/ \tan\frac{\omega}{2 f_s}
        """
        backward = 1 - delay[..., None]
        centre, width, depth = self.notches.T

        def scaled_s(filter_hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
            """Return s (..., n), and d ln s / d ln omega (n,)."""
            omega = 2 * np.pi * filter_hz / rate_hz
            return backward / (2 - backward) / np.tan(omega / 2), -omega / np.sin(omega)

        def slope(s: ComplexArray, w: FloatArray | float) -> ComplexArray:
            """Return d ln (s^2 + w s + 1) / d ln s."""
            return (2 * s**2 + w * s) / (s**2 + w * s + 1)

        integral = self.position_gain / rate_hz * (1 - backward) / backward
        of_position = self.position_gain / (self.position_gain + rate_hz * backward) + integral / (1 + integral)
        (low, low_rate), (s, rate) = scaled_s(self.low_pass_hz), scaled_s(centre)
        above, below = (w * s / (s**2 + w * s + 1) for w in (depth * width, width))
        of_centre = (slope(s, depth * width) - slope(s, width)) * rate
        of_notches = np.stack([of_centre, above - below, above], axis=-1).reshape(*delay.shape, -1)
        of_corner = -slope(low, math.sqrt(2)) * low_rate
        return np.concatenate([of_position, np.ones_like(of_position), of_corner, of_notches], axis=-1)

    def on(self, scene: Scene) -> Closed:
        """Return the loops of this cascade and the plants of a scene."""
        return Closed(scene, self.gains, self.filters(scene.plants.rate_hz))

    def reached(self, scene: Scene) -> float:
        """Return the mean over axes of the logarithm of the smallest bandwidth of all plants."""
        return float(np.log(self.on(scene).bandwidth_hz.min(axis=0)).mean())

    def to_spec(self, joints: Sequence[str]) -> ControllerSpec:
        """Return the controller as a section of a study, to six digits."""

        def rounded(values: FloatArray) -> tuple[float, ...]:
            return tuple(float(f"{value:.6g}") for value in values)

        pairs = zip(self.axes, self.notches, strict=True)
        notches = tuple(NotchSpec(joints[axis], *rounded(row)) for axis, row in pairs)
        position, velocity, integral = map(rounded, (self.position_gain, self.velocity_gain, 1 / self.position_gain))
        gains = GainsSpec(position, velocity, integral, notches, rounded(self.low_pass_hz))
        return ControllerSpec(kind="cascade", gains=gains, delay_samples=self.delay)
