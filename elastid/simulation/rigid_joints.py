r"""Rigid joints under sampled references through a continuous joint controller, many candidates at once.

.. math:: J \ddot q + f \dot q + F_c\, \mathrm{sgn}\, \dot q + o + G \cos q + H \sin q + \tau(t)
          = c(t - T_d) - k_p q - k_d \dot q, \qquad c_k = k_p r_k + k_d \dot r_k

c: the command, held from sample to sample or linear between samples, and T_d late; a fraction of a sample is exact,
since each step takes the mean of the command over it. tau: torque of the rest of the robot, linear between samples. A
step is the trapezoidal rule in the linear part and implicit in sgn (soft threshold), so that a joint sticks exactly:

.. math:: a\, \dot q_+ = S\bigl(b\, \dot q + h [\bar c - k_p q - g(q + h \dot q / 2)],\; h F_c\bigr), \quad
          a = J + \tfrac{h}{2} (f + k_d) + \tfrac{h^2}{4} k_p, \quad b = 2 J - a

(Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008, chapter 10.)
"""

import math

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value

# Numbers of a joint, in the order of their axis, link side: J, f, F_c, o, G, H.
NUMBERS = ("inertia", "viscous", "coulomb", "offset", "gravity.cos", "gravity.sin")
# Radians of the loop's natural motion in a step, and the most steps in a sample.
STEP_RAD, MAX_STEPS = 0.05, 64


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

        numbers (K, S, 6): as NUMBERS.  delay_s (K,): T_d, from 0.
        """
        (n, S), K, T = self.command.shape, len(delay_s), 1 / self.rate_hz
        J, f, F_c, o, G, H = np.moveaxis(np.broadcast_to(numbers, (K, S, len(NUMBERS))), -1, 0)
        J = np.maximum(J + self.coupled_inertia, 0.0)  # late feedback takes some off
        steps = self.steps(J)
        h = T / steps
        a = J + h / 2 * (f + self.kd) + h * h / 4 * self.kp
        b, gain, threshold = (2 * J - a) / a, h / a, h * F_c / a
        spring = gain * self.kp
        has_gravity = bool(np.any(G) or np.any(H))
        slope = np.vstack([self.load[1:] - self.load[:-1], np.zeros((1, S))])
        x, v = (np.array(np.broadcast_to(start, (K, S))) for start in (self.position, self.velocity))
        means, total = np.empty((n // window, K, S)), np.zeros((K, S))
        integral, growth = self._integral
        before = self._integrate(integral, growth, -delay_s)
        for k in range(n // window * window):
            total += x
            for i in range(steps):
                after = self._integrate(integral, growth, k * T + (i + 1) * h - delay_s)
                torque = (after - before) / h - o - self.load[k] - (i + 0.5) / steps * slope[k]
                before = after
                if has_gravity:
                    middle = x + h / 2 * v
                    torque -= G * np.cos(middle) + H * np.sin(middle)
                free = b * v + gain * torque - spring * x
                v_next = free - np.clip(free, -threshold, threshold)
                x = x + h / 2 * (v + v_next)
                v = v_next
            if (k + 1) % window == 0:
                means[k // window], total = total / window, np.zeros((K, S))
        return means

    @property
    def _integral(self) -> tuple[FloatArray, FloatArray]:
        """Integral of the command up to each sample and the end (n + 1, S), and its quadratic part in each (n, S)."""
        c, T, start = self.command, 1 / self.rate_hz, np.zeros((1, self.command.shape[1]))
        growth = np.zeros_like(c) if self.is_zoh else np.vstack([np.diff(c, axis=0), start]) * T / 2
        return np.vstack([start, np.cumsum(c * T + growth, axis=0)]), growth

    def _integrate(self, integral: FloatArray, growth: FloatArray, time_s: FloatArray) -> FloatArray:
        """Integrate the command (K, S) up to times (K,) from the first sample on; before it the first holds."""
        sample = time_s * self.rate_hz
        k = np.clip(np.floor(sample).astype(int), 0, len(growth) - 1)
        fraction = (sample - k)[:, None]
        bend = np.where((fraction >= 0) & (fraction <= 1), fraction * (fraction - 1), 0.0) * growth[k]
        straight = np.where(fraction < 0, self.command[0] / self.rate_hz, integral[k + 1] - integral[k])
        return np.asarray(integral[k] + fraction * straight + bend)
