r"""Inertia, friction and command delay of joints, estimated from commands, encoder positions and gains without torque.

.. math:: \hat\theta = \arg\min_\theta \sum_i N_i \log \sum_k \bigl(q_{ik} - \hat q_{ik}(\theta_i, T_d)\bigr)^2

q hat: positions simulated from the commands alone (`simulation.rigid_joints`), averaged over a few samples; N_i and
theta_i: number of averages and parameters of joint i; T_d: delay of all joints of a log. This is the output-error
method (Ljung, System Identification, 1999, section 10.2). A regression on the torque computed from gains and encoder is
biased: k_p T_d appears in viscous friction.

Errors of simulated positions are not white. The covariance of the estimates therefore follows from the long-run
covariance of each log's scores on slow cosines (`least_squares.long_run`): over time, or over the angle if it is
larger, because model errors repeat with the angle. If the influences d_k of the m logs of a joint scatter significantly
more, the diagonal of Sigma replaces the variances; the correlations remain:

.. math:: \Sigma = \frac{m}{m - 1} \sum_k d_k d_k^T
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate

import numpy as np
from scipy.signal import savgol_filter
from scipy.special import fdtri

from elastid.base.arrays import BoolArray, FloatArray, fold_periods, values_by_name
from elastid.base.errors import DataError
from elastid.base.statistics import small_sample_factors
from elastid.friction_study.commanded import DELAY, CommandedJoint, CommandedLog
from elastid.friction_study.least_squares import cosine_count, long_run, state_widening
from elastid.simulation.rigid_joints import PARAMETERS, CommandedJoints

# Trial delays, s; the search starts from the best.
START_DELAYS = np.linspace(0.0, 0.04, 9)
# Minimum rate of the averaged positions, and minimum number in a period at the upper edge of the commands' band.
MIN_MEANS_HZ, MEANS_PER_PERIOD = 40.0, 12.0
# Time constants k_d / k_p until errors of the initial state are negligible; window of smoothed derivatives, s.
SETTLING_CONSTANTS, SMOOTH_S = 15.0, 0.06
# Perturbation of a parameter for its sensitivity, relative to its scale, and perturbation of the delay in s.
PERTURBATION, DELAY_STEP_S = 1e-3, 2e-4
# Iterations of the short searches, the factor and the upper limit (s) of their simulation steps.
START_ITERATIONS, START_COARSENESS, MAX_COARSE_STEP_S = 8, 4, 2e-3
# Iterations of the full search; least decrease of the cost per average; least eigenvalue of an identifiable direction.
# The eigenvalues sum to the number of directions.
MAX_ITERATIONS, TOLERANCE, MIN_CURVATURE = 30, 1e-5, 1e-12
DAMPINGS = np.append(0.0, 10.0 ** np.arange(-4, 4))
# Effects near zero velocity and their parameters. SOFT is not combined with STRIBECK: MuJoCo has no stiction.
EFFECTS = SOFT, BRISTLES, STRIBECK = PARAMETERS[6:8], PARAMETERS[8:10], PARAMETERS[10:]
# Each row: effects that are added one after another.  Start values of SOFT: stick time, s, and creep; of BRISTLES:
# s F_c over the rms speed, s, and damping time, s; of STRIBECK: F_s / F_c - 1, and nu_s over the rms speed.
START_EFFECTS = (
    ((SOFT, (0.01, 0.1)),),
    ((SOFT, (0.02, 0.6)),),
    ((STRIBECK, (0.3, 0.1)), (BRISTLES, (2e-4, 0.001))),
    ((BRISTLES, (2e-3, 0.001)), (STRIBECK, (0.3, 0.1))),
)
# A joint has SOFT or BRISTLES if F_c and the parameters of the effect together exceed EFFECT_STDS standard deviations;
# SOFT requires a creep below MAX_CREEP, and its stick time counts beyond one simulation step. STRIBECK requires that
# F_s - F_c exceeds EFFECT_STDS standard deviations.
EFFECT_STDS, MAX_CREEP = 5.0, 0.9
UPPER_BOUNDS = {"creep": MAX_CREEP, "stick_time": 0.5, "bristle_time": 0.5}
SIGNIFICANCE_LEVEL = 0.1  # F-test of the scatter between logs against the scatter within logs


@dataclass(frozen=True)
class _Problem:
    """Output-error problem of all logs: S columns, one for each joint of each log, padded to the longest log.

    window: samples per mean.  effects: parameters of the effects of each joint.  steps: simulation steps in a sample.
    coarseness: factor by which these steps are longer than the dynamics require.
    """

    logs: tuple[CommandedLog, ...]
    joints: tuple[str, ...]
    commanded: CommandedJoints
    window: int
    effects: tuple[tuple[str, ...], ...]
    coarseness: int = 1
    steps: int = 0

    @classmethod
    def of(cls, logs: Sequence[CommandedLog]) -> "_Problem":
        """Build the problem of several logs."""
        n, joints = max(len(log.position) for log in logs), tuple(dict.fromkeys(j for log in logs for j in log.joints))

        def side_by_side(name: str) -> FloatArray:
            return np.hstack([np.pad(x := getattr(log, name), ((0, n - len(x)), (0, 0)), "edge") for log in logs])

        kp, kd, velocity, coupled, delay = (
            np.concatenate([getattr(log, name) for log in logs])
            for name in ("kp", "kd", "velocity", "coupled_inertia", "delay_inertia")
        )
        position = np.concatenate([log.position[0] for log in logs])
        rate_hz = logs[0].rate_hz
        commanded = CommandedJoints(
            rate_hz, side_by_side("command"), kp, kd, position, velocity, side_by_side("load"), coupled + delay,
            logs[0].is_zoh
        )  # fmt: skip
        highest = max(_upper_band_edge(log) for log in logs)
        window = max(1, int(rate_hz / max(MIN_MEANS_HZ, MEANS_PER_PERIOD * highest)))
        return cls(tuple(logs), joints, commanded, window, ((),) * len(joints))

    def with_steps(self, theta: FloatArray) -> "_Problem":
        """Return the problem with the number of simulation steps that theta (..., m, 12) requires."""
        steps = self.commanded.steps_per_sample(theta[..., self.index, :])
        coarse_steps = max(2, steps // self.coarseness, math.ceil(1 / (self.commanded.rate_hz * MAX_COARSE_STEP_S)))
        return replace(self, steps=min(steps, coarse_steps))

    @property
    def step_s(self) -> float:
        """Step of the simulation, s."""
        return 1 / self.commanded.rate_hz / self.steps

    @property
    def index(self) -> list[int]:
        """Index of the joint of each column."""
        return [self.joints.index(joint) for log in self.logs for joint in log.joints]

    @property
    def first_columns(self) -> list[int]:
        """First column of each joint."""
        return [self.index.index(i) for i in range(len(self.joints))]

    def simulate(self, theta: FloatArray, delay_s: FloatArray) -> list[FloatArray]:
        """Simulate averaged positions (n_k, K, m_k) of each log for K candidates: theta (K, m, 12), delays (K,)."""
        means = self.commanded.simulate(theta[:, self.index], delay_s, self.steps, self.window)
        parts = np.split(means, np.cumsum([len(log.joints) for log in self.logs])[:-1], axis=2)
        return [part[self._steady_means(log)] for log, part in zip(self.logs, parts, strict=True)]

    def errors(self, simulations: Sequence[FloatArray], candidate: int = 0) -> list[FloatArray]:
        """Return the measured minus the simulated means (n_k, m_k) of each log for one candidate."""
        return [q - sim[:, candidate] for q, sim in zip(self.measured, simulations, strict=True)]

    @property
    def counts(self) -> FloatArray:
        """Number N_i of averaged positions of each joint (m,)."""
        return np.bincount(self.index, [len(q) for q in self.measured for _ in q.T]).astype(np.float64)

    @property
    def speed(self) -> FloatArray:
        """Root mean square of the velocity of each joint (m,), at least 1e-9 rad/s for joints at rest."""
        squares = np.concatenate([np.sum(np.diff(q, axis=0) ** 2, axis=0) for q in self.measured])
        rms = np.sqrt(np.bincount(self.index, squares) / self.counts)
        return np.maximum(rms * self.commanded.rate_hz / self.window, 1e-9)

    @cached_property
    def measured(self) -> list[FloatArray]:
        """Averaged measured positions (n_k, m_k) of each log."""
        return [fold_periods(log.position, self.window).mean(axis=1)[self._steady_means(log)] for log in self.logs]

    def _steady_means(self, log: CommandedLog) -> slice:
        first = min(float(np.max(SETTLING_CONSTANTS * log.kd / log.kp)) * log.rate_hz, 0.2 * len(log.position))
        return slice(int(first) // self.window, len(log.position) // self.window)

    @property
    def lower_bounds(self) -> FloatArray:
        """Lower bounds (m, 12): 0 of F_c and effects, one step of a stick time, a thousandth of the speed of nu_s."""
        bounds = np.where(np.isin(PARAMETERS, ("coulomb", *PARAMETERS[6:])), 0.0, -np.inf)
        speeds = np.outer(self.speed / 1e3, np.isin(PARAMETERS, STRIBECK[1]))
        least = np.where(np.isin(PARAMETERS, SOFT[0]), self.step_s, speeds)
        return np.asarray(bounds + least * self.is_free)  # below, the parameters have no effect

    @cached_property
    def upper_bounds(self) -> FloatArray:
        """Upper bounds (m, 12): UPPER_BOUNDS; for F_c and F_s - F_c, the largest |u - k_p q| + |load|."""
        torque, bounds = np.zeros(len(self.joints)), [UPPER_BOUNDS.get(name, np.inf) for name in PARAMETERS]
        peaks = [(np.abs(log.command - log.kp * log.position) + np.abs(log.load)).max(axis=0) for log in self.logs]
        np.maximum.at(torque, self.index, np.concatenate(peaks))
        return np.where(np.isin(PARAMETERS, ("coulomb", "excess_stiction")), torque[:, None], bounds)

    @cached_property
    def is_free(self) -> BoolArray:
        """Flags (m, 12) of free parameters: the first four, gravity if it depends on the angle, and `effects`."""
        gravity = dict(pair for log in self.logs for pair in zip(log.joints, log.has_gravity.tolist(), strict=True))
        return np.array([
            [True] * 4 + [gravity[joint]] * 2 + [name in effects for name in PARAMETERS[6:]]
            for joint, effects in zip(self.joints, self.effects, strict=True)
        ])  # fmt: skip


def simulate_commanded(log: CommandedLog, joints: Mapping[str, CommandedJoint]) -> FloatArray:
    """Simulate the positions (n, m) of the joints of a log from its commands and loads with estimated parameters."""
    commanded, (theta, delay_s) = _Problem.of([log]).commanded, _parameters(joints, log.joints)
    return commanded.simulate(theta[None], np.array([delay_s]), commanded.steps_per_sample(theta))[:, 0]


def _parameters(fits: Mapping[str, CommandedJoint], joints: Sequence[str]) -> tuple[FloatArray, float]:
    """Return the estimated parameters (m, 12) of joints, and the delay, s."""
    values = [values_by_name(fits[joint].names, fits[joint].values) for joint in joints]
    excess = [{"excess_stiction": row.get("stiction", row["coulomb"]) - row["coulomb"]} for row in values]
    rows = [row | last for row, last in zip(values, excess, strict=True)]
    return np.array([[row.get(name, 0.0) for name in PARAMETERS] for row in rows]), values[0][DELAY]


def _upper_band_edge(log: CommandedLog) -> float:
    """Return the frequency, Hz, below which the rates of all commands have 95 % of their power."""
    power = np.sum(np.abs(np.fft.rfft(np.diff(log.command, axis=0), axis=0)) ** 2, axis=1)
    sums = np.cumsum(power) / max(float(power.sum()), 1e-300)
    return float(np.searchsorted(sums, 0.95)) / len(log.command) * log.rate_hz


def fit_commanded(
    logs: Sequence[CommandedLog], start: Mapping[str, CommandedJoint] | None = None
) -> dict[str, CommandedJoint]:
    """Estimate the parameters of each joint from logs at one rate; raise DataError if the simulation diverges.

    start: estimates from which the search starts; effects are omitted, not added. None: it starts from a regression.
    """
    problem = _Problem.of(logs)
    if start is None:
        problem, theta, delay_s, _ = _omit_insignificant_effects(*_initial_estimate(problem))
    else:
        theta, delay_s = _parameters(start, problem.joints)
        kinds = [sum((row for row in EFFECTS if {*row} & {*start[joint].names}), ()) for joint in problem.joints]
        problem = replace(problem, effects=tuple(kinds))
    return _omit_insignificant_effects(replace(problem, coarseness=1), theta, delay_s)[-1]


def _omit_insignificant_effects(
    problem: _Problem, theta: FloatArray, delay_s: float
) -> tuple[_Problem, FloatArray, float, dict[str, CommandedJoint]]:
    """Minimise the cost, omit the last insignificant effect of each joint, and repeat while one is insignificant.

    Return the problem, theta (m, 12), the delay, s, and the estimates.
    """
    while True:
        theta, delay_s = _minimise(problem, theta, delay_s, MAX_ITERATIONS)
        problem = problem.with_steps(theta)
        fits = _estimates(problem, theta, delay_s)
        effects = tuple(
            _without_insignificant_effect(fits[joint], names, problem.step_s)
            for joint, names in zip(problem.joints, problem.effects, strict=True)
        )
        if effects == problem.effects:
            return problem, theta, delay_s, fits
        problem = replace(problem, effects=effects)
        theta[~problem.is_free] = 0.0


def _without_insignificant_effect(fit: CommandedJoint, names: tuple[str, ...], step_s: float) -> tuple[str, ...]:
    """Return the parameters of all effects but the last insignificant one; step_s: simulation step."""
    effects = [effect for effect in EFFECTS if set(effect) <= set(names)]
    last = next((effect for effect in effects[::-1] if not _is_significant(fit, effect, step_s)), ())
    return tuple(name for name in names if name not in last)


def _is_significant(fit: CommandedJoint, effect: tuple[str, ...], step_s: float) -> bool:
    """Return True if an effect is significant (EFFECT_STDS); step_s: simulation step."""
    if effect == STRIBECK:
        excess_stiction, std = fit.combination({"stiction": 1.0, "coulomb": -1.0})
        return excess_stiction > EFFECT_STDS * std
    least = [step_s if name == "stick_time" else 0.0 for name in effect]
    excess = np.array([max(fit[name] - bound, 0.0) for name, bound in zip(effect, least, strict=True)])
    indices, free = np.array([fit.names.index(name) for name in effect]), excess > 0
    covariance = fit.covariance[np.ix_(indices[free], indices[free])]
    squared_stds = float(excess[free] @ np.linalg.pinv(covariance) @ excess[free])  # Wald's statistic
    stds = min(fit["coulomb"] / max(fit.std("coulomb"), 1e-300), np.sqrt(squared_stds))
    return bool(stds > EFFECT_STDS and not (effect == SOFT and fit["creep"] >= MAX_CREEP))


def _minimise(problem: _Problem, theta: FloatArray, delay_s: float, iterations: int) -> tuple[FloatArray, float]:
    """Minimise the cost by Levenberg-Marquardt steps, the best of DAMPINGS. Return theta (m, 12) and the delay, s."""
    for _ in range(iterations):
        problem = problem.with_steps(theta)
        linearisation = _linearise(problem, theta, delay_s)
        is_at_bound = np.append((theta <= problem.lower_bounds)[problem.is_free], False)
        trials = [_add_step(problem, theta, delay_s, step) for step in linearisation.steps(is_at_bound)]
        costs = _costs(problem, *map(np.array, zip(*trials, strict=True))).sum(axis=1)
        best = int(costs.argmin())
        if not problem.counts @ np.log(linearisation.variance) - costs[best] > TOLERANCE * problem.counts.sum():
            break
        theta, delay_s = trials[best]
    return theta, delay_s


def _scales(problem: _Problem) -> FloatArray:
    """Return typical sizes (m, 12) of the parameters, computed from gains and commands."""
    commanded, columns = problem.commanded, problem.first_columns
    kp, kd, command = commanded.kp[columns], commanded.kd[columns], commanded.command[:, columns]
    torque, one = np.maximum(command.std(axis=0), 1e-3 * kp), np.ones(len(columns))
    inertia, viscous = np.maximum(kd**2 / kp, 1e-9) / 4, np.maximum(kd, 1e-9) / 4
    sticking = (0.01 * one, 0.1 * one, 0.1 / kp, 0.01 * one, torque / 4, 0.1 * problem.speed)
    return np.stack([inertia, viscous, torque / 4, torque / 4, torque, torque, *sticking], axis=1)


def _add_step(problem: _Problem, theta: FloatArray, delay_s: float, step: FloatArray) -> tuple[FloatArray, float]:
    trial, columns = theta.copy(), np.isin(PARAMETERS, ("inertia", "stribeck_velocity"))
    trial[problem.is_free] += step[:-1]
    value = theta[:, columns]  # falls to a quarter at most; a negative inertia only grows
    trial[:, columns] = np.maximum(trial[:, columns], np.where(value > 0, value / 4, value))
    trial = np.clip(trial, problem.lower_bounds, problem.upper_bounds)
    return trial, delay_s + float(np.clip(step[-1], -0.02, 0.02))


def _costs(problem: _Problem, candidates: FloatArray, delays: FloatArray) -> FloatArray:
    """Return the cost (K, m) of each joint, N_i log(mean squared error), of theta (K, m, 12) with delays (K,), s."""
    simulated = problem.simulate(candidates, delays)
    squares = [_mean_squares(problem, problem.errors(simulated, k)) for k in range(len(delays))]
    return np.asarray(problem.counts * np.log(np.nan_to_num(squares, nan=np.inf)))


def _mean_squares(problem: _Problem, errors: Sequence[FloatArray]) -> FloatArray:
    with np.errstate(over="ignore"):  # a candidate may diverge
        squares = np.concatenate([np.sum(error**2, axis=0) for error in errors])
    return np.maximum(np.bincount(problem.index, squares) / problem.counts, 1e-20)  # joints at rest have no errors


@dataclass(frozen=True)
class _Linearisation:
    """Linearised problem: normal matrix (n_x, n_x), mean squared error of each joint (m,), scores.

    scores: negative gradient of half the weighted squared error at each instant of each log (n_k, n_x).
    """

    normal: FloatArray
    variance: FloatArray
    scores: tuple[FloatArray, ...]

    def steps(self, is_at_bound: BoolArray) -> FloatArray:
        """Return the Levenberg-Marquardt step (n_x,) of each of DAMPINGS; parameters at their lower bound only grow."""
        gradient = sum(score.sum(axis=0) for score in self.scores)
        is_free = ~is_at_bound | (gradient > 0)
        eigenvalues, vectors = _eigensystem(self.normal[np.ix_(is_free, is_free)])
        slope = vectors.T @ gradient[is_free] * (eigenvalues > MIN_CURVATURE)
        steps = np.zeros((len(DAMPINGS), len(is_free)))
        steps[:, is_free] = (slope / (np.maximum(eigenvalues, MIN_CURVATURE) + DAMPINGS[:, None])) @ vectors.T
        return steps

    def inverses(self) -> tuple[FloatArray, FloatArray]:
        """Return the pseudo-inverse (n_x, n_x) of the normal matrix, and a large covariance in its null space.

        The null space contains unidentifiable combinations, for example F_c - o if the joint never reverses.
        """
        eigenvalues, vectors = _eigensystem(self.normal)
        curvatures = np.maximum(eigenvalues, MIN_CURVATURE)
        vectors = vectors / np.sqrt(curvatures)
        null_vectors = vectors * (eigenvalues < curvatures)
        return (vectors - null_vectors) @ vectors.T, null_vectors @ null_vectors.T


def _eigensystem(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues of a normal matrix with a unit diagonal, and eigenvectors in the units of parameters."""
    squares = np.diag(normal)
    size = np.sqrt(np.where(squares > 1e-40 * squares.max(), squares, 1.0))  # 1: parameters without effect
    eigenvalues, vectors = np.linalg.eigh(normal / np.outer(size, size))
    return eigenvalues, vectors / size[:, None]


def _linearise(problem: _Problem, theta: FloatArray, delay_s: float) -> _Linearisation:
    is_free, scales = problem.is_free, PERTURBATION * _scales(problem)
    free_columns = np.flatnonzero(is_free.any(axis=0))
    candidates = np.stack([theta, *(theta + np.eye(len(PARAMETERS))[free_columns, None] * scales), theta])
    delays = np.full(len(candidates), delay_s)
    delays[-1] += DELAY_STEP_S
    simulated = problem.simulate(candidates, delays)
    errors = problem.errors(simulated)
    variance, n_x = _mean_squares(problem, errors), int(is_free.sum()) + 1
    if not np.all(np.isfinite(variance)):
        text = "simulation from the commands diverges. Check gains and units of the commands"
        raise DataError("friction/motion", text, problem.logs[0].name)
    indices = np.full(is_free.shape, -1)
    indices[is_free] = np.arange(n_x - 1)
    normal, scores = np.zeros((n_x, n_x)), [np.zeros((len(error), n_x)) for error in errors]
    for log, sim, error, score in zip(problem.logs, simulated, errors, scores, strict=True):
        for column, joint in enumerate(log.joints):
            i, change = problem.joints.index(joint), sim[:, 1:, column] - sim[:, :1, column]
            free, std = np.flatnonzero(is_free[i]), np.sqrt(variance[i])
            sensitivity = change[:, np.searchsorted(free_columns, free)] / scales[i, free]
            X = np.hstack([sensitivity, change[:, -1:] / DELAY_STEP_S]) / std
            joint_rows = np.append(indices[i, free], n_x - 1)
            normal[np.ix_(joint_rows, joint_rows)] += X.T @ X
            score[:, joint_rows] += X * (error[:, column] / std)[:, None]
    return _Linearisation(normal, variance, tuple(scores))


def _initial_estimate(problem: _Problem) -> tuple[_Problem, FloatArray, float]:
    """Return the problem with the best effects of each joint, their start values (m, 12) and the delay, s.

    A regression selects the best of START_DELAYS. Each row of START_EFFECTS adds its effects one after another, with a
    short search after each. Each parameter of an effect costs EFFECT_STDS^2. The delay is that of the least total cost.
    These searches use the first logs, as many as contain all joints.
    """
    logs = problem.logs
    n = max(next(k for k, log in enumerate(logs, start=1) if joint in log.joints) for joint in problem.joints)
    whole, problem = problem, _Problem.of(logs[:n])
    regressions = np.stack([_regress(problem, delay) for delay in START_DELAYS.tolist()])
    problem = replace(problem, coarseness=START_COARSENESS).with_steps(regressions)
    best = int(_costs(problem, regressions, START_DELAYS).sum(axis=1).argmin())
    start = problem, regressions[best], float(START_DELAYS[best])
    optima = [optimum for effects in START_EFFECTS for optimum in accumulate(effects, _add_effect, initial=start)]
    variants, candidates, delays = zip(*optima, strict=True)
    costs = _costs(problem.with_steps(np.array(candidates)), np.array(candidates), np.array(delays))
    costs += EFFECT_STDS**2 * np.array([len(variant.effects[0]) for variant in variants])[:, None]
    choices = costs.argmin(axis=0)
    effects = tuple(variants[k].effects[i] for i, k in enumerate(choices))
    theta = np.array([candidates[k][i] for i, k in enumerate(choices)])
    return replace(whole, effects=effects, coarseness=START_COARSENESS), theta, delays[costs.sum(axis=1).argmin()]


def _add_effect(
    optimum: tuple[_Problem, FloatArray, float], effect: tuple[tuple[str, ...], tuple[float, ...]]
) -> tuple[_Problem, FloatArray, float]:
    """Add an effect to all joints, with typical start values, and search its optimum briefly."""
    problem, theta, delay_s = optimum
    (names, values), start, speed = effect, theta.copy(), problem.speed
    torque = np.maximum(theta[:, 2], _scales(problem)[:, 2] / 100)
    start_scales = {"bristle_compliance": speed / torque, "excess_stiction": torque, "stribeck_velocity": speed}
    for name, value in zip(names, values, strict=True):
        start[:, PARAMETERS.index(name)] = value * start_scales.get(name, 1.0)
    problem = replace(problem, effects=tuple(effects + names for effects in problem.effects))
    return problem, *_minimise(problem, start, delay_s, START_ITERATIONS)


def smoothed_motion(position: FloatArray, rate_hz: float) -> tuple[list[FloatArray], int]:
    """Return positions (n, m), velocities and accelerations, smoothed by cubics; also the window, samples."""
    width = 2 * max(2, round(SMOOTH_S * rate_hz / 2)) + 1
    return [savgol_filter(position, width, 3, deriv=order, delta=1 / rate_hz, axis=0) for order in range(3)], width


def _regress(problem: _Problem, delay_s: float) -> FloatArray:
    """Return start values (m, 12) by regression on the controller's torque, with commands delayed by delay_s."""
    scales, rows = _scales(problem), dict[str, list[tuple[FloatArray, FloatArray]]]()
    for log in problem.logs:
        n, (q, v, a), width = len(log.position), *smoothed_motion(log.position, log.rate_hz)
        delayed = np.arange(n) - delay_s * log.rate_hz - 0.5  # mean delay of a zero-order hold
        for i, joint in enumerate(log.joints):
            torque = np.interp(delayed, np.arange(n), log.command[:, i]) - log.kp[i] * q[:, i] - log.kd[i] * v[:, i]
            gravity = [np.cos(q[:, i]), np.sin(q[:, i])] if log.has_gravity[i] else []
            columns = [a[:, i], v[:, i], np.sign(v[:, i]), np.ones(n), *gravity]
            used = slice(width, n - width)
            load = log.load[:, i] + (log.coupled_inertia[i] + log.delay_inertia[i]) * a[:, i]
            rows.setdefault(joint, []).append((np.stack(columns, 1)[used], (torque - load)[used]))
    theta = np.zeros((len(problem.joints), len(PARAMETERS)))
    for i, joint in enumerate(problem.joints):
        X, y = (np.concatenate(parts) for parts in zip(*rows[joint], strict=True))
        beta = np.linalg.lstsq(X, y, rcond=1e-8)[0]
        theta[i, : len(beta)] = beta
    coupled = problem.commanded.coupled_inertia[problem.first_columns]
    theta[:, 0] = np.maximum(theta[:, 0], scales[:, 0] / 20 - np.where(coupled > 0, 0.5, 1.0) * coupled)
    theta[:, 1:3] = np.maximum(theta[:, 1:3], 0.0)
    return theta


def _estimates(problem: _Problem, theta: FloatArray, delay_s: float) -> dict[str, CommandedJoint]:
    linearisation, is_free = _linearise(problem, theta, delay_s), problem.is_free
    names = (*((problem.joints[i], PARAMETERS[j]) for i, j in np.argwhere(is_free).tolist()), ("", DELAY))
    values, covariance = np.append(theta[is_free], delay_s), _covariance(linearisation, problem, names)
    fits = dict[str, CommandedJoint]()
    for joint, error in zip(problem.joints, np.sqrt(linearisation.variance).tolist(), strict=True):
        indices = [i for i, (of, _) in enumerate(names) if of in (joint, "")]
        terms, T = [names[i][1] for i in indices], np.eye(len(indices))
        if "excess_stiction" in terms:
            k = terms.index("excess_stiction")
            terms[k], T[k, terms.index("coulomb")] = "stiction", 1.0
        block = T @ covariance[np.ix_(indices, indices)] @ T.T
        fits[joint] = CommandedJoint(tuple(terms), T @ values[indices], block, joint, error, not fits)
    return fits


def _covariance(linearisation: _Linearisation, problem: _Problem, names: Sequence[tuple[str, str]]) -> FloatArray:
    """Return the covariance (n_x, n_x) with the largest variances: over time, over the angle or between logs."""
    inverse, null_space = linearisation.inverses()
    rate_hz = problem.commanded.rate_hz / problem.window
    is_in_log = np.array([[joint in ("", *log.joints) for log in problem.logs] for joint, _ in names])
    m = is_in_log.sum(axis=1).astype(np.float64)  # number of logs of each parameter
    counts = [
        cosine_count(len(score) / rate_hz, int(m[is_in_log[:, k]].min()))
        for k, score in enumerate(linearisation.scores)
    ]
    meat, dofs = sum(map(long_run, linearisation.scores, counts)), is_in_log @ np.array(counts, np.float64)
    covariance = inverse @ meat @ inverse * np.outer(small_sample_factors(dofs), small_sample_factors(dofs))
    variance, scores = np.diag(covariance).copy(), np.vstack(linearisation.scores)
    factor = np.ones(len(covariance))
    for joint in problem.joints:
        indices = [i for i, (of, _) in enumerate(names) if of == joint]
        pairs = zip(problem.logs, problem.measured, strict=True)
        angles = [q[:, log.joints.index(joint)] if joint in log.joints else np.zeros(len(q)) for log, q in pairs]
        factor[indices] = state_widening(inverse, scores, np.concatenate(angles)[:, None], variance, dofs)[indices]
    d, between = np.array([score.sum(axis=0) for score in linearisation.scores]) @ inverse, np.maximum(m - 1, 1)
    ratio = m / between * np.sum(d**2, axis=0) / np.maximum(variance, 1e-300)
    exceeds = (m > 1) & (ratio > np.maximum(fdtri(between, dofs, 1 - SIGNIFICANCE_LEVEL), factor**2))
    factor = np.where(exceeds, np.maximum(np.sqrt(ratio) * small_sample_factors(between), factor), factor)
    return covariance * np.outer(factor, factor) + null_space
