r"""Extended Kalman filter of a joint with LuGre friction whose numbers drift, over its motions one after the other.

.. math:: J_m \ddot q_m + f \dot q_m + \tau_f(\dot q_m, z) + k (q_m - q_l) + d (\dot q_m - \dot q_l) = u + w, \qquad
          J_l \ddot q_l + g + b = k (q_m - q_l) + d (\dot q_m - \dot q_l)

on one side of the gear: LuGre bristle state z, gravity torque g of the model, its slowly varying error b, and coloured
torque noise w (ripple, cogging, cables; if w were modelled as white, the bands would be far too narrow). The tracked
parameters are random walks: ln F_c, with F_s / F_c and sigma_0 fixed; ln f, or one value for each direction; b.
A sample of the filter is a CasADi function,

.. math::
   x^- = a(x, u, g), \quad P^- = F P F^T + Q, \qquad
   K = P^- h / S, \quad S = h^T P^- h + R, \quad e = y - h^T x^-, \\
   x^+ = x^- + K e, \qquad P^+ = (I - K h^T) P^- (I - K h^T)^T + K R K^T \text{ (Joseph)},

F: Jacobian of a; h: gradient of the measured angle. The fixed parameters c (F_s / F_c, Stribeck velocity, inertia,
stiffness, gravity) are wrong by some percent, which the bands include: c are consider parameters (Schmidt, Advances in
Control Systems 3, 1966), never updated, with cross covariance Sigma divided by their standard deviations sigma,

.. math::
   \Sigma^- = F \Sigma + \frac{\partial a}{\partial c} \mathrm{diag}(\sigma), \qquad
   P^- = F (P - \Sigma \Sigma^T) F^T + \Sigma^- \Sigma^{-T} + Q, \qquad \Sigma^+ = (I - K h^T) \Sigma^-

The gain does not depend on c (K and S use P without the contribution of c): a gain with this contribution would lag.
Q contains the torque noise (through the Jacobian of the step), the drift of the tracked parameters, and the slip of the
bristle, (slip z_s)^2 l e^-l, l = |v| T_s / z_s, z_s = F_c / sigma_0. In creep the bristle state is uncertain; after
sliding by more than z_s in one sample it is at its limit.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.friction.dynamic import Bristle
from elastid.friction.static import Curve
from elastid.friction_study.spec import Followed
from elastid.model.evaluation import evaluated
from elastid.simulation.closed_loop import compile_function
from elastid.simulation.runge_kutta import runge_kutta_step

# Default relative std of the fixed parameters; F_s / F_c falls by a tenth while a gear warms up.
TOLERANCES: Mapping[str, float] = {
    "stiction_ratio": 0.08, "stribeck_velocity": 0.3, "inertia": 0.02, "stiffness": 0.05, "gravity": 0.1
}  # fmt: skip


@dataclass(frozen=True)
class TrackedJoint:
    """Inertias, spring, damper, and initial friction of a joint with a filter; all on one side of the gear, SI.

    link_inertia, stiffness, damping: 0 for a rigid joint, whose whole inertia is motor_inertia.  stiction_ratio:
    F_s / F_c.  bristle_stiffness, bristle_damping: sigma_0, sigma_1.  followed: the tracked parameters.
    correlation_s: time constant of the torque noise w, 0 for none.  tolerances: relative std of the fixed parameters,
    by the names of TOLERANCES; missing or 0 for exact ones.
    """

    motor_inertia: float
    coulomb: float
    viscous: float
    bristle_stiffness: float
    followed: tuple[Followed, ...] = ("Fc", "f", "offset")
    link_inertia: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    stiction_ratio: float = 1.0
    stribeck_velocity: float = 0.0
    bristle_damping: float = 0.0
    correlation_s: float = 0.0
    tolerances: Mapping[str, float] = field(default_factory=lambda: TOLERANCES)

    @property
    def states(self) -> tuple[str, ...]:
        """The names of the states x, in order: angles, velocities, bristle, correlated noise, followed numbers."""
        mechanical = ("q_m", "q_l", "v_m", "v_l", "z") if self.stiffness > 0 else ("q_m", "v_m", "z")
        return (*mechanical, *(("w",) if self.correlation_s > 0 else ()), *self.followed)

    @property
    def consider_parameters(self) -> tuple[str, ...]:
        """The fixed parameters with a tolerance, in order (Schmidt's consider parameters)."""
        is_modelled = dict.fromkeys(("stiction_ratio", "stribeck_velocity"), self.stribeck_velocity > 0)
        is_modelled["stiffness"] = self.stiffness > 0
        return tuple(name for name in TOLERANCES if self.tolerances.get(name, 0.0) > 0 and is_modelled.get(name, True))

    def step(self, rate_hz: float) -> ca.Function:
        """Return (x (n,), c (m,), u, g) -> x (n,) a sample later: a Runge-Kutta step and the bristle's exact update.

        u, g: torques, constant over the sample.  c: relative errors of the consider parameters.
        """
        names = self.states
        x, u, g = ca.SX.sym("x", len(names)), ca.SX.sym("u"), ca.SX.sym("g")
        c = ca.SX.sym("c", len(self.consider_parameters))
        factor = dict.fromkeys(TOLERANCES, ca.SX(1.0))
        factor |= {name: 1 + c[i] for i, name in enumerate(self.consider_parameters)}
        state = dict(zip(names, ca.vertsplit(x), strict=True))
        n_q = 2 if self.stiffness > 0 else 1
        coulomb = ca.exp(state["Fc"]) if "Fc" in state else self.coulomb
        inverse = 1 / (self.stribeck_velocity * factor["stribeck_velocity"]) if self.stribeck_velocity > 0 else 0.0
        curve = Curve(coulomb, self.stiction_ratio * factor["stiction_ratio"] * coulomb, inverse)
        law = Bristle(self.bristle_stiffness, self.bristle_damping)
        noise, inertia = state.get("w", 0.0), factor["inertia"]
        viscous_names = ("f", "f") if "f" in state else ("f+", "f-")
        forwards, backwards = (ca.exp(state[name]) if name in state else self.viscous for name in viscous_names)

        def acceleration(q: ca.SX, v: ca.SX, z: ca.SX, torque: ca.SX) -> ca.SX:
            viscous = forwards * ca.fmax(v[0], 0) + backwards * ca.fmin(v[0], 0)
            motor = torque + noise - law.torque(v[0], z, curve) - viscous
            load = g * factor["gravity"] + state.get("offset", 0.0)
            if not self.stiffness > 0:
                return (motor - load) / (self.motor_inertia * inertia)
            spring = self.stiffness * factor["stiffness"] * (q[0] - q[1]) + self.damping * (v[0] - v[1])
            inertias = ca.vertcat(self.motor_inertia, self.link_inertia) * inertia
            return ca.vertcat(motor - spring, spring - load) / inertias

        def advanced(z: ca.SX, v: ca.SX, step: float) -> ca.SX:
            return law.advanced(v[0], z, curve, step)

        angles, rates = x[:n_q], x[n_q : 2 * n_q]
        q, v, z = runge_kutta_step(acceleration, advanced, angles, rates, state["z"], [u] * 4, 1 / rate_hz)
        decayed_noise = [state["w"] * math.exp(-1 / (rate_hz * self.correlation_s))] if "w" in state else []
        following = ca.vertcat(q, v, z, *decayed_noise, *(state[name] for name in self.followed))
        return ca.Function("step", [x, c, u, g], [following], ["x", "c", "u", "g"], ["next"])


@dataclass(frozen=True)
class FilterNoise:
    """Standard deviations of the noise and drift of a filter, one side of the gear, SI.

    angle: of a sample of the motor's angle; encoder counts have count / sqrt(12).  torque: white, of a sample.
    correlated_torque: of w.  drift: of the tracked parameters per root second; relative for logarithmic ones.
    slip: of the bristle in z_s = F_c / sigma_0, for each z_s of slip, as a random walk: without this noise F_c is wrong
    after every stop.
    """

    angle: float
    torque: float
    correlated_torque: float = 0.0
    drift: Mapping[str, float] = field(default_factory=dict)
    slip: float = 0.1

    def vector(self, joint: TrackedJoint, rate_hz: float) -> FloatArray:
        """Return the arguments (4 + n_followed,) of a filter's step: variances of a sample."""
        fade = math.exp(-2 / (rate_hz * joint.correlation_s)) if joint.correlation_s > 0 else 1.0
        drift = [self.drift.get(name, 0.0) ** 2 / rate_hz for name in joint.followed]
        return np.array([self.angle**2, self.torque**2, self.correlated_torque**2 * (1 - fade), self.slip**2, *drift])


def filter_step(joint: TrackedJoint, rate_hz: float) -> ca.Function:
    """Return (x (n,), P (n, n + m), u, g, y, noise (4 + n_followed,)) -> (x, P, innovation e, its variance S).

    P: covariance of the states, then their cross covariance with the m consider parameters, divided by their stds.
    u, g: motor and load torque since the previous sample.  y: present angle.  noise: FilterNoise.vector.
    """
    n, m = len(joint.states), len(joint.consider_parameters)
    x, P, c = ca.SX.sym("x", n), ca.SX.sym("P", n, n + m), ca.SX.sym("c", m)
    u, g, y = ca.SX.sym("u"), ca.SX.sym("g"), ca.SX.sym("y")
    noise = ca.SX.sym("noise", 4 + len(joint.followed))
    next_state = joint.step(rate_hz)(x, c, u, g)
    predicted, slope_by_force = ca.substitute([next_state, ca.jacobian(next_state, c)], [c], [ca.SX.zeros(m)])
    F = ca.jacobian(predicted, x)
    std = ca.DM([joint.tolerances[name] for name in joint.consider_parameters])
    propagated, sensitivity = F @ P[:, n:], slope_by_force @ ca.diag(std)
    cross, cross_term = propagated + sensitivity, propagated @ sensitivity.T
    spread = F @ P[:, :n] @ F.T + cross_term + cross_term.T + sensitivity @ sensitivity.T
    state, by_u = dict(zip(joint.states, ca.vertsplit(x), strict=True)), ca.jacobian(predicted, u)
    z_s = (ca.exp(state["Fc"]) if "Fc" in state else joint.coulomb) / joint.bristle_stiffness
    slip = ca.fabs(state["v_m"]) / rate_hz / z_s
    noises = {"z": noise[3] * z_s**2 * slip * ca.exp(-slip), "w": noise[2]}
    noises |= {name: noise[4 + i] for i, name in enumerate(joint.followed)}
    spread += noise[1] * by_u @ by_u.T + ca.diag(ca.vertcat(*(noises.get(name, 0.0) for name in joint.states)))  # Q
    gain_numerator = spread[:, 0] - cross @ cross[0, :].T
    S = gain_numerator[0] + noise[0]
    gain = gain_numerator / S
    e = y - predicted[0]
    reduction = ca.SX.eye(n)
    reduction[:, 0] -= gain
    joseph = ca.tril2symm(ca.tril(reduction @ spread @ reduction.T + noise[0] * gain @ gain.T))
    results = map(ca.densify, (predicted + gain * e, ca.horzcat(joseph, reduction @ cross), e, S))
    return ca.Function(
        "filter_step", [x, P, u, g, y, noise], [*results],
        ["x", "P", "u", "g", "y", "noise"], ["x_next", "P_next", "innovation", "variance"], {"cse": True}
    )  # fmt: skip


# A count over the standard deviation of rounding to it; counts a sample below which rounding is an error for long.
COUNT_OVER_STD, MOVING = math.sqrt(12), 0.2
_BLOCK = 1024  # samples of one call, whose states are in memory at once; the last call repeats a motion's last sample
# Uncertainty of friction before the first sample: relative std; of the offset relative to F_c.
PRIOR = dict.fromkeys(("f", "f+", "f-", "offset"), 0.5) | {"Fc": 0.3}


@frozen_value
class JointSamples:
    """Torque and load (n,), constant over each sample, and the motor's angle (n,) at its end; one side, SI.

    start_s: of the motion, after the first one.
    """

    torque: FloatArray
    load: FloatArray
    angle: FloatArray
    start_s: float = 0.0

    def moves(self, count: float) -> BoolArray:
        """Return True (n,) where the angle moves by MOVING counts a sample, so that rounding is noise."""
        # At standstill the likelihood prefers ten times the torque noise, which lets the filter follow rounding.
        half_window = min(5, (len(self.angle) - 1) // 2)
        span = np.abs(self.angle[2 * half_window :] - self.angle[: len(self.angle) - 2 * half_window])
        return np.pad(span >= 2 * half_window * MOVING * count, half_window)


@dataclass(frozen=True)
class Track:
    """Output of the filter over n samples: tracked parameters x (n, p), their std (n, p), and innovations.

    variance (n, p): of x without the errors of the consider parameters.  innovation, innovation_variance (n,): error of
    the predicted angle, and its variance, likewise.  covariance (p, p): at the end, likewise.  drift (p,): std per root
    second.  time_s (n,): from the first motion.  moves (n,): as in `JointSamples`; all True if fewer than 10 % are.
    """

    joint: TrackedJoint
    rate_hz: float
    x: FloatArray
    std: FloatArray
    variance: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    covariance: FloatArray
    drift: FloatArray
    time_s: FloatArray
    moves: BoolArray

    @property
    def nis(self) -> FloatArray:
        """e^2 / S (n,): chi-squared of one degree of freedom where the filter's noise is right."""
        return self.innovation**2 / self.innovation_variance

    def values(self, name: str, stds: float = 0.0) -> FloatArray:
        """Return a tracked parameter over time (n,), shifted by `stds` standard deviations."""
        i = self.joint.followed.index(name)
        column = self.x[:, i] + stds * self.std[:, i]
        return column if name == "offset" else np.exp(column)


def first_estimate(
    joint: TrackedJoint, angle: float, load: float = 0.0, velocity: tuple[float, float] = (0.0, 0.0)
) -> tuple[FloatArray, FloatArray]:
    """Return the first x (n,), P (n, n + m) of `filter_step`: spring deflected by the load, friction with std by PRIOR.

    velocity: with its standard deviation.
    """
    names = joint.states
    bend = joint.coulomb / joint.bristle_stiffness
    start = {"q_m": angle, "q_l": angle - (load / joint.stiffness if joint.stiffness > 0 else 0.0)}
    start |= dict.fromkeys(("v_m", "v_l"), velocity[0])
    std = {"q_m": bend, "q_l": 2 * bend, "z": bend / 2, "w": 0.1 * joint.coulomb}
    std |= dict.fromkeys(("v_m", "v_l"), math.hypot(1e-2, velocity[1]))
    for name in joint.followed:
        start[name] = 0.0 if name == "offset" else float(np.log(joint.coulomb if name == "Fc" else joint.viscous))
        std[name] = PRIOR[name] * (joint.coulomb if name == "offset" else 1.0)
    x = np.array([start.get(name, 0.0) for name in names])
    return x, np.diag([std[name] ** 2 for name in names] + [0.0] * len(joint.consider_parameters))[: len(names)]


FIRST_SAMPLES = 5  # over which the velocity at the start of a motion is averaged


class KalmanFilter:
    """Filter of a joint at a sampling rate.

    samples: approximate total number of samples; a large number is filtered by compiled code.
    """

    def __init__(self, joint: TrackedJoint, rate_hz: float, samples: int = 0) -> None:
        self.joint, self.rate_hz = joint, rate_hz
        self._block = compile_function(filter_step(joint, rate_hz), samples).mapaccum("filter", _BLOCK, 2)

    def run(self, motions: Sequence[JointSamples], noise: FilterNoise) -> Track:
        """Filter motions one after the other; each pause adds the drift of its duration to the variance of friction.

        A motion starts with the mean velocity of its first samples: an error of it would bias friction.
        """
        joint, n_x, p = self.joint, len(self.joint.states), len(self.joint.followed)
        drift, friction_rows = np.array([noise.drift.get(name, 0.0) for name in joint.followed]), slice(n_x - p, n_x)
        noise_rows = np.tile(noise.vector(joint, self.rate_hz), (_BLOCK, 1))
        lengths, start, (x, P) = [len(motion.angle) for motion in motions], 0, first_estimate(joint, 0.0)
        shapes = [(_BLOCK, n_x), (_BLOCK, P.shape[1], n_x), (_BLOCK,), (_BLOCK,)]
        numbers, time_s = np.empty((3, sum(lengths), p)), np.zeros(sum(lengths) + 1)
        innovations = np.empty((2, sum(lengths)))
        for n, motion in zip(lengths, motions, strict=True):
            x_before, P_before = x, P
            x, P = self._start(motion)
            if start:
                x[friction_rows], P[friction_rows] = x_before[friction_rows], P_before[friction_rows]
                P[friction_rows, : n_x - p] = 0.0
                P[friction_rows, friction_rows] += np.diag(drift**2 * max(0.0, motion.start_s - time_s[start]))
            for begin in range(0, n, _BLOCK):
                samples = slice(begin, begin + _BLOCK)
                block = np.stack([motion.torque[samples], motion.load[samples], motion.angle[samples]])
                rows = slice(start + begin, start + begin + block.shape[1])
                block = np.pad(block, ((0, 0), (0, _BLOCK - block.shape[1])), "edge")
                outputs = evaluated(self._block, [x, P.T, *block, noise_rows], shapes)
                states, spread, e, S = (output[: n - begin] for output in outputs)
                variance = np.diagonal(spread, axis1=1, axis2=2)[:, friction_rows]
                consider_variance = np.sum(spread[:, n_x:, friction_rows] ** 2, axis=1)
                numbers[:, rows] = states[:, friction_rows], np.sqrt(variance), variance - consider_variance
                innovations[:, rows] = e, S
                x, P = states[-1], spread[-1].T.copy()
            time_s[start + 1 : start + n + 1] = motion.start_s + np.arange(1, n + 1) / self.rate_hz
            start += n
        moves = np.concatenate([motion.moves(COUNT_OVER_STD * noise.angle) for motion in motions])
        moves |= moves.mean() < 0.1
        covariance = P[friction_rows, friction_rows] - P[friction_rows, n_x:] @ P[friction_rows, n_x:].T
        (x, std, variance), (e, S) = numbers, innovations
        return Track(joint, self.rate_hz, x, std, variance, e, S, covariance, drift, time_s[1:], moves)

    def _start(self, motion: JointSamples) -> tuple[FloatArray, FloatArray]:
        """Return the first x (n,) and P (n, n + m) of a motion, with its mean velocity and the std of this mean."""
        angles = motion.angle[np.minimum([0, FIRST_SAMPLES, 2 * FIRST_SAMPLES], len(motion.angle) - 1)]
        first, second = np.diff(angles) * self.rate_hz / FIRST_SAMPLES
        return first_estimate(self.joint, float(motion.angle[0]), float(motion.load[0]), (first, second - first))


def estimate_noise(
    kalman: KalmanFilter, samples: JointSamples, guess: FilterNoise, settled_s: float
) -> tuple[FilterNoise, float]:
    """Return the noise with the largest likelihood of innovations (Mehra, IEEE Trans. Automatic Control 15(2), 1970).

    Also returns -2 ln of this likelihood for each sample, less a constant.

    Only samples that move (Track.moves) count. The noise of angle and slip is at least as large as guessed: without
    slip, F_c is wrong by 4 to 18 % if the friction is not LuGre's and the joint slips by about z_s in a sample.
    """
    names = ["angle", "torque", "slip", *(["correlated_torque"] if kalman.joint.correlation_s > 0 else [])]
    is_steady = np.arange(len(samples.angle)) >= round(settled_s * kalman.rate_hz)
    lowest = np.log([{"angle": 1.0, "slip": 1.0}.get(name, 1e-3) for name in names])

    def noise_at(x: FloatArray) -> FilterNoise:
        factors = zip(names, np.exp(x).tolist(), strict=True)
        return replace(guess, **{name: getattr(guess, name) * factor for name, factor in factors})

    def cost(x: FloatArray) -> float:
        track = kalman.run([samples], noise_at(x))
        S, e = track.innovation_variance[is_steady & track.moves], track.innovation[is_steady & track.moves]
        value = float(np.mean(np.log(S) + e**2 / S))
        return value if np.isfinite(value) else 1e6

    # Two simplices with factors of three: about the guess, and about less torque and more slip, where another minimum
    # may be. The second one counts if its likelihood is significantly larger; an accuracy of 5 % is sufficient.
    n, ends = len(names), list[Any]()
    options: dict[str, Any] = {"xatol": 0.05, "fatol": 1e-4, "maxfev": 150}
    bounds = [(low, math.log(1e3)) for low in lowest.tolist()]
    for start in (np.zeros(n), np.log([{"torque": 0.2, "slip": 4.0}.get(name, 1.0) for name in names])):
        options["initial_simplex"] = np.vstack([start, start + 1.1 * np.eye(n)])
        ends.append(minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options))
    end = ends[int((ends[0].fun - ends[1].fun) * is_steady.sum() > 20.0)]
    return noise_at(end.x), float(end.fun)
