r"""Encoders and drives between controller and robot: counts and ripple of the one, lag, limit and ripple of the other.

.. math:: y = \mathrm{count}(q_m + \textstyle\sum a \sin(N q_m + \phi) + w), \qquad
          \tau = G_\tau(s)\, \mathrm{clip}(u) + \textstyle\sum b \sin(N q_m + \phi)

All on the link side: N periods per radian of q_m, the motor's angle over its ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import expm

from elastid.base.arrays import FloatArray, frozen_value


@frozen_value(eq=False)
class Ripple:
    """amplitude (n_u,) in rad or Nm, periods (n_u,) per radian times 2 pi, phase (n_u,): a sin(periods q + phase)."""

    amplitude: FloatArray
    periods: FloatArray
    phase: FloatArray


@dataclass(frozen=True)
class Lag:
    """G(s) = 1 / P(s T) of every motor, P = 1 + p_1 x + p_2 x^2 ... by its coefficients (p_1, p_2 ...), T in s."""

    coefficients: tuple[float, ...]
    time_constant: float

    def step(self, step: float) -> tuple[FloatArray, FloatArray]:
        """w(t + step) = A w(t) + b u at constant u, w = the torque and its derivatives times powers of T; A (n, n)."""
        n = len(self.coefficients)  # states of a motor
        A = np.eye(n, k=1)
        A[-1] = -np.array([1.0, *self.coefficients[:-1]]) / self.coefficients[-1]
        b = np.zeros(n)
        b[-1] = 1 / self.coefficients[-1]
        transition = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * (step / self.time_constant))
        return transition[:n, :n], transition[:n, n]


@frozen_value(eq=False)
class Drives:
    """resolution (n_u,): rad per count, 0 for unlimited.  torque (n_u,): Nm at which a drive clips, or infinity."""

    resolution: FloatArray
    torque: FloatArray
    encoder_ripple: tuple[Ripple, ...] = ()
    torque_ripple: tuple[Ripple, ...] = ()
    lag: Lag | None = None

    @property
    def n_states(self) -> int:
        """Number of states of the torque loops of all motors."""
        return 0 if self.lag is None else len(self.lag.coefficients) * len(self.torque)

    def start(self, torque: FloatArray) -> FloatArray:
        """States of the torque loops at constant torque (n_u,)."""
        return np.concatenate([torque, np.zeros(self.n_states - len(torque))]) if self.n_states else np.zeros(0)

    def reading(self, angle: ca.SX, noise: ca.SX) -> ca.SX:
        """Readings of the encoders (n_u,) at motor angles (n_u,), in whole counts."""
        read = _summed(self.encoder_ripple, angle, angle + noise)
        widths = enumerate(self.resolution.tolist())
        return ca.vertcat(*(width * ca.floor(read[i] / width + 0.5) if width > 0 else read[i] for i, width in widths))

    def clipped(self, u: ca.SX) -> ca.SX:
        """The command (n_u,) within the torque limits of the drives."""
        taken = ca.SX(u)
        for i in np.flatnonzero(np.isfinite(self.torque)).tolist():
            taken[i] = ca.fmax(-self.torque[i], ca.fmin(self.torque[i], u[i]))
        return taken

    def lagged(self, w: ca.SX, u: ca.SX, step: float) -> tuple[ca.SX, ca.SX]:
        """Torque (n_u,) and states after `step` s of the command u (n_u,), from the states w (n_states,)."""
        if self.lag is None:
            return u, w
        A, b = self.lag.step(step)
        n_u = u.numel()
        after = ca.reshape(w, n_u, len(self.lag.coefficients)) @ ca.DM(A.T) + u @ ca.DM(b[None])
        return after[:, 0], ca.vec(after)

    def on_motors(self, torque: ca.SX, angle: ca.SX) -> ca.SX:
        """Torque (n_u,) with its ripple at motor angles (n_u,)."""
        return _summed(self.torque_ripple, angle, torque)


def _summed(ripples: Sequence[Ripple], angle: ca.SX, value: ca.SX) -> ca.SX:
    for ripple in ripples:
        value = value + ca.DM(ripple.amplitude) * ca.sin(ca.DM(ripple.periods) * angle + ca.DM(ripple.phase))
    return value
