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
from collections.abc import Callable
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from elastid.base.arrays import FloatArray, IntArray, frozen_value
from elastid.base.kernels import call, is_compiled
from elastid.model.evaluation import evaluated

# Parameters of a joint, link side, in the order of the last axis of arrays: J, f, F_c, o, G, H, tau, c, s, T,
# F_s - F_c, nu_s.
PARAMETERS = (
    "inertia", "viscous", "coulomb", "offset", "gravity.cos", "gravity.sin", "stick_time", "creep",
    "bristle_compliance", "bristle_time", "excess_stiction", "stribeck_velocity"
)  # fmt: skip
# Limits: phase of the fastest mode in a step; steps in a sample; frequency of the bristles over the control loop's.
STEP_RAD, MAX_STEPS, MAX_BRISTLE_RATIO = 0.05, 64, 4.0
BLOCK_STEPS = 2000  # in one call of the compiled function


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
        block = max(1, BLOCK_STEPS // steps)
        advance = self._advance(theta, steps, block)
        delays, candidates = np.unique(delay_s, return_inverse=True)
        sums = np.zeros((n // window, K, S))
        state = np.broadcast_to(np.stack([self.position, self.velocity])[:, None], (2, K, S))
        state = np.concatenate([state, self._initial_friction(theta)[None]])
        for first in range(0, len(sums) * window, block):
            positions, state = advance(state, self._torque(first, first + block, steps, delays), candidates)
            samples = np.arange(first, min(first + block, len(sums) * window))
            np.add.at(sums, samples // window, positions[: len(samples)])
        return sums / window

    def _initial_friction(self, theta: FloatArray) -> FloatArray:
        """Return the friction torque (K, S), at most the stiction, that balances all others at the first sample."""
        _, f, F_c, o, G, H, *_, excess, _ = np.moveaxis(theta, -1, 0)
        gravity = o + G * np.cos(self.position) + H * np.sin(self.position) + self.load[0]
        torque = self.command[0] - gravity - self.kp * self.position - (f + self.kd) * self.velocity
        return np.asarray(np.clip(torque, -F_c - excess, F_c + excess))

    def _coefficients(self, theta: FloatArray, h: float) -> FloatArray:
        """Return the coefficients (14, K S) of steps of h seconds.

        Their order: b / a, h / a, h k_p / a, 1 - c, exp(-h / tau), o, G, H, F_c, F_s - F_c, nu_s, s, T, T / a.
        """
        J, f, F_c, o, G, H, tau, creep, s, T, excess, nu_s = np.moveaxis(theta, -1, 0)
        J = np.maximum(J + self.coupled_inertia, 0.0)  # delayed feedback reduces the inertia
        a = J + h / 2 * (f + self.kd) + h * h / 4 * self.kp
        T = T - h / 2 * s / (s + h * h / a)  # w at the end of a step leads its mean by h / 2; no correction for s -> 0
        rows = [(2 * J - a) / a, h / a, h / a * self.kp, 1 - creep, np.exp(-h / np.maximum(tau, 1e-300)), o, G, H]
        rows += [F_c, excess, np.maximum(nu_s, 1e-12), s, T, T / a]
        return np.stack(rows).reshape(len(rows), -1)

    def _advance(self, theta: FloatArray, steps: int, block: int) -> Callable[..., tuple[FloatArray, FloatArray]]:
        """Return the function that advances the state (3, K, S) by a block of samples under torques (N, D, S).

        It returns the positions (block, K, S) at the start of each sample, and the last state. N: number of steps in
        the block. D: number of delays.  Its last argument (K,) is the index of the delay of each candidate.
        """
        h = 1 / self.rate_hz / steps
        rows = self._coefficients(theta, h)
        by_casadi = None if is_compiled() else _step_function(rows, h).mapaccum(block * steps)

        def advance(state: FloatArray, torque: FloatArray, candidates: IntArray) -> tuple[FloatArray, FloatArray]:
            if by_casadi is None:
                positions, state = np.empty((block, *state.shape[1:])), state.copy()
                columns = candidates[:, None] * torque.shape[2] + np.arange(torque.shape[2])
                sizes = columns.size, block, steps, torque[0].size
                call("rigid_joints", *sizes, np.array([h]), rows, columns, torque, state, positions)
                return positions, state
            (states,) = evaluated(by_casadi, (state, torque[:, candidates]), [(len(torque), *state.shape)])
            return np.concatenate([state[None, 0], states[steps - 1 : -1 : steps, 0]]), states[-1]

        return advance

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


def _step_function(rows: FloatArray, h: float) -> ca.Function:
    """Build the function that advances q, q', w (3 K S,) by h seconds under a torque (K S,), without a C compiler."""
    b, gain, spring, stick_fraction, decay, o, G, H, F_c, excess, nu_s, s, T, T_gain = map(ca.DM, rows)
    x, v, w, torque = (ca.SX.sym(name, rows.shape[1]) for name in ("x", "v", "w", "torque"))
    middle, friction = x + h / 2 * v, F_c + excess * ca.exp(-((v / nu_s) ** 2))
    free = b * v + gain * (torque - o - G * ca.cos(middle) - H * ca.sin(middle)) - spring * x
    v_rigid = free - ca.fmax(ca.fmin(stick_fraction * (free - decay * v), gain * friction), -gain * friction)
    slip, direction = free - gain * w, ca.sign(free - gain * w)
    B = friction * (s + gain * (h + T)) - h * direction * (free + T_gain * w)
    speed = (ca.sqrt(B * B + 4 * h * friction * s * ca.fabs(slip)) - B) / (2 * h)
    w_bristles = friction * (s * w + h * direction * speed) / ca.fmax(friction * s + h * speed, 1e-300)
    v_next, w_next = ca.if_else(s > 0, direction * speed, v_rigid), ca.if_else(s > 0, w_bristles, w)
    return ca.Function("step", [ca.vertcat(x, v, w), torque], [ca.vertcat(x + h / 2 * (v + v_next), v_next, w_next)])
