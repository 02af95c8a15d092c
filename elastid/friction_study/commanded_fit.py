r"""Inertia, friction and command delay of joints, estimated from commands, encoder positions and gains without torque.

.. math:: \hat\theta = \arg\min_\theta \sum_i N_i \log \sum_k \bigl(q_{ik} - \hat q_{ik}(\theta_i, T_d)\bigr)^2

q hat: positions simulated from the commands alone (`simulation.rigid_joints`), averaged over a few samples; theta_i:
numbers of joint i; T_d: delay of all joints of a log. This is the output-error method (Ljung, System Identification,
1999, section 10.2). A regression on the torque computed from gains and encoder is biased: k_p T_d appears in viscous
friction.

Errors of simulated positions are not white. The covariance is the long-run covariance of each log's scores on slow
cosines (`least_squares.long_run`), over time or in the order of the angle, with which model errors repeat. If the
influences d_k of m logs have a significantly larger covariance, it is used instead:

.. math:: \Sigma = \frac{m}{m - 1} \sum_k d_k d_k^T
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.signal import savgol_filter
from scipy.special import fdtri

from elastid.base.arrays import BoolArray, FloatArray, folded, named
from elastid.base.errors import DataError
from elastid.base.statistics import small_sample_factors
from elastid.friction_study.commanded import DELAY, CommandedJoint, CommandedLog
from elastid.friction_study.least_squares import cosine_count, long_run, state_widening
from elastid.simulation.rigid_joints import NUMBERS, CommandedJoints

# Trial delays, s; the search starts from the best.
START_DELAYS = np.linspace(0.0, 0.04, 9)
# Lowest rate of the averaged positions, and their number in a period at the upper end of the commands' band.
MEANS_HZ, MEANS_IN_PERIOD = 40.0, 12.0
# Time constants k_d / k_p until errors of the initial state have decayed; derivatives are smoothed over SMOOTH_S.
SETTLE, SMOOTH_S = 15.0, 0.06
# Perturbation of a parameter for its sensitivity, relative to its scale, and perturbation of the delay in s.
PERTURBATION, DELAY_STEP_S = 1e-3, 2e-4
START_ITERATIONS, START_COARSENESS, MAX_ITERATIONS, TOLERANCE, LEAST_CURVATURE = 8, 4, 30, 1e-5, 1e-12
DAMPINGS = np.append(0.0, 10.0 ** np.arange(-4, 4))
# How joints stick: the free parameters.  Start values: stick time, s, and creep, or displacement of the bristles before
# sliding over the travel and their damping time, s; the others are 0.
EXACT, SOFT, BRISTLES = (), NUMBERS[6:8], NUMBERS[8:]
START_STICKING = (SOFT, (0.01, 0.1)), (SOFT, (0.02, 0.6)), (BRISTLES, (0.001, 0.001)), (BRISTLES, (0.01, 0.001))
# Factors of the Coulomb friction of the regression, which is low for a joint that mostly sticks.
COULOMB_FACTORS = np.array([1.0, 2.0, 4.0])
# A joint sticks exactly unless its Coulomb friction and its parameters of sticking (stick times beyond one step of the
# simulation) exceed STICKING_STDS standard deviations, and its creep is below its bound.
STICKING_STDS, MAX_CREEP = 5.0, 0.9
SIGNIFICANCE_LEVEL = 0.1  # of a larger scatter between logs than within logs


@dataclass(frozen=True)
class _Problem:
    """Output-error problem of all logs: S columns, one for each joint of each log, padded to the longest log.

    window: samples per mean.  sticking: how each joint sticks.  coarseness: factor of the simulation steps, which are
    `steps` in a sample.
    """

    logs: tuple[CommandedLog, ...]
    joints: tuple[str, ...]
    commanded: CommandedJoints
    window: int
    sticking: tuple[tuple[str, ...], ...]
    coarseness: int = 1
    steps: int = 0

    @classmethod
    def of(cls, logs: Sequence[CommandedLog]) -> "_Problem":
        """Build the problem of several logs."""
        n, joints = max(len(log.position) for log in logs), tuple(dict.fromkeys(j for log in logs for j in log.joints))

        def side_by_side(name: str) -> FloatArray:
            return np.hstack([np.pad(x := getattr(log, name), ((0, n - len(x)), (0, 0)), "edge") for log in logs])

        kp, kd, velocity, carried, late = (
            np.concatenate([getattr(log, name) for log in logs])
            for name in ("kp", "kd", "velocity", "coupled_inertia", "late_inertia")
        )
        position = np.concatenate([log.position[0] for log in logs])
        rate_hz = logs[0].rate_hz
        commanded = CommandedJoints(
            rate_hz, side_by_side("command"), kp, kd, position, velocity, side_by_side("load"), carried + late,
            logs[0].is_zoh
        )  # fmt: skip
        highest = max(_upper_end(log) for log in logs)
        window = max(1, int(rate_hz / max(MEANS_HZ, MEANS_IN_PERIOD * highest)))
        return cls(tuple(logs), joints, commanded, window, (EXACT,) * len(joints))

    def resolved(self, numbers: FloatArray) -> "_Problem":
        """Return the problem with the steps that numbers (..., m, 10) need."""
        return replace(self, steps=max(2, self.commanded.steps(numbers[..., self.index, :]) // self.coarseness))

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

    def simulate(self, numbers: FloatArray, delay_s: FloatArray) -> list[FloatArray]:
        """Simulate averaged positions (n_k, K, m_k) of each log for K candidates: numbers (K, m, 10), delays (K,)."""
        means = self.commanded.simulate(numbers[:, self.index], delay_s, self.steps, self.window)
        ends = np.cumsum([len(log.joints) for log in self.logs])[:-1]
        return [part[self._settled(log)] for log, part in zip(self.logs, np.split(means, ends, axis=2), strict=True)]

    def errors(self, simulations: Sequence[FloatArray], candidate: int = 0) -> list[FloatArray]:
        """Return the measured minus the simulated means (n_k, m_k) of each log for one candidate."""
        return [q - sim[:, candidate] for q, sim in zip(self.measured, simulations, strict=True)]

    @property
    def travel(self) -> FloatArray:
        """Largest standard deviation of the position of each joint (m,) in a log."""
        stds = np.concatenate([log.position.std(axis=0) for log in self.logs])
        return np.array([max(stds[np.array(self.index) == i]) for i in range(len(self.joints))])

    @cached_property
    def measured(self) -> list[FloatArray]:
        """Averaged measured positions (n_k, m_k) of each log."""
        return [folded(log.position, self.window).mean(axis=1)[self._settled(log)] for log in self.logs]

    def _settled(self, log: CommandedLog) -> slice:
        first = min(float(np.max(SETTLE * log.kd / log.kp)) * log.rate_hz, 0.2 * len(log.position))
        return slice(int(first) // self.window, len(log.position) // self.window)

    @cached_property
    def is_free(self) -> BoolArray:
        """Flags (m, 10) of free parameters: gravity if it depends on the angle; parameters of `sticking`."""
        turns = dict(pair for log in self.logs for pair in zip(log.joints, log.has_gravity.tolist(), strict=True))
        return np.array([
            [True] * 4 + [turns[joint]] * 2 + [name in sticking for name in NUMBERS[6:]]
            for joint, sticking in zip(self.joints, self.sticking, strict=True)
        ])  # fmt: skip


def simulate_commanded(log: CommandedLog, joints: Mapping[str, CommandedJoint]) -> FloatArray:
    """Simulate the positions (n, m) of the joints of a log from its commands and loads with estimated parameters."""
    problem = _Problem.of([log])
    values = [named(joints[name].names, joints[name].values) for name in log.joints]
    numbers = np.array([[row.get(name, 0.0) for name in NUMBERS] for row in values])
    steps = problem.commanded.steps(numbers)
    return problem.commanded.simulate(numbers[None], np.array([values[0][DELAY]]), steps)[:, 0]


def _upper_end(log: CommandedLog) -> float:
    """Return the frequency, Hz, below which the rates of all commands have 95 % of their power."""
    power = np.sum(np.abs(np.fft.rfft(np.diff(log.command, axis=0), axis=0)) ** 2, axis=1)
    sums = np.cumsum(power) / max(float(power.sum()), 1e-300)
    return float(np.searchsorted(sums, 0.95)) / len(log.command) * log.rate_hz


def fit_commanded(logs: Sequence[CommandedLog]) -> dict[str, CommandedJoint]:
    """Estimate the parameters of each joint from logs at one rate; raise DataError if the simulation diverges."""
    problem, numbers, delay_s = _start(_Problem.of(logs))
    while True:
        numbers, delay_s = _search(problem, numbers, delay_s, MAX_ITERATIONS)
        problem = problem.resolved(numbers)
        fits = _fit(problem, numbers, delay_s)
        sticking = tuple(
            row if _is_significant(fits[joint], row, problem.step_s) else EXACT
            for joint, row in zip(problem.joints, problem.sticking, strict=True)
        )
        if sticking == problem.sticking:
            return fits
        problem = replace(problem, sticking=sticking)
        numbers[~problem.is_free] = 0.0


def _is_significant(fit: CommandedJoint, sticking: Sequence[str], step_s: float) -> bool:
    """Return True if the Coulomb friction and the parameters of sticking are significant; step_s: simulation step."""
    if not sticking:
        return True
    excess = np.array([max(fit[name] - (step_s if name == "stick_time" else 0.0), 0.0) for name in sticking])
    places = [fit.names.index(name) for name in sticking]
    squared_stds = float(excess @ np.linalg.pinv(fit.covariance[np.ix_(places, places)]) @ excess)  # Wald's statistic
    stds = min(fit["coulomb"] / max(fit.std("coulomb"), 1e-300), np.sqrt(squared_stds))
    return bool(stds > STICKING_STDS and excess[1] < MAX_CREEP)


def _search(problem: _Problem, numbers: FloatArray, delay_s: float, iterations: int) -> tuple[FloatArray, float]:
    """Minimise the cost by Levenberg-Marquardt steps, the best of DAMPINGS. Return numbers (m, 10) and the delay, s."""
    for _ in range(iterations):
        problem = problem.resolved(numbers)
        end = _linearise(problem, numbers, delay_s)
        trials = [_next_numbers(problem, numbers, delay_s, step) for step in end.steps()]
        costs = _log_squares(problem, *map(np.array, zip(*trials, strict=True))).sum(axis=1)
        best = int(costs.argmin())
        if not np.log(end.variance).sum() - costs[best] > TOLERANCE * len(problem.joints):
            break
        numbers, delay_s = trials[best]
    return numbers, delay_s


def _scales(problem: _Problem) -> FloatArray:
    """Return typical sizes (m, 10) of the parameters, computed from gains and commands."""
    commanded, columns = problem.commanded, problem.first_columns
    kp, kd, command = commanded.kp[columns], commanded.kd[columns], commanded.command[:, columns]
    torque, one = np.maximum(command.std(axis=0), 1e-3 * kp), np.ones(len(columns))
    inertia, viscous = np.maximum(kd**2 / kp, 1e-9) / 4, np.maximum(kd, 1e-9) / 4
    sticking = (0.01 * one, 0.1 * one, 0.1 / kp, 0.01 * one)
    return np.stack([inertia, viscous, torque / 4, torque / 4, torque, torque, *sticking], axis=1)


def _next_numbers(
    problem: _Problem, numbers: FloatArray, delay_s: float, step: FloatArray
) -> tuple[FloatArray, float]:  # fmt: skip
    trial = numbers.copy()
    trial[problem.is_free] += step[:-1]
    J = numbers[:, 0]  # at least a quarter of it; a negative inertia only grows
    trial[:, 0] = np.maximum(trial[:, 0], np.where(J > 0, J / 4, J))
    trial[:, [2, 8]] = np.maximum(trial[:, [2, 8]], 0.0)  # Coulomb friction, compliance
    trial[:, [6, 7, 9]] = np.clip(trial[:, [6, 7, 9]], 0.0, [0.5, MAX_CREEP, 0.5])  # stick time, creep, bristle time
    trial[:, 6] = np.maximum(trial[:, 6], problem.is_free[:, 6] * problem.step_s)  # shorter ones have no effect
    return trial, delay_s + float(np.clip(step[-1], -0.02, 0.02))


def _log_squares(problem: _Problem, candidates: FloatArray, delays: FloatArray) -> FloatArray:
    """Return the logarithm (K, m) of each joint's mean squared errors for candidates (K, m, 10) with delays (K,), s."""
    simulated = problem.simulate(candidates, delays)
    squares = [_mean_squares(problem, problem.errors(simulated, k)) for k in range(len(delays))]
    return np.log(np.nan_to_num(squares, nan=np.inf))


def _mean_squares(problem: _Problem, errors: Sequence[FloatArray]) -> FloatArray:
    with np.errstate(over="ignore"):  # a candidate may diverge
        squares = np.concatenate([np.sum(error**2, axis=0) for error in errors])
    counts = np.concatenate([np.full(error.shape[1], len(error)) for error in errors])
    return np.maximum(np.bincount(problem.index, squares) / np.bincount(problem.index, counts), 1e-300)


@dataclass(frozen=True)
class _Linearisation:
    """Linearised problem: normal matrix (n_x, n_x), mean squared error of each joint (m,), scores.

    scores: gradient of the weighted squares at each instant of each log (n_k, n_x).
    """

    normal: FloatArray
    variance: FloatArray
    scores: tuple[FloatArray, ...]

    def _spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Return eigenvalues of the normal matrix with a unit diagonal, and eigenvectors in the units of parameters."""
        size = np.sqrt(np.maximum(np.diag(self.normal), 1e-200))
        eigenvalues, vectors = np.linalg.eigh(self.normal / np.outer(size, size))
        return eigenvalues, vectors / size[:, None]

    def steps(self) -> FloatArray:
        """Return the Levenberg-Marquardt step (n_x,) of each of DAMPINGS."""
        eigenvalues, vectors = self._spectrum()
        least = LEAST_CURVATURE * eigenvalues[-1]
        slope = vectors.T @ sum(score.sum(axis=0) for score in self.scores) * (eigenvalues > least)
        return np.array([vectors @ (slope / (np.maximum(eigenvalues, least) + damping)) for damping in DAMPINGS])

    def inverses(self) -> tuple[FloatArray, FloatArray]:
        """Return the pseudo-inverse (n_x, n_x) of the normal matrix, and a large covariance of its null space.

        The null space has unidentifiable directions, such as F_c - o without reversals.
        """
        eigenvalues, vectors = self._spectrum()
        curvatures = np.maximum(eigenvalues, LEAST_CURVATURE * eigenvalues[-1])
        vectors = vectors / np.sqrt(curvatures)
        hidden = vectors * (eigenvalues < curvatures)
        return (vectors - hidden) @ vectors.T, hidden @ hidden.T


def _linearise(problem: _Problem, numbers: FloatArray, delay_s: float) -> _Linearisation:
    is_free, scales = problem.is_free, PERTURBATION * _scales(problem)
    free_columns = np.flatnonzero(is_free.any(axis=0))
    candidates = np.stack([numbers, *(numbers + np.eye(len(NUMBERS))[free_columns, None] * scales), numbers])
    delays = np.full(len(candidates), delay_s)
    delays[-1] += DELAY_STEP_S
    simulated = problem.simulate(candidates, delays)
    errors = problem.errors(simulated)
    variance, n_x = _mean_squares(problem, errors), int(is_free.sum()) + 1
    places = np.full(is_free.shape, -1)
    places[is_free] = np.arange(n_x - 1)
    normal, scores = np.zeros((n_x, n_x)), [np.zeros((len(error), n_x)) for error in errors]
    for log, sim, error, score in zip(problem.logs, simulated, errors, scores, strict=True):
        for column, joint in enumerate(log.joints):
            i, change = problem.joints.index(joint), sim[:, 1:, column] - sim[:, :1, column]
            free, std = np.flatnonzero(is_free[i]), np.sqrt(variance[i])
            sensitivity = change[:, np.searchsorted(free_columns, free)] / scales[i, free]
            X = np.hstack([sensitivity, change[:, -1:] / DELAY_STEP_S]) / std
            joint_rows = np.append(places[i, free], n_x - 1)
            normal[np.ix_(joint_rows, joint_rows)] += X.T @ X
            score[:, joint_rows] += X * (error[:, column] / std)[:, None]
    return _Linearisation(normal, variance, tuple(scores))


def _start(problem: _Problem) -> tuple[_Problem, FloatArray, float]:
    """Return the problem with the best kind of sticking of each joint, start values (m, 10) and their delay, s.

    A regression at the best of START_DELAYS is followed by a short search from each row of START_STICKING with the best
    of COULOMB_FACTORS.
    """
    regressions = np.stack([_regress(problem, delay) for delay in START_DELAYS.tolist()])
    problem = replace(problem, coarseness=START_COARSENESS).resolved(regressions)
    best = _log_squares(problem, regressions, START_DELAYS).sum(axis=1).argmin()
    delays, ends = START_DELAYS[[best] * len(COULOMB_FACTORS)], []
    for names, values in START_STICKING:
        starts = np.repeat(regressions[[best]], len(delays), axis=0)
        starts[..., 2] *= COULOMB_FACTORS[:, None]
        starts[..., [NUMBERS.index(name) for name in names]] = values
        starts[..., 8] *= problem.travel / np.maximum(starts[..., 2], _scales(problem)[:, 2] / 100)
        start = _best(starts, _log_squares(problem, starts, delays))
        alike = replace(problem, sticking=(names,) * len(problem.joints))
        ends.append(_search(alike, start, float(delays[0]), START_ITERATIONS))
    candidates, delays = map(np.array, zip(*ends, strict=True))
    costs = _log_squares(problem.resolved(candidates), candidates, delays)
    sticking = tuple(START_STICKING[k][0] for k in costs.argmin(axis=0))
    problem = replace(problem, sticking=sticking, coarseness=1)
    return problem, _best(candidates, costs), float(delays[costs.sum(axis=1).argmin()])


def _best(candidates: FloatArray, costs: FloatArray) -> FloatArray:
    """Return the candidate (m, 10) with the least cost (K, m) of each joint."""
    return np.asarray(candidates[costs.argmin(axis=0), np.arange(costs.shape[1])])


def smoothed_motion(position: FloatArray, rate_hz: float) -> tuple[list[FloatArray], int]:
    """Return positions (n, m), velocities and accelerations, smoothed by cubics, and their window, an odd number."""
    width = 2 * max(2, round(SMOOTH_S * rate_hz / 2)) + 1
    return [savgol_filter(position, width, 3, deriv=order, delta=1 / rate_hz, axis=0) for order in range(3)], width


def _regress(problem: _Problem, delay_s: float) -> FloatArray:
    """Return start values (m, 10) by regression on the controller's torque, with commands delayed by delay_s."""
    scales, rows = _scales(problem), dict[str, list[tuple[FloatArray, FloatArray]]]()
    for log in problem.logs:
        n, (q, v, a), width = len(log.position), *smoothed_motion(log.position, log.rate_hz)
        late = np.arange(n) - delay_s * log.rate_hz - 0.5  # mean delay of a zero-order hold
        for i, joint in enumerate(log.joints):
            torque = np.interp(late, np.arange(n), log.command[:, i]) - log.kp[i] * q[:, i] - log.kd[i] * v[:, i]
            gravity = [np.cos(q[:, i]), np.sin(q[:, i])] if log.has_gravity[i] else []
            columns = [a[:, i], v[:, i], np.sign(v[:, i]), np.ones(n), *gravity]
            used = slice(width, n - width)
            load = log.load[:, i] + (log.coupled_inertia[i] + log.late_inertia[i]) * a[:, i]
            rows.setdefault(joint, []).append((np.stack(columns, 1)[used], (torque - load)[used]))
    numbers = np.zeros((len(problem.joints), len(NUMBERS)))
    for i, joint in enumerate(problem.joints):
        X, y = (np.concatenate(parts) for parts in zip(*rows[joint], strict=True))
        beta = np.linalg.lstsq(X, y, rcond=1e-8)[0]
        numbers[i, : len(beta)] = beta
    carried = problem.commanded.coupled_inertia[problem.first_columns]
    numbers[:, 0] = np.maximum(numbers[:, 0], scales[:, 0] / 20 - np.where(carried > 0, 0.5, 1.0) * carried)
    numbers[:, 1:3] = np.maximum(numbers[:, 1:3], 0.0)
    return numbers


def _fit(problem: _Problem, numbers: FloatArray, delay_s: float) -> dict[str, CommandedJoint]:
    end, is_free = _linearise(problem, numbers, delay_s), problem.is_free
    if not np.all(np.isfinite(end.variance)):
        text = "simulation from the commands diverges for all start values. Check gains and units of the commands"
        raise DataError("friction/motion", text, problem.logs[0].name)
    names = (*((problem.joints[i], NUMBERS[j]) for i, j in np.argwhere(is_free).tolist()), ("", DELAY))
    values, covariance = np.append(numbers[is_free], delay_s), _covariance(end, problem, names)
    fits = dict[str, CommandedJoint]()
    for joint, error in zip(problem.joints, np.sqrt(end.variance).tolist(), strict=True):
        places = [i for i, (of, _) in enumerate(names) if of in (joint, "")]
        block, terms = covariance[np.ix_(places, places)], tuple(names[i][1] for i in places)
        fits[joint] = CommandedJoint(terms, values[places], block, joint, error, not fits)
    return fits


def _covariance(end: _Linearisation, problem: _Problem, names: Sequence[tuple[str, str]]) -> FloatArray:
    """Return the covariance (n_x, n_x): the largest over time, in the order of the angle, and between logs."""
    inverse, unknown = end.inverses()
    m, rate_hz = len(end.scores), problem.commanded.rate_hz / problem.window
    counts = [cosine_count(len(score) / rate_hz, m) for score in end.scores]
    meat = sum(long_run(score, count) for score, count in zip(end.scores, counts, strict=True))
    dof = float(sum(counts))
    covariance = inverse @ meat @ inverse * small_sample_factors(dof) ** 2
    variance, dofs, scores = np.diag(covariance).copy(), np.full(len(covariance), dof), np.vstack(end.scores)
    wider = np.ones(len(covariance))
    for joint in problem.joints:
        places = [i for i, (of, _) in enumerate(names) if of == joint]
        angles = [
            q[:, log.joints.index(joint)] if joint in log.joints else np.zeros(len(q))
            for log, q in zip(problem.logs, problem.measured, strict=True)
        ]
        state = np.concatenate(angles)[:, None]
        wider[places] = state_widening(inverse, scores, state, variance, dofs)[places]
    if m > 1:
        d = np.array([score.sum(axis=0) for score in end.scores]) @ inverse
        ratio = m / (m - 1) * np.sum(d**2, axis=0) / np.maximum(variance, 1e-300)
        exceeds = ratio > np.maximum(fdtri(m - 1, dof, 1 - SIGNIFICANCE_LEVEL), wider**2)
        wider = np.where(exceeds, np.maximum(np.sqrt(ratio) * small_sample_factors(m - 1.0), wider), wider)
    return covariance * np.outer(wider, wider) + unknown
