r"""Rigid joints under sampled references through a continuous joint controller, many candidates at once.

.. math:: J \ddot q + f \dot q + F_c\, \mathrm{sgn}\, \dot q + o + G \cos q + H \sin q + \tau(t)
          = c(t - T_d) - k_p q - k_d \dot q, \qquad c_k = k_p r_k + k_d \dot r_k

c: the command, held from sample to sample or linear between samples, and T_d late; a fraction of a sample is exact,
since each step takes the mean of the command over it. tau: torque of the rest of the robot, linear between samples. A
step is the trapezoidal rule in the linear part and implicit in sgn, so that a joint sticks exactly:

.. math:: \dot q_+ = \dot q_0 - \mathrm{clip}\bigl((1 - c) (\dot q_0 - e^{-h / \tau} \dot q), \pm h F_c / a\bigr), \quad
          a\, \dot q_0 = b\, \dot q + h [\bar c - k_p q - g(q + h \dot q / 2)]

with a = J + h (f + k_d) / 2 + h^2 k_p / 4, b = 2 J - a, and tau = c = 0 (Acary and Brogliato, Numerical Methods for
Nonsmooth Dynamical Systems, 2008, chapter 10). Where friction is a soft constraint, as in MuJoCo, the velocity of a
sticking joint decays with a time constant tau, and a fraction c of the torque on it still accelerates it.
"""

import math
from functools import cached_property

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.model.evaluation import evaluated

# Numbers of a joint, in the order of their axis, link side: J, f, F_c, o, G, H, tau, c.
NUMBERS = ("inertia", "viscous", "coulomb", "offset", "gravity.cos", "gravity.sin", "stick_time", "creep")
# Radians of the loop's natural motion in a step, and the most steps in a sample.
STEP_RAD, MAX_STEPS = 0.05, 64
# Steps that one call simulates; to build a call takes as long as to simulate some thousand.
BLOCK = 500


@frozen_value
class CommandedJoints:
    """Commands of S joints over n samples, all from one clock at rate_hz; a joint of each of several logs is one of S.

    command (n, S): k_p r + k_d r' + feed-forward torque, Nm.  kp, kd (S,): gains, Nm/rad and Nms/rad.
    position, velocity (S,): at the first sample.  load (n, S): torque of the rest of the robot against the motion.
    coupled_inertia (S,): inertia beside J, the torque of which is not in `load`.
    is_zoh: true if the command is held from sample to sample, false if it is linear between samples.
    """

    rate_hz: float
    command: FloatArray
    kp: FloatArray
    kd: FloatArray
    position: FloatArray
    velocity: FloatArray
    load: FloatArray
    coupled_inertia: FloatArray
    is_zoh: bool = True

    def steps(self, inertia: FloatArray) -> int:
        """Return integration steps in a sample that resolve the loops of joints with inertia (..., S), kg m^2."""
        J = np.maximum(inertia, 1e-9)
        fastest = float(np.max(np.maximum(np.sqrt(self.kp / J), self.kd / (2 * J))))
        return min(max(2, math.ceil(fastest / self.rate_hz / STEP_RAD)), MAX_STEPS)

    def simulate(self, numbers: FloatArray, delay_s: FloatArray, window: int = 1) -> FloatArray:
        """Simulate positions (n // window, K, S) of K candidates, means over windows of samples.

        numbers (K, S, 8): as NUMBERS.  delay_s (K,): T_d, from 0.
        """
        (n, S), K = self.command.shape, len(delay_s)
        numbers = np.broadcast_to(numbers, (K, S, len(NUMBERS)))
        steps = self.steps(np.maximum(numbers[..., 0] + self.coupled_inertia, 0.0))
        step, block = self._step(numbers, 1 / self.rate_hz / steps), max(1, BLOCK // steps)
        march, sums = step.mapaccum(block * steps), np.zeros((n // window, K, S))
        state = np.broadcast_to(np.stack([self.position, self.velocity])[:, None], (2, K, S))
        for first in range(0, len(sums) * window, block):
            torque = self._torque(first, first + block, steps, delay_s) - numbers[..., 3]
            (states,) = evaluated(march, (state, torque), [(len(torque), *state.shape)])
            samples = np.arange(first, min(first + block, len(sums) * window))
            at_samples = np.concatenate([state[None, 0], states[steps - 1 :: steps, 0]])[: len(samples)]
            np.add.at(sums, samples // window, at_samples)
            state = states[-1]
        return sums / window

    def _step(self, numbers: FloatArray, h: float) -> ca.Function:
        """Return step by h of positions and velocities (2 K S,) under a torque (K S,)."""
        J, f, F_c, _, G, H, tau, creep = np.moveaxis(numbers, -1, 0)
        J = np.maximum(J + self.coupled_inertia, 0.0)  # late feedback takes some off
        a = J + h / 2 * (f + self.kd) + h * h / 4 * self.kp
        rows = [(2 * J - a) / a, h / a, h / a * self.kp, h * F_c / a, 1 - creep, np.exp(-h / np.maximum(tau, 1e-300))]
        b, gain, spring, threshold, grip, decay, G, H = (ca.DM(row.ravel()) for row in (*rows, G, H))
        x, v, torque = (ca.SX.sym(name, a.size) for name in ("x", "v", "torque"))
        middle = x + h / 2 * v
        free = b * v + gain * (torque - G * ca.cos(middle) - H * ca.sin(middle)) - spring * x
        v_next = free - ca.fmax(ca.fmin(grip * (free - decay * v), threshold), -threshold)
        after = ca.vertcat(x + h / 2 * (v + v_next), v_next)
        return ca.Function("step", [ca.vertcat(x, v), torque], [after])

    def _torque(self, first: int, last: int, steps: int, delay_s: FloatArray) -> FloatArray:
        """Return mean of late command less load (N, K, S) in each step of the samples first to last."""
        fine = np.arange(first * steps, last * steps + 1) / steps
        late = self._integrate(fine[:, None] / self.rate_hz - delay_s)
        middle, samples = (fine[:-1] + fine[1:]) / 2, np.arange(len(self.load))
        load = np.stack([np.interp(middle, samples, column) for column in self.load.T], axis=1)
        return np.asarray(np.diff(late, axis=0) * steps * self.rate_hz - load[:, None])

    @cached_property
    def _integral(self) -> tuple[FloatArray, FloatArray]:
        """Integral of the command up to each sample and the end (n + 1, S), and its quadratic part in each (n, S)."""
        c, T, start = self.command, 1 / self.rate_hz, np.zeros((1, self.command.shape[1]))
        growth = np.zeros_like(c) if self.is_zoh else np.vstack([np.diff(c, axis=0), start]) * T / 2
        return np.vstack([start, np.cumsum(c * T + growth, axis=0)]), growth

    def _integrate(self, time_s: FloatArray) -> FloatArray:
        """Integrate the command (N, K, S) up to times (N, K) from the first sample on; before it the first holds."""
        integral, growth = self._integral
        sample = time_s * self.rate_hz
        k = np.clip(np.floor(sample).astype(int), 0, len(growth) - 1)
        fraction = (sample - k)[..., None]
        bend = np.where((fraction >= 0) & (fraction <= 1), fraction * (fraction - 1), 0.0) * growth[k]
        straight = np.where(fraction < 0, self.command[0] / self.rate_hz, integral[k + 1] - integral[k])
        return np.asarray(integral[k] + fraction * straight + bend)
