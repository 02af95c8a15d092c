r"""Encoders, drives and gears between controller and robot: counts, lag, limits, ripple, transmission error.

.. math:: y = \mathrm{count}(q_m + w), \qquad
          \tau = G_\tau(s)\, \mathrm{clip}(u) + \textstyle\sum b \sin(N q_m + \phi)

All on the link side: N periods per radian of q_m, the motor's angle over its ratio.

Forces of gears besides their springs and dry friction: transmission error, ripple, friction by load.

.. math:: x = z^T q + e(\theta), \qquad \tau = n(x) + d\, \dot x, \qquad
          F = z\, [\tau - n(z^T q) - d\, z^T \dot q]
              + m\, [\tau\, e' + F_{load} |\tau|\, \mathrm{sgn}(m^T \dot q) + ripple(\theta)]

z: deflection of a gear's spring, m: angle of its motor on the link side, as rows in the coordinates; theta the motor's
own angle, n the spring. F brakes, as friction does: it stands on the left of the equations of motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import expm

from elastid.base.arrays import FloatArray, frozen_value
from elastid.friction.static import SLIDING_VELOCITY
from elastid.model.drivetrain import spring_deflections, spring_torque
from elastid.model.elastic import ElasticModel
from elastid.robot import GearRipple, TransmissionError


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
        """Discretise: w(t + step) = A w(t) + b u, w = torque and its derivatives times powers of T; A (n, n)."""
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
    torque_ripple: tuple[Ripple, ...] = ()
    lag: Lag | None = None

    @property
    def n_states(self) -> int:
        """Number of states of the torque loops of all motors."""
        return 0 if self.lag is None else len(self.lag.coefficients) * len(self.torque)

    def start(self, torque: FloatArray) -> FloatArray:
        """Return states of the torque loops at constant torque (n_u,)."""
        return np.concatenate([torque, np.zeros(self.n_states - len(torque))]) if self.n_states else np.zeros(0)

    def reading(self, angle: ca.SX, noise: ca.SX) -> ca.SX:
        """Return readings of the encoders (n_u,) at motor angles (n_u,), in whole counts."""
        angles = angle + noise
        widths = enumerate(self.resolution.tolist())
        return ca.vertcat(
            *(width * ca.floor(angles[i] / width + 0.5) if width > 0 else angles[i] for i, width in widths)
        )

    def clipped(self, u: ca.SX) -> ca.SX:
        """Return the command (n_u,) within the torque limits of the drives."""
        result = ca.SX(u)
        for i in np.flatnonzero(np.isfinite(self.torque)).tolist():
            result[i] = ca.fmax(-self.torque[i], ca.fmin(self.torque[i], u[i]))
        return result

    def lagged(self, w: ca.SX, u: ca.SX, step: float) -> tuple[ca.SX, ca.SX]:
        """Return torque (n_u,) and states after `step` s of the command u (n_u,), from the states w (n_states,)."""
        if self.lag is None:
            return u, w
        A, b = self.lag.step(step)
        new_states = ca.reshape(w, u.numel(), len(self.lag.coefficients)) @ ca.DM(A.T) + u @ ca.DM(b[None])
        return new_states[:, 0], ca.vec(new_states)

    def on_motors(self, torque: ca.SX, angle: ca.SX) -> ca.SX:
        """Return torque (n_u,) with its ripple at motor angles (n_u,)."""
        for ripple in self.torque_ripple:
            torque = torque + ca.DM(ripple.amplitude) * ca.sin(ca.DM(ripple.periods) * angle + ca.DM(ripple.phase))
        return torque


def gear_forces(model: ElasticModel, q: ca.SX, v: ca.SX, numbers: ca.SX | None = None) -> ca.SX:
    """Return F (n_q,) at q, v (n_q,).  numbers (n_theta,): symbols of the parameters; the model's own by default."""
    robot, force = model.robot, ca.SX(model.n_q, 1)
    theta = dict(zip(model.parameters, model.theta.tolist() if numbers is None else ca.vertsplit(numbers), strict=True))
    shafts = dict(zip(robot.driven_names, robot.mixing @ model.B.T, strict=True))
    springs = spring_deflections(robot)
    for joint in robot.driven:
        if joint.gear is None or joint.spring is None:
            continue
        z, m = ca.sparsify(ca.DM(springs[f"k_{joint.name}"])), ca.sparsify(ca.DM(shafts[joint.name]))
        ratio, d = robot.ratio(joint.name), theta[f"d_{joint.name}"]
        e, slope = _harmonics(joint.gear.transmission_error, ratio * (m.T @ q))
        ripple, _ = _harmonics(joint.gear.ripple, ratio * (m.T @ q))
        slope = ratio * slope
        linear = spring_torque(joint.name, z.T @ q, theta) + d * (z.T @ v)
        tau = spring_torque(joint.name, z.T @ q + e, theta) + d * (z.T @ v + slope * (m.T @ v))
        braking = joint.gear.load * ca.fabs(tau) * ca.tanh(m.T @ v / SLIDING_VELOCITY)
        force += z * (tau - linear) + m * (tau * slope + braking + ripple)
    return force


def _harmonics(terms: Sequence[TransmissionError | GearRipple], angle: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the sum of A sin(order angle + phase), and its derivative."""
    value, slope = ca.SX(0), ca.SX(0)
    for term in terms:
        value += term.amplitude * ca.sin(term.order * angle + term.phase)
        slope += term.amplitude * term.order * ca.cos(term.order * angle + term.phase)
    return value, slope
