r"""Extended Kalman filter of a joint with LuGre friction whose numbers drift, over its motions one after the other.

.. math:: J_m \ddot q_m + f \dot q_m + \tau_f(\dot q_m, z) + k (q_m - q_l) + d (\dot q_m - \dot q_l) = u + w, \qquad
          J_l \ddot q_l + g + b = k (q_m - q_l) + d (\dot q_m - \dot q_l)

on one side of the gear: LuGre's bristles z, the torque g of gravity as a model has it, its slow error b, and w, noise
of the torque that is correlated in time (ripple, cogging, cables; taken for white, it makes bands far too narrow). The
followed numbers are constants that drift: ln F_c, with F_s / F_c and sigma_0 held; ln f, or one of each direction; b.
A sample of the filter is a CasADi function,

.. math::
   x^- = a(x, u, g), \quad P^- = F P F^T + Q, \qquad
   K = P^- h / S, \quad S = h^T P^- h + R, \quad e = y - h^T x^-, \\
   x^+ = x^- + K e, \qquad P^+ = (I - K h^T) P^- (I - K h^T)^T + K R K^T \text{ (Joseph)},

F the Jacobian of a, h that of the measured angle. Numbers c that the filter holds (F_s / F_c, Stribeck velocity,
inertia, stiffness, gravity) are wrong by some percent, and its bands have that: they are consider parameters (Schmidt,
Advances in Control Systems 3, 1966), never updated, with cross covariance Sigma over their standard deviations sigma,

.. math::
   \Sigma^- = F \Sigma + \frac{\partial a}{\partial c} \mathrm{diag}(\sigma), \qquad
   P^- = F (P - \Sigma \Sigma^T) F^T + \Sigma^- \Sigma^{-T} + Q, \qquad \Sigma^+ = (I - K h^T) \Sigma^-

They have no share in the gain (P without their part makes K and S): their errors show in the innovations, and a gain
that expects them lags. Q has the noise of the torques, through the step's own Jacobian, the drift of the followed
numbers, and the slip of the bristle, (slip z_s)^2 l e^-l, l = |v| T_s / z_s, z_s = F_c / sigma_0: a joint that creeps
does not take its bristle for certain, one that slides by more than z_s in a sample has it at its end.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import casadi as ca
import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.base.statistics import QUANTILE_95
from elastid.friction.dynamic import Bristle
from elastid.friction.static import Curve
from elastid.friction_study.result import JointFriction
from elastid.friction_study.spec import Followed
from elastid.simulation.closed_loop import compiled, evaluated
from elastid.simulation.dynamics import runge_kutta_step

# Relative std of held numbers where none are known; F_s / F_c falls by a tenth while a gear warms up.
TOLERANCES: Mapping[str, float] = {
    "stiction_ratio": 0.08, "stribeck_velocity": 0.3, "inertia": 0.02, "stiffness": 0.05, "gravity": 0.1
}  # fmt: skip


@dataclass(frozen=True)
class FollowedJoint:
    """Inertias, spring and damper, and the friction from which a filter starts; all on one side of the gear, SI.

    link_inertia, stiffness, damping: 0 for a joint that is rigid, with all of its inertia in motor_inertia.
    stiction_ratio: F_s / F_c.  bristle_stiffness, bristle_damping: sigma_0, sigma_1.  followed: what changes.
    correlation_s: time constant of the torque noise w, 0 for none.  tolerances: relative std of numbers that are held,
    those of TOLERANCES; left out or 0 where exact.
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
    def held(self) -> tuple[str, ...]:
        """The numbers that the filter holds, with a tolerance, in order."""
        is_there = dict.fromkeys(("stiction_ratio", "stribeck_velocity"), self.stribeck_velocity > 0)
        is_there["stiffness"] = self.stiffness > 0
        return tuple(name for name in TOLERANCES if self.tolerances.get(name, 0.0) > 0 and is_there.get(name, True))

    def step(self, rate_hz: float) -> ca.Function:
        """(x (n,), c (m,), u, g) -> x (n,) a sample later: a Runge-Kutta step and the bristle's exact update.

        u, g: torques, held over the sample.  c: relative errors of the held numbers.
        """
        names = self.states
        x, u, g = ca.SX.sym("x", len(names)), ca.SX.sym("u"), ca.SX.sym("g")
        c = ca.SX.sym("c", len(self.held))
        factor = dict.fromkeys(TOLERANCES, ca.SX(1.0)) | {name: 1 + c[i] for i, name in enumerate(self.held)}
        state = dict(zip(names, ca.vertsplit(x), strict=True))
        n_q = 2 if self.stiffness > 0 else 1
        coulomb = ca.exp(state["Fc"]) if "Fc" in state else self.coulomb
        inverse = 1 / (self.stribeck_velocity * factor["stribeck_velocity"]) if self.stribeck_velocity > 0 else 0.0
        curve = Curve(coulomb, self.stiction_ratio * factor["stiction_ratio"] * coulomb, inverse)
        law = Bristle(self.bristle_stiffness, self.bristle_damping)
        noise, inertia = state.get("w", 0.0), factor["inertia"]
        ways = ("f", "f") if "f" in state else ("f+", "f-")
        forwards, backwards = (ca.exp(state[name]) if name in state else self.viscous for name in ways)

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
        faded = [state["w"] * math.exp(-1 / (rate_hz * self.correlation_s))] if "w" in state else []
        following = ca.vertcat(q, v, z, *faded, *(state[name] for name in self.followed))
        return ca.Function("step", [x, c, u, g], [following], ["x", "c", "u", "g"], ["next"])


@dataclass(frozen=True)
class FilterNoise:
    """Standard deviations of the noise and drift of a filter, one side of the gear, SI.

    angle: of a sample of the motor's angle; encoder counts have count / sqrt(12).  torque: white, of a sample.
    correlated: of w, in torque.  drift: of the followed numbers, in a root second; of the logarithms relative.
    slip: of the bristle in z_s = F_c / sigma_0, for each z_s of slip, as a random walk: a filter that takes its bristle
    for certain gets F_c wrong at every stop.
    """

    angle: float
    torque: float
    correlated: float = 0.0
    drift: Mapping[str, float] = field(default_factory=dict)
    slip: float = 0.1

    def vector(self, joint: FollowedJoint, rate_hz: float) -> FloatArray:
        """The arguments (4 + n_followed,) of a filter's step: variances of a sample."""
        fade = math.exp(-2 / (rate_hz * joint.correlation_s)) if joint.correlation_s > 0 else 1.0
        drift = [self.drift.get(name, 0.0) ** 2 / rate_hz for name in joint.followed]
        return np.array([self.angle**2, self.torque**2, self.correlated**2 * (1 - fade), self.slip**2, *drift])


def filter_step(joint: FollowedJoint, rate_hz: float) -> ca.Function:
    """(x (n,), P (n, n + m), u, g, y, noise (4 + n_followed,)) -> (x, P, innovation e, its variance S).

    P: covariance of the states, then their cross covariance with the m held numbers, over the std of these.
    u, g: torque of the motor and of the load, held from the sample before.  y: angle now.  noise: FilterNoise.vector.
    """
    n, m = len(joint.states), len(joint.held)
    x, P, c = ca.SX.sym("x", n), ca.SX.sym("P", n, n + m), ca.SX.sym("c", m)
    u, g, y = ca.SX.sym("u"), ca.SX.sym("g"), ca.SX.sym("y")
    noise = ca.SX.sym("noise", 4 + len(joint.followed))
    moved = joint.step(rate_hz)(x, c, u, g)
    predicted, by_held = ca.substitute([moved, ca.jacobian(moved, c)], [c], [ca.SX.zeros(m)])
    F = ca.jacobian(predicted, x)
    std = ca.DM([joint.tolerances[name] for name in joint.held])
    carried, added = F @ P[:, n:], by_held @ ca.diag(std)
    cross, mixed = carried + added, carried @ added.T
    spread = F @ P[:, :n] @ F.T + mixed + mixed.T + added @ added.T
    state, by_u = dict(zip(joint.states, ca.vertsplit(x), strict=True)), ca.jacobian(predicted, u)
    z_s = (ca.exp(state["Fc"]) if "Fc" in state else joint.coulomb) / joint.bristle_stiffness
    slipped = ca.fabs(state["v_m"]) / rate_hz / z_s
    noises = {"z": noise[3] * z_s**2 * slipped * ca.exp(-slipped), "w": noise[2]}
    noises |= {name: noise[4 + i] for i, name in enumerate(joint.followed)}
    Q = noise[1] * by_u @ by_u.T + ca.diag(ca.vertcat(*(noises.get(name, 0.0) for name in joint.states)))
    spread += Q
    towards = spread[:, 0] - cross @ cross[0, :].T
    S = towards[0] + noise[0]
    gain = towards / S
    e = y - predicted[0]
    left = ca.SX.eye(n)
    left[:, 0] -= gain
    joseph = ca.tril2symm(ca.tril(left @ spread @ left.T + noise[0] * gain @ gain.T))
    results = map(ca.densify, (predicted + gain * e, ca.horzcat(joseph, left @ cross), e, S))
    return ca.Function(
        "filter_step", [x, P, u, g, y, noise], [*results],
        ["x", "P", "u", "g", "y", "noise"], ["x_next", "P_next", "innovation", "variance"], {"cse": True},
    )  # fmt: skip


# A count over the standard deviation of rounding to it; counts a sample below which rounding is an error for long.
COUNT_OVER_STD, MOVING = math.sqrt(12), 0.2
LAGS = 50  # of the autocorrelation
# Uncertainty of friction before the first sample: relative std, and of the offset as a share of F_c.
PRIOR = {"Fc": 0.3, "f": 0.5, "f+": 0.5, "f-": 0.5, "offset": 0.5}


@frozen_value
class JointSamples:
    """Torque and load (n,), each held until the sample's end, and the motor's angle (n,) there; one side, SI.

    start_s: of the motion, after the first one.
    """

    torque: FloatArray
    load: FloatArray
    angle: FloatArray
    start_s: float = 0.0

    def moves(self, count: float) -> BoolArray:
        """True (n,) where the angle moves by MOVING counts a sample, so that rounding is noise."""
        # Where it stands the likeliest filter is one that runs after the rounded angle, with tenfold torque noise.
        reach = min(5, (len(self.angle) - 1) // 2)
        span = np.abs(self.angle[2 * reach :] - self.angle[: len(self.angle) - 2 * reach])
        return np.pad(span >= 2 * reach * MOVING * count, reach)


@frozen_value
class Track:
    """A filter over n samples: states (n, n_x), their std (n, n_x), covariance of the followed numbers (n, p, p).

    innovation, variance (n,): error of the predicted angle, and the variance that the filter expected: like the
    covariance without the errors of held numbers, which std has.  drift (p,): of the followed numbers, in a root
    second.  time_s (n,): from the first motion.  moves (n,): as of `JointSamples`; all where hardly any does.
    """

    joint: FollowedJoint
    rate_hz: float
    x: FloatArray
    std: FloatArray
    followed_covariance: FloatArray
    innovation: FloatArray
    variance: FloatArray
    drift: FloatArray
    time_s: FloatArray
    moves: BoolArray

    @property
    def nis(self) -> FloatArray:
        """e^2 / S (n,): chi-squared of one degree of freedom where the filter's noise is right."""
        return self.innovation**2 / self.variance

    def values(self, name: str, stds: float = 0.0) -> FloatArray:
        """State over time (n,), or the limit of its band at so many stds; logarithmic states are converted."""
        i = self.joint.states.index(name)
        column = self.x[:, i] + stds * self.std[:, i]
        return np.exp(column) if name in self.joint.followed and name != "offset" else column


def first_estimate(joint: FollowedJoint, angle: float, load: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """x and P of `filter_step` at rest at an angle, spring bent by the load, bristle anywhere, friction by PRIOR."""
    names = joint.states
    bend = joint.coulomb / joint.bristle_stiffness
    start = {"q_m": angle, "q_l": angle - (load / joint.stiffness if joint.stiffness > 0 else 0.0)}
    std = {"q_m": bend, "q_l": 2 * bend, "v_m": 1e-2, "v_l": 1e-2, "z": bend / 2, "w": 0.1 * joint.coulomb}
    for name in joint.followed:
        start[name] = 0.0 if name == "offset" else float(np.log(joint.coulomb if name == "Fc" else joint.viscous))
        std[name] = PRIOR[name] * (joint.coulomb if name == "offset" else 1.0)
    x = np.array([start.get(name, 0.0) for name in names])
    return x, np.diag([std[name] ** 2 for name in names] + [0.0] * len(joint.held))[: len(names)]


class KalmanFilter:
    """A joint's filter at a rate; run(...) carries an estimate over motions.

    samples: about how many it will filter in all, as machine code from many on.
    """

    def __init__(self, joint: FollowedJoint, rate_hz: float, samples: int = 0) -> None:
        self.joint, self.rate_hz = joint, rate_hz
        step = compiled(filter_step(joint, rate_hz), samples)
        self._loop = cache(lambda n: step.mapaccum("filter", n, 2))

    def run(self, motions: Sequence[JointSamples], noise: FilterNoise) -> Track:
        """The track over motions, at rest where one begins; the pause before it makes friction less certain."""
        joint, n_x, p = self.joint, len(self.joint.states), len(self.joint.followed)
        given = noise.vector(joint, self.rate_hz)
        drift = np.array([noise.drift.get(name, 0.0) for name in joint.followed])
        parts, times, followed = list[tuple[FloatArray, ...]](), list[FloatArray](), slice(n_x - p, n_x)
        for motion in motions:
            last, (x, P) = parts[-1:], first_estimate(joint, float(motion.angle[0]), float(motion.load[0]))
            for path, covariance, *_ in last:
                pause_s = max(0.0, motion.start_s - float(times[-1][-1]))
                x[followed], P[followed] = path[-1, followed], covariance[-1, followed]
                P[followed, : n_x - p] = 0.0
                P[followed, followed] += np.diag(drift**2 * pause_s)
            n = len(motion.angle)
            signals = [motion.torque, motion.load, motion.angle, np.tile(given, (n, 1))]
            shapes = [(n, n_x), (n, P.shape[1], n_x), (n,), (n,)]
            states, spread, e, S = evaluated(self._loop(n), [x, P.T, *signals], shapes)
            parts.append((states, spread.mT, e, S))
            times.append(motion.start_s + np.arange(1, len(motion.angle) + 1) / self.rate_hz)
        x, P, e, S = (np.concatenate(part) for part in zip(*parts, strict=True))
        cross = P[:, followed, n_x:]
        covariance = P[:, followed, followed] - cross @ cross.mT
        std = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        moves = np.concatenate([motion.moves(COUNT_OVER_STD * noise.angle) for motion in motions])
        moves |= moves.mean() < 0.1
        return Track(joint, self.rate_hz, x, std, covariance, e, S, drift, np.concatenate(times), moves)


@dataclass(frozen=True)
class FilterThresholds:
    """Thresholds of the judgement of a filter.  Of 100 clean logs two have a note (scripts/studies/results.csv)."""

    nis_band: tuple[float, float] = (0.5, 1.15)  # mean NIS of an honest filter; below 1 at rest and without drift
    max_correlation: float = 0.4  # of innovations from sample to sample; above, bands are 1.5 times too narrow
    max_std_ratio: float = 0.9  # of a number's std over that without the log: above, the log does not identify it
    lags_s: tuple[float, ...] = (0.3, 1.0, 3.0)  # over which a followed number is compared with itself
    max_movement: tuple[float, float] = (0.2, 2.0)  # mean square over band, and over noise and drift: 1 of white errors


FILTER = FilterThresholds()


@frozen_value
class Consistency:
    """Consistency of the samples after a filter has settled at which the joint moves (Track.moves).

    nis: mean.  autocorrelation (n_lags,): of the normalised innovations, from lag 0.  n_eff: independent samples.
    restless: followed numbers that move by more than their bands hold.
    """

    nis: float
    autocorrelation: FloatArray
    n_eff: float
    restless: tuple[str, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why a band is too narrow: movements, correlation and size of innovations.

        Nothing sees an error of held numbers that the band does not have and the followed ones take up for good.
        """
        reasons = [f"{name} moves by more than noise and filter.drift allow" for name in self.restless]
        if self.autocorrelation[1] > FILTER.max_correlation:  # alternating ones make no band too narrow
            reasons.append(f"innovations are correlated by {self.autocorrelation[1]:.2f} from sample to sample")
        if self.nis > FILTER.nis_band[1]:
            reasons.append(f"mean NIS is {self.nis:.2f}: innovations are larger than expected")
        return tuple(reasons)


def consistency(track: Track, settled_s: float) -> Consistency:
    """Consistency of a track after settled_s (Bar-Shalom, Li and Kirubarajan, 2001, section 5.4)."""
    first = round(settled_s * track.rate_hz)
    moves = track.moves[first:]  # at standstill the error of a rounded angle is constant, and no noise
    nu = np.where(moves, track.innovation[first:] / np.sqrt(track.variance[first:]), 0.0)
    power = float(nu @ nu)
    rho = np.array([float(nu[: len(nu) - lag] @ nu[lag:]) / power for lag in range(LAGS)])
    n_eff = float(np.clip(moves.sum() * (1 - rho[1]) / (1 + rho[1]), 1.0, moves.sum()))
    return Consistency(float(track.nis[first:][moves].mean()), rho, n_eff, _restless(track, first))


def _restless(track: Track, first: int) -> tuple[str, ...]:
    """Followed numbers that move within some seconds by more than their bands, and noise and drift, allow."""
    p, restless = len(track.joint.followed), np.zeros(len(track.joint.followed), bool)
    x, variance, time_s = track.x[first:, -p:], track.std[first:, -p:] ** 2, track.time_s[first:, None]
    spread = np.diagonal(track.followed_covariance[first:], axis1=1, axis2=2)
    for lag_s in FILTER.lags_s:
        lag = max(1, min(round(lag_s * track.rate_hz), len(x) // 4))
        square = (x[lag:] - x[:-lag]) ** 2
        drifted = track.drift**2 * (time_s[lag:] - time_s[:-lag])
        over_band = np.mean(square / (variance[lag:] + variance[:-lag]), axis=0)
        over_noise = np.mean(square / (spread[lag:] + spread[:-lag] + drifted), axis=0)
        restless |= (over_band > FILTER.max_movement[0]) & (over_noise > FILTER.max_movement[1])
    return tuple(name for name, moves in zip(track.joint.followed, restless, strict=True) if moves)


def unknown(track: Track) -> BoolArray:
    """True (n, p) where a number is no better known than before the log, drift included."""
    prior = np.diag(first_estimate(track.joint, 0.0)[1])[-len(track.joint.followed) :]
    variance = np.diagonal(track.followed_covariance, axis1=1, axis2=2)
    return variance > FILTER.max_std_ratio**2 * prior


def estimate_noise(kalman: KalmanFilter, samples: JointSamples, guess: FilterNoise, settled_s: float) -> FilterNoise:
    """The noise with the largest likelihood of innovations (Mehra, IEEE Trans. Automatic Control 15(2), 1970).

    Over samples that move (Track.moves); of angle and bristle's slip at least as guessed.

    Without the bristle's slip other frictions than LuGre's put F_c off by 4 to 18 % where a joint slips by about z_s in
    a sample.
    """
    names = ["angle", "torque", "slip", *(["correlated"] if kalman.joint.correlation_s > 0 else [])]
    settled = np.arange(len(samples.angle)) >= round(settled_s * kalman.rate_hz)
    lowest = np.log([{"angle": 1.0, "slip": 1.0}.get(name, 1e-3) for name in names])

    def noise_at(x: FloatArray) -> FilterNoise:
        factors = zip(names, np.exp(np.clip(x, lowest, np.log(1e3))).tolist(), strict=True)
        return replace(guess, **{name: getattr(guess, name) * factor for name, factor in factors})

    def cost(x: FloatArray) -> float:
        track = kalman.run([samples], noise_at(x))
        S, e = track.variance[settled & track.moves], track.innovation[settled & track.moves]
        value = float(np.mean(np.log(S) + e**2 / S))
        return value if np.isfinite(value) else 1e6

    # Factors of three about the guess; noise that is known to 5 % is known well enough.
    x0, simplex = np.zeros(len(names)), np.vstack([np.zeros(len(names)), 1.1 * np.eye(len(names))])
    options = {"xatol": 0.05, "fatol": 1e-4, "maxfev": 150, "initial_simplex": simplex}
    return noise_at(np.asarray(minimize(cost, x0, method="Nelder-Mead", options=options).x))


@frozen_value
class FollowedFriction:
    """Knowledge of a filter of a joint over time_s (m,): values, low, high (m, p) of the followed numbers, 95 % bands.

    unknown (m, p): where the motion does not identify a number, so that it is held.  nis (m,): mean up to each time
    since the one before.  torque_std: of white noise, found or given.
    """

    joint: str
    slides: bool
    names: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    low: FloatArray
    high: FloatArray
    unknown: BoolArray
    nis: FloatArray
    consistency: Consistency
    noise: FilterNoise
    filtered: FollowedJoint
    rate_hz: float
    notes: tuple[Note, ...] = ()

    @property
    def verdict(self) -> str:
        """Verdict on the reliability of the confidence bands."""
        return "no test doubts the bands" if not self.consistency.doubts else "the bands are too narrow (see warnings)"


def follow(
    name: str,
    slides: bool,
    joint: FollowedJoint,
    motions: Sequence[JointSamples],
    rate_hz: float,
    guess: FilterNoise,
    settle_s: float,
    find_noise: bool,
) -> FollowedFriction:
    """Followed friction; find_noise: by innovations of the longest motion, not guessed.  DataError for short ones."""
    duration_s = sum(len(motion.angle) for motion in motions) / rate_hz
    if duration_s <= settle_s + LAGS / rate_hz:
        raise DataError(
            "filter/record",
            f"motions of {duration_s:.3g} s end before it settles ({settle_s:g} s): log longer, or give filter.settle",
            f"joint {name}",
        )
    # At most half a minute of the longest motion shows the noise.
    longest, cut = max(motions, key=lambda motion: len(motion.angle)), slice(0, round(30.0 * rate_hz))
    stretch = JointSamples(longest.torque[cut], longest.load[cut], longest.angle[cut])
    # Some sixty runs find it.
    kalman, noise = KalmanFilter(joint, rate_hz, 60 * len(stretch.angle) * find_noise), guess
    if find_noise:
        noise = estimate_noise(kalman, stretch, guess, min(settle_s, 1.0))
    track = kalman.run(motions, noise)
    judged = consistency(track, settle_s)
    step = max(1, (n := len(track.innovation)) // 2000)  # a result keeps so many points
    ends = np.arange(n % step + step - 1, n, step)
    mean_nis = track.nis[n % step :].reshape(-1, step).mean(axis=1)
    values, low, high = (
        np.stack([track.values(name, stds)[ends] for name in joint.followed], axis=1)
        for stds in (0.0, -QUANTILE_95, QUANTILE_95)
    )
    notes = tuple(_notes(f"joint {name}", track, judged))
    return FollowedFriction(
        name, slides, joint.followed, track.time_s[ends], values, low, high, unknown(track)[ends], mean_nis,
        judged, noise, joint, rate_hz, notes,
    )  # fmt: skip


def with_tolerances(joint: FollowedJoint, identified: JointFriction) -> FollowedJoint:
    """A joint whose held numbers are known as far as a study has identified them, else as is usual (TOLERANCES)."""
    known, shared = dict(joint.tolerances), identified.shared
    if "inertia" in shared and not joint.stiffness > 0:  # of an elastic one those of the robot's file are taken
        known["inertia"] = shared["inertia"][1] / shared["inertia"][0]
    if gravity := [shared[name] for name in ("gravity.cos", "gravity.sin") if name in shared]:
        size, std = np.linalg.norm(gravity, axis=0).tolist()
        known["gravity"] = std / max(size, 1e-300)
    return replace(joint, tolerances={name: float(np.clip(std, 1e-4, 0.5)) for name, std in known.items()})


def _notes(place: str, track: Track, judged: Consistency) -> Iterator[Note]:
    names, P = track.joint.followed, track.followed_covariance[-1]
    never = np.all(unknown(track), axis=0).tolist()
    std = np.sqrt(np.diag(P))
    pairs = np.argwhere(np.triu(np.abs(P), 1) > FILTER.max_std_ratio * np.outer(std, std)).tolist()
    weak = [f"{name}, held where it began" for name, is_unknown in zip(names, never, strict=True) if is_unknown]
    weak += [f"{names[i]} apart from {names[j]}" for i, j in pairs]
    if weak:
        text = (
            f"the motion does not identify {'; '.join(weak)}: reversals distinguish Coulomb friction from an offset, "
            "several speeds from viscous friction"
        )
        yield Note("filter/not-observable", text, place, severity="warning" if pairs else "information")
    if judged.doubts:
        text = (
            f"{'; '.join(judged.doubts)}; the model or its noise is wrong, and the bands are too narrow: correct "
            "inertia, spring, bristles, gravity and payload of the joint, or give filter.correlation_time, "
            "filter.torque_std or a larger filter.drift"
        )
        yield Note("filter/inconsistent", text, place, severity="warning")
