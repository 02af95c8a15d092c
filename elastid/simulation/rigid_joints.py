r"""Rigid joints with sampled references and a continuous joint controller, simulated for many parameter sets at once.

.. math:: J \ddot q + f \dot q + F_c\, \mathrm{sgn}\, \dot q + g(q, t) = u(t - T_d) - k_p q - k_d \dot q, \quad
          g = o + G \cos q + H \sin q + m(t), \quad u_k = k_p r_k + k_d \dot r_k

u: command, constant or linear between samples. Each step uses the mean of the delayed command over the step, so that
delays of a fraction of a sample are exact. m: `load`, a cubic spline of its samples. A step of length h uses the
trapezoidal rule for the linear terms and is implicit in sgn, so that a joint sticks exactly if tau = c = 0:

.. math:: \dot q_+ = \dot q_0 - \mathrm{clip}\bigl((1 - c) (\dot q_0 - e^{-h / \tau} \dot q), \pm h F_c / a\bigr), \quad
          a\, \dot q_0 = b\, \dot q + h [\bar u - k_p q - g(q + h \dot q / 2)]

with a = J + h (f + k_d) / 2 + h^2 k_p / 4 and b = 2 J - a (Acary and Brogliato, Numerical Methods for Nonsmooth
Dynamical Systems, 2008, chapter 10). If friction is a soft constraint, as in MuJoCo, the velocity of a sticking joint
decays with the time constant tau / (1 - c), and a fraction c (creep) of its torque still accelerates it.

Below the Stribeck velocity nu_s, friction grows to the stiction F_s. F_c above is then F_c(q'), with q' at the start
of the step:

.. math:: F_c(\dot q) = F_c + (F_s - F_c)\, e^{-(\dot q / \nu_s)^2}

Before a real joint slides, it moves by bristles of compliance s and damping time T (LuGre model: Canudas de Wit et al.,
IEEE Trans. Automatic Control 40, 1995). w: torque of the springs of the bristles.

.. math:: s\, \dot w = \dot q - |\dot q|\, w / F_c(\dot q), \quad F = w + T \dot w

With implicit Euler for w, the velocity at the end of the step is a root of a quadratic; s = 0 sticks exactly.
"""

import math
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from elastid.base.arrays import FloatArray, frozen_value
from elastid.model.evaluation import evaluated

# Parameters of a joint, link side, in the order of the last axis of arrays: J, f, F_c, o, G, H, tau, c, s, T,
# F_s - F_c, nu_s.
PARAMETERS = (
    "inertia", "viscous", "coulomb", "offset", "gravity.cos", "gravity.sin", "stick_time", "creep",
    "bristle_compliance", "bristle_time", "excess_stiction", "stribeck_velocity"
)  # fmt: skip
# Limits: phase of the fastest mode in a step; steps in a sample; frequency of the bristles over the control loop's.
STEP_RAD, MAX_STEPS, MAX_BRISTLE_RATIO = 0.05, 64, 4.0
# Steps in one call of the compiled function. Building this function takes as long as some thousand steps.
BLOCK_STEPS = 500


@frozen_value
class CommandedJoints:
    """Commands of S joints over n samples of one clock at rate_hz; S counts each joint of each log.

    command (n, S): k_p r + k_d r' + feed-forward torque, Nm.  kp, kd (S,): gains, Nm/rad and Nms/rad.
    position, velocity (S,): at the first sample.  load (n, S): torque m of the rest of the robot in g.
    coupled_inertia (S,): inertia in addition to J, kg m^2; `load` excludes its torque.
    is_zoh: true if the command is constant between samples, false if it is linear between samples.
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

    def steps_per_sample(self, theta: FloatArray) -> int:
        """Return the number of steps in a sample that resolves the joints' dynamics; theta (..., S, 12)."""
        J, s = np.maximum(theta[..., 0] + self.coupled_inertia, 1e-9), theta[..., 8]
        loop = np.maximum(np.sqrt(self.kp / J), self.kd / (2 * J))
        bristles = np.where(s > 0, 1 / np.sqrt(np.maximum(s, 1e-12) * J), 0.0)  # s = 0: no bristles
        fastest = float(np.max(np.maximum(loop, np.minimum(bristles, MAX_BRISTLE_RATIO * loop))))
        return min(max(2, math.ceil(fastest / self.rate_hz / STEP_RAD)), MAX_STEPS)

    def simulate(self, theta: FloatArray, delay_s: FloatArray, steps: int, window: int = 1) -> FloatArray:
        """Simulate the positions (n // window, K, S) of K candidates, rad or m, averaged over windows of samples.

        theta (K, S, 12): parameters in the order of PARAMETERS.  delay_s (K,): T_d, s.  steps: in a sample. Compare
        candidates at the same number, because the discretisation error depends on it.  window: samples in a mean.
        """
        (n, S), K = self.command.shape, len(delay_s)
        theta = np.broadcast_to(theta, (K, S, len(PARAMETERS)))
        step, block = self._step_function(theta, 1 / self.rate_hz / steps), max(1, BLOCK_STEPS // steps)
        simulate_block, sums = step.mapaccum(block * steps), np.zeros((n // window, K, S))
        state = np.broadcast_to(np.stack([self.position, self.velocity])[:, None], (2, K, S))
        state = np.concatenate([state, self._initial_friction(theta)[None]])
        for first in range(0, len(sums) * window, block):
            torque = self._torque(first, first + block, steps, delay_s) - theta[..., 3]
            (states,) = evaluated(simulate_block, (state, torque), [(len(torque), *state.shape)])
            samples = np.arange(first, min(first + block, len(sums) * window))
            at_samples = np.concatenate([state[None, 0], states[steps - 1 :: steps, 0]])[: len(samples)]
            np.add.at(sums, samples // window, at_samples)
            state = states[-1]
        return sums / window

    def _initial_friction(self, theta: FloatArray) -> FloatArray:
        """Return the friction torque (K, S), at most the stiction, that balances all others at the first sample."""
        _, f, F_c, o, G, H, *_, excess, _ = np.moveaxis(theta, -1, 0)
        gravity = o + G * np.cos(self.position) + H * np.sin(self.position) + self.load[0]
        torque = self.command[0] - gravity - self.kp * self.position - (f + self.kd) * self.velocity
        return np.asarray(np.clip(torque, -F_c - excess, F_c + excess))

    def _step_function(self, theta: FloatArray, h: float) -> ca.Function:
        """Build the function that advances q, q', w (3 K S,) by h seconds under a torque (K S,)."""
        J, f, F_c, _, G, H, tau, creep, s, T, excess, nu_s = np.moveaxis(theta, -1, 0)
        J = np.maximum(J + self.coupled_inertia, 0.0)  # delayed feedback reduces the inertia
        a = J + h / 2 * (f + self.kd) + h * h / 4 * self.kp
        rows = [(2 * J - a) / a, h / a, h / a * self.kp, 1 - creep, np.exp(-h / np.maximum(tau, 1e-300)), G, H]
        b, gain, spring, stick_fraction, decay, G, H = (ca.DM(row.ravel()) for row in rows)
        x, v, w, torque = (ca.SX.sym(name, a.size) for name in ("x", "v", "w", "torque"))
        middle, friction = x + h / 2 * v, ca.SX(ca.DM(F_c.ravel()))
        if np.any(excess > 0):
            friction += ca.DM(excess.ravel()) * ca.exp(-((v / ca.DM(np.maximum(nu_s, 1e-12).ravel())) ** 2))
        free = b * v + gain * (torque - G * ca.cos(middle) - H * ca.sin(middle)) - spring * x
        v_next = free - ca.fmax(ca.fmin(stick_fraction * (free - decay * v), gain * friction), -gain * friction)
        w_next = w
        if np.any(s > 0):
            v_bristles, w_next = _step_bristles(free, w, h, friction, *(ca.DM(row.ravel()) for row in (a, s, T)))
            v_next = ca.if_else(ca.DM(s.ravel() > 0), v_bristles, v_next)
        next_state = ca.vertcat(x + h / 2 * (v + v_next), v_next, w_next)
        return ca.Function("step", [ca.vertcat(x, v, w), torque], [next_state])

    def _torque(self, first: int, last: int, steps: int, delay_s: FloatArray) -> FloatArray:
        """Return the mean delayed command minus the load (N, K, S) in each step from sample `first` to `last`."""
        instants = np.arange(first * steps, last * steps + 1) / steps
        integral = self._integrate(instants[:, None] / self.rate_hz - delay_s)
        load = self._load(np.minimum((instants[:-1] + instants[1:]) / 2, len(self.load) - 1))
        return np.asarray(np.diff(integral, axis=0) * steps * self.rate_hz - load[:, None])

    @cached_property
    def _load(self) -> CubicSpline:
        """Load (S,) as a function of the sample number: linear interpolation underestimates its peaks."""
        return CubicSpline(np.arange(len(self.load)), self.load)

    @cached_property
    def _integral(self) -> tuple[FloatArray, FloatArray]:
        """Integral of the command up to each sample and the end (n + 1, S); its quadratic part per sample (n, S)."""
        c, T, start = self.command, 1 / self.rate_hz, np.zeros((1, self.command.shape[1]))
        quadratic_part = np.zeros_like(c) if self.is_zoh else np.vstack([np.diff(c, axis=0), start]) * T / 2
        return np.vstack([start, np.cumsum(c * T + quadratic_part, axis=0)]), quadratic_part

    def _integrate(self, time_s: FloatArray) -> FloatArray:
        """Integrate the command (N, K, S) up to times (N, K); before the first sample, the command is constant."""
        integral, quadratic_part = self._integral
        sample = time_s * self.rate_hz
        k = np.clip(np.floor(sample).astype(int), 0, len(quadratic_part) - 1)
        fraction = (sample - k)[..., None]
        quadratic = np.where((fraction >= 0) & (fraction <= 1), fraction * (fraction - 1), 0.0) * quadratic_part[k]
        linear = np.where(fraction < 0, self.command[0] / self.rate_hz, integral[k + 1] - integral[k])
        return np.asarray(integral[k] + fraction * linear + quadratic)


def _step_bristles(
    free: ca.SX, w: ca.SX, h: float, F_c: ca.SX, a: ca.DM, s: ca.DM, T: ca.DM
) -> tuple[ca.SX, ca.SX]:  # fmt: skip
    """Return q' and w after a step of h seconds, where `free` is q' without friction."""
    T -= h / 2 * s / (s + h * h / a)  # w at the end of a step leads its mean by h / 2; no correction for s -> 0
    excess, direction = free - h / a * w, ca.sign(free - h / a * w)
    B = F_c * (s + h * (h + T) / a) - h * direction * (free + T / a * w)
    speed = (ca.sqrt(B * B + 4 * h * F_c * s * ca.fabs(excess)) - B) / (2 * h)
    v = direction * speed
    return v, F_c * (s * w + h * v) / ca.fmax(F_c * s + h * speed, 1e-300)
