r"""The controller that is designed: P position, PI velocity, notches, a low pass and a delay, axis by axis.

.. math:: F = K_v \Bigl(K_p + \frac{1 - z^{-1}}{T_s}\Bigr) \Bigl(1 + \frac{T_s}{T_i} \frac{z^{-1}}{1 - z^{-1}}\Bigr)
          \prod N \, L \, z^{-d}, \qquad T_i = 1 / K_p

so that the loop has a double zero at K_p: a disturbance dies out as fast as a reference is followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.experiment.specs.simulated import ControllerSpec, GainsSpec, NotchSpec
from elastid.simulation.controller import Filters, Gains, low_pass, notch
from elastid.use.loops.sensitivity import Closed, Scene, controller_response

_STEP = 1e-5  # of a logarithm, for central differences
WIDTHS, DEPTHS = (0.15, 3.0), (0.05, 1.0)  # of notches
LOWEST, HIGHEST = 2e-3, 0.45  # of a notch over the rate
CORNER = 0.4  # largest of a low pass over the rate


@frozen_value(eq=False)
class Cascade:
    """K_p, K_v and corner of the low pass (n_u,), all positive, and notches (n, 3) of the motors `axes` (n,).

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
        """x (n_x,): logarithms of all numbers."""
        parts = self.position_gain, self.velocity_gain, self.low_pass_hz, self.notches.ravel()
        return np.asarray(np.log(np.concatenate(parts)))

    @property
    def owners(self) -> IntArray:
        """Axis of each of x."""
        return np.concatenate([*[np.arange(len(self.velocity_gain))] * 3, np.repeat(np.array(self.axes, int), 3)])

    def at(self, x: FloatArray) -> Cascade:
        """Cascade with other numbers."""
        p, v, corner, rest = np.split(np.exp(x), np.cumsum([len(self.velocity_gain)] * 3))
        return replace(self, position_gain=p, velocity_gain=v, low_pass_hz=corner, notches=rest.reshape(-1, 3))

    def bounds(self, reach: float, rate_hz: float) -> tuple[FloatArray, FloatArray]:
        """Bounds of x, within `reach` of its own and with filters that can be."""
        x, n = self.vector, len(self.velocity_gain)
        low, high = x - reach, x + reach
        high[2 * n : 3 * n] = np.minimum(high[2 * n : 3 * n], np.log(CORNER * rate_hz))
        ends = np.log([[LOWEST * rate_hz, HIGHEST * rate_hz], WIDTHS, DEPTHS]).T
        low[3 * n :] = np.maximum(low[3 * n :].reshape(-1, 3), ends[0]).ravel()
        high[3 * n :] = np.minimum(high[3 * n :].reshape(-1, 3), ends[1]).ravel()
        return np.minimum(low, x), np.maximum(high, x)

    def slower(self, position: float, velocity: float) -> Cascade:
        """Cascade with position and velocity gains of all axes times factors; filters stay."""
        return replace(
            self, position_gain=position * self.position_gain, velocity_gain=velocity * self.velocity_gain
        )  # fmt: skip

    @property
    def gains(self) -> Gains:
        """Gains as a simulation takes them."""
        return Gains(self.position_gain * self.velocity_gain, self.velocity_gain, self.position_gain)

    def filters(self, rate_hz: float) -> Filters:
        """Notches, low pass and delay."""
        sections: list[list[FloatArray]] = [[] for _ in self.low_pass_hz]
        for axis, own in zip(self.axes, self.notches, strict=True):
            sections[axis].append(notch(own[0], own[1], own[2], rate_hz))
        for each, corner in zip(sections, self.low_pass_hz, strict=True):
            each.append(low_pass(corner, rate_hz))
        return Filters(tuple(tuple(tuple(part.tolist()) for part in each) for each in sections), self.delay)

    def response(self, freq_hz: FloatArray, rate_hz: float) -> ComplexArray:
        """F (..., n_u) at freq_hz (...)."""
        return controller_response(self.gains, self.filters(rate_hz), freq_hz, rate_hz)[0]

    def log_slopes(self, freq_hz: FloatArray, rate_hz: float) -> ComplexArray:
        """d ln F_i / dx (..., n_x), i the axis of each of x; axes answer independently."""
        n, x = len(self.velocity_gain), self.vector
        slopes = np.empty((*freq_hz.shape, len(x)), complex)
        for rows in (*np.arange(3 * n).reshape(3, n), *np.arange(3 * n, len(x))[:, None]):
            step = np.zeros(len(x))
            step[rows] = _STEP
            ahead, behind = (self.at(x + each).response(freq_hz, rate_hz) for each in (step, -step))
            slopes[..., rows] = np.log(ahead / behind)[..., self.owners[rows]] / (2 * _STEP)
        return slopes

    def on(self, scene: Scene) -> Closed:
        """The loops that it closes."""
        return scene.closed(self.gains, self.filters(scene.plants.rate_hz))

    def to_spec(self, joints: Sequence[str]) -> ControllerSpec:
        """Controller as a study has it, to six digits."""

        def rounded(values: FloatArray) -> tuple[float, ...]:
            return tuple(float(f"{value:.6g}") for value in values)

        pairs = zip(self.axes, self.notches, strict=True)
        notches = tuple(NotchSpec(joints[axis], *rounded(own)) for axis, own in pairs)
        parts = self.position_gain, self.velocity_gain, 1 / self.position_gain, self.low_pass_hz
        position, velocity, integral, corner = map(rounded, parts)
        gains = GainsSpec(position, velocity, integral, notches, corner)
        return ControllerSpec(kind="cascade", gains=gains, delay_samples=self.delay)
