r"""Variable projection: friction coefficients f for which G is the same in all realisations.

For each line, with the net torques U_n = U - Phi f and the projector Q that takes their span out of the K experiments,

.. math:: e = (U - G^{-1} Y)\, Q = \Phi Q\, f + noise, \qquad G = Y U_n^H (U_n U_n^H)^{-1}

G is eliminated by variable projection; since it depends on f, the regression is repeated. At lines without excitation,
the torque comes from feedback alone: G is interpolated, and Q = 1. Motors and their coefficients are the same in
all configurations. (Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973; Kaufman, BIT 15, 1975.)

If the torque is logged with a delay, its friction has this delay. If no basis explains the torque, the delay is
estimated that minimises the residual power in other realisations (`torque_delay`).

Basis functions are chosen by cross-validation over realisations. The motors' own motion gives the scale of candidates;
a candidate is compensated only if the prediction improves. Signs tanh(v / D) have speeds D a factor 2 apart. If
friction reverses over a speed between two of them, both together overestimate sliding friction by 0.1 to 0.2 %; two
near their mean reduce this error to a tenth (`refine_basis`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, mean_of_neighbours, quotient
from elastid.nonlinear.friction_basis import BasisFunction, Kind
from elastid.nonlinear.motion import Motion, motion_of
from elastid.nonlinear.spectra import ConfigurationSpectra, compensation_torque
from elastid.record import Record

_BLOCKS = 5  # of lines, which replace realisations where there is one


@dataclass(frozen=True)
class NormalEquations:
    """Sums over lines and configurations for each fold and motor, weighted to residuals of variance 1 about f.

    A fold is a realisation, or a block of lines where there is one realisation.  A (M, n_f, n_f), b (M, n_f): X^H X and
    X^H e.  c (M, n_m): e^H e.  amplitude (C, n_m): of e - X f at a line, the median, which a few lines
    near sharp resonances do not move.  dof_fraction: share of the residuals that the elimination of G leaves.
    """

    A: FloatArray
    b: FloatArray
    c: FloatArray
    amplitude: FloatArray
    dof_fraction: float


def normal_equations(
    data: Sequence[ConfigurationSpectra], coefficients: FloatArray, motor_of: IntArray
) -> NormalEquations:
    """Sum the normal equations about coefficients (n_f,) of basis functions at motors motor_of (n_f,)."""
    n_m, n_f = data[0].U.shape[1], len(coefficients)
    realisations = np.unique(np.concatenate([spectra.realisation for spectra in data]))
    M = len(realisations) if len(realisations) > 1 else _BLOCKS
    A, b, c = np.zeros((M, n_f, n_f)), np.zeros((M, n_f)), np.zeros((M, n_m))
    amplitude, dof_fractions = np.zeros((len(data), n_m)), np.ones(len(data))
    for i, spectra in enumerate(data):
        e_c, X_c, counts = spectra.net(compensation_torque(coefficients, spectra.Phi, motor_of, n_m))
        excited, e_c = spectra.excited[counts], e_c[counts]
        dof_fractions[i] = 1 - n_m / spectra.U.shape[2] * excited.mean() if excited.size else 1.0
        fold = _folds(spectra, len(excited), realisations)
        for motor in range(n_m):
            group = np.flatnonzero(motor_of == motor)
            acting = group[coefficients[group] != 0]
            e, friction = e_c[:, motor], np.tensordot(coefficients[acting], X_c[np.ix_(counts, acting)], axes=(0, 1))
            power = np.mean(np.abs(e - friction) ** 2, axis=1)
            amplitude[i, motor] = np.sqrt(np.median(power)) if power.size else 0.0
            w = np.sqrt(weights(power, excited))[:, None]
            X = (w[:, None] * X_c[np.ix_(counts, group)]).swapaxes(0, 1).reshape(len(group), e.size)
            e = (w * e).ravel()
            for m in range(M):
                rows = np.flatnonzero(fold == m)
                # Real and imaginary parts side by side: X X^T is Re X^* X^T with a quarter of the work.
                e_m, X_m = e[rows].view(np.float64), np.take(X, rows, axis=1).view(np.float64)
                A[m][np.ix_(group, group)] += X_m @ X_m.T
                b[m, group] += X_m @ e_m
                c[m, motor] += float(e_m @ e_m)
    return NormalEquations(A, b, c, amplitude, float(dof_fractions.mean()))


def estimate_coefficients(
    data: Sequence[ConfigurationSpectra], motor_of: IntArray, iterations: int = 4
) -> tuple[FloatArray, NormalEquations]:
    """Estimate coefficients (n_f,) >= 0 of basis functions at motors motor_of (n_f,) by variable projection.

    iterations: each reduces the error of the coefficients by a factor of ten or more.
    """
    coefficients = np.zeros(len(motor_of))
    for _ in range(iterations):
        equations = normal_equations(data, coefficients, motor_of)
        A, pull = equations.A.sum(axis=0), equations.b.sum(axis=0)
        for group in (motor_of == motor for motor in np.unique(motor_of)):  # no sum is of two motors
            coefficients[group] = solve(A[np.ix_(group, group)], pull[group])
    return coefficients, normal_equations(data, coefficients, motor_of)


def solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """Return the f (n,) >= 0 that minimises f^T A f - 2 b^T f."""
    from scipy.optimize import nnls  # slow to load, for records without friction

    if not len(b):
        return b
    if len(b) == 1:
        return np.asarray(np.maximum(b, 0.0) / np.maximum(A[0], 1e-300))
    size = np.sqrt(np.maximum(A.diagonal(), 1e-300))
    power, V = np.linalg.eigh(A / (size[:, None] * size))
    root = np.sqrt(np.maximum(power, 0.0) + 1e-9)  # a small ridge: shapes may be the same in all that was measured
    return np.asarray(nnls(root[:, None] * V.T, V.T @ (b / size) / root)[0] / size)


def inverse(A: FloatArray) -> FloatArray:
    """Return A^-1 (n, n) of a normal matrix of any units; 0 along unidentifiable directions."""
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.asarray(np.linalg.pinv(A / np.outer(size, size), rcond=1e-13, hermitian=True) / np.outer(size, size))


def cross_validated_power(
    A: FloatArray, b: FloatArray, c: FloatArray, solve: Callable[[FloatArray, FloatArray], FloatArray]
) -> float:
    """Return the residual power of each fold of A (M, n, n), b (M, n), c (M,), solved for by all others."""
    cost, total, pull = 0.0, A.sum(axis=0), b.sum(axis=0)
    for m in range(len(A)):
        f = solve(total - A[m], pull - b[m])
        cost += float(c[m] - 2 * b[m] @ f + f @ A[m] @ f)
    return cost


def _folds(data: ConfigurationSpectra, F: int, realisations: IntArray) -> IntArray:
    """Return the fold (F, K) of each residual at the lines that count."""
    K = data.U.shape[2]
    if len(realisations) > 1:
        return np.broadcast_to(np.searchsorted(realisations, data.realisation), (F, K))
    return np.broadcast_to((np.arange(F) * 4 * _BLOCKS // max(F, 1) % _BLOCKS)[:, None], (F, K))


def weights(power: FloatArray, excited: BoolArray) -> FloatArray:
    """Return 1 / power (F,) of the residuals, each over neighbouring lines of the same kind."""
    smooth = np.empty_like(power)
    for kind in (excited, ~excited):
        if kind.any():
            smooth[kind] = mean_of_neighbours(power[kind])
    return np.asarray(1 / np.maximum(smooth, 1e-12 * smooth.max(initial=0.0) + 1e-300))


# Thresholds of the choice of shapes.
# Of what a sign has, the share of a shape's power that is not linear, at least: a sign in a multisine has 0.36 to
# 0.6, beside slow lines of great power, such as those of a carrier, 0.02 and less; a stop longer than the motion 0.
MIN_NONLINEAR_FRACTION = 0.14
MAX_RESIDUAL_FRACTION = 0.5  # of the cross-validated power, up to which friction of a motor is compensated
# Speed over which the sign of a motion seems to turn, over the noise of its velocity: 1.25 of a motor that never
# sticks, whose sign is erf(v / (sqrt(2) sigma)) in the mean.  Calibrated for those that do: 2 makes coefficients right
# in scripts/studies/outside_coverage.py, at rest and on a carrier.
SIGN_BLUR = 2.0
# Of a motor's coefficients with curves or bristles among its shapes, in place of SIGN_ERROR: up to 2.5 % off there.
SHAPE_ERROR = 0.015
# Chance at which friction of one coefficient is said to differ between configurations, of normal coefficients.
DEPENDENCE_BY_CHANCE = 1e-5
# Variance of a response by noise and distortion over that by noise alone, and over that by noise and the arm's own
# swing, medians of its elements, from which on a note warns of distortion that no motor's friction explains.
MIN_UNEXPLAINED = 10.0
# Residual power of an alternative relative to the selected basis functions, below which it is preferred. Alternatives:
# basis functions that begin with a damped element (if damping dominates, a sign is selected first and no element after
# it), and a delay of the torque near 0, for which a linear step must reach this ratio, too.
PREFERRED_POWER = 0.9
SLIGHT = 0.02  # of a power, V or torque: shapes are not known so well that less of it shows a further one
# Of a coefficient, all of a motor as one factor: std of what its shape is not known by, coefficients within 1 %.
# Calibrated, not derived: of signs alone F_c was up to 1 % off on one outside rig where noise says 0.4 %, and up to 0.3
# % on another.
SIGN_ERROR = 4e-3


@dataclass(frozen=True)
class Basis:
    """Shapes with the motor of each (n_f,), and the share (n_m,) of the power that they leave in other realisations."""

    shapes: tuple[BasisFunction, ...]
    motor_of: IntArray
    residual_power_ratio: FloatArray

    @property
    def delay_s(self) -> float:
        """By which the torques are logged later than the motions."""
        return self.shapes[0].delay_s if self.shapes else 0.0


def select_basis(
    data: Sequence[ConfigurationSpectra], candidates: Sequence[BasisFunction], locations: Sequence[str], auto: bool
) -> tuple[Basis, IntArray]:
    """Select basis functions by cross-validation; return them and their indices (n,) among the candidates."""
    motor_of = _motors(candidates, locations)
    equations, groups = estimate_coefficients(data, motor_of)[1], identifiable_basis(data, motor_of)
    choices = [select_motor_basis(equations, i, members, candidates) for i, members in enumerate(groups)]
    choices = [pair if not auto or pair[1] <= MAX_RESIDUAL_FRACTION else (pair[0][:0], 1.0) for pair in choices]
    indices, ratios = np.concatenate([members for members, _ in choices]), np.array([ratio for _, ratio in choices])
    return Basis(tuple(candidates[i] for i in indices), motor_of[indices], ratios), indices


# Of the power that a choice leaves: above, any delay of the torque is looked for, which must leave so much less.
SEARCHED_ABOVE, DELAYED_POWER = 0.05, 0.5
MAX_DELAY_S = 0.025
DELAY_ITERATIONS = 2  # of the coefficients at a delay, whose power has an error of 1e-4


def torque_delay(
    data: Sequence[ConfigurationSpectra], candidates: Sequence[BasisFunction], choice: Basis, locations: Sequence[str]
) -> float:
    """Estimate the delay of the logged torques behind the motions by friction; 0 if it explains them nearly as well.

    By the geometric mean over the motors of the cross-validated residual power.
    """
    if not choice.shapes:
        return 0.0
    is_wide = choice.residual_power_ratio.max(initial=0.0) >= SEARCHED_ABOVE
    if not is_wide and delay_step_power(data, candidates, choice) > PREFERRED_POWER:
        return 0.0
    from scipy.optimize import minimize_scalar

    motor_of = _motors(candidates, locations)
    groups = identifiable_basis(data, motor_of)  # a delay changes no magnitude

    def power(delay_s: float) -> float:
        _, equations = estimate_coefficients(delay_spectra(data, delay_s), motor_of, DELAY_ITERATIONS)
        ratios = [select_motor_basis(equations, i, rows, candidates)[1] for i, rows in enumerate(groups)]
        return float(np.mean(np.log(np.maximum(ratios, 1e-12))))

    step = 1 / (8 * max(float(spectra.freq_hz[spectra.excited].max()) for spectra in data))
    n_steps = math.ceil(MAX_DELAY_S / step) if is_wide else 0
    grid = step * np.arange(-n_steps, n_steps + 1)
    powers = [power(delay) for delay in grid]
    best = float(grid[np.argmin(powers)])
    search = minimize_scalar(power, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-2 * step})
    limit = powers[n_steps] + math.log(DELAYED_POWER if is_wide else PREFERRED_POWER)
    return float(search.x) if search.fun < limit else 0.0


def delay_step_power(data: Sequence[ConfigurationSpectra], candidates: Sequence[BasisFunction], choice: Basis) -> float:
    r"""Return the power that one step from 0 in the delays of the torques leaves in other realisations.

    Relative to the power without delay, geometric mean over motors.  A late friction is
    :math:`\Phi f - j \omega T \Phi f`: one column more for each motor, which cross-validation accepts or not.
    """
    indices, motor_of = [candidates.index(shape) for shape in choice.shapes], choice.motor_of
    motors = np.unique(motor_of)
    data = [replace(spectra, Phi=spectra.Phi[:, indices]) for spectra in data]
    f, _ = estimate_coefficients(data, motor_of)
    to_motors = f * (motors[:, None] == motor_of)
    late = [
        replace(s, Phi=np.concatenate([s.Phi, -2j * np.pi * s.freq_hz[:, None, None] * (to_motors @ s.Phi)], axis=1))
        for s in data
    ]
    equations = normal_equations(late, np.concatenate([f, np.zeros(len(motors))]), np.concatenate([motor_of, motors]))

    powers = []
    for column, motor in enumerate(motors.tolist(), len(f)):
        acting = np.flatnonzero((motor_of == motor) & (f > 0))
        with_column = np.append(acting, column), acting
        powers.append([residual_power(equations, motor, part, lambda A, b: inverse(A) @ b) for part in with_column])
    late_power, power_at_0 = np.array(powers).T
    return float(np.exp(np.mean(np.log(np.maximum(quotient(late_power, power_at_0, 1.0), 1e-12)))))


def delay_spectra(data: Sequence[ConfigurationSpectra], delay_s: float) -> list[ConfigurationSpectra]:
    """Return spectra whose shapes are later by a delay."""
    late = [np.exp(-2j * np.pi * delay_s * spectra.freq_hz)[:, None, None] for spectra in data]
    return [replace(spectra, Phi=factor * spectra.Phi) for spectra, factor in zip(data, late, strict=True)]


def _motors(shapes: Sequence[BasisFunction], locations: Sequence[str]) -> IntArray:
    return np.array([locations.index(shape.place) for shape in shapes], dtype=np.int64)


def identifiable_basis(data: Sequence[ConfigurationSpectra], motor_of: IntArray) -> list[IntArray]:
    """Select the basis functions of each motor that are identifiable from nonlinear distortion, one index array each.

    A function linear in position or velocity is indistinguishable from stiffness or damping and is dropped. The first
    function of a motor is Coulomb friction.
    """
    fraction = np.mean([configuration.nonlinear_fraction() for configuration in data], axis=0)
    members = [np.flatnonzero(motor_of == i) for i in np.unique(motor_of)]
    return [rows[fraction[rows] > MIN_NONLINEAR_FRACTION * fraction[rows[0]]] for rows in members]


# Speeds over which a sign turns, over the RMS speed.
_TURNING = (0.0, *(0.005 * 2**i for i in range(5)))
# Stribeck velocities, over the RMS speed; the fall over larger ones is that of a viscous friction.
_FALLING = tuple(0.1 * 2 ** (i / 2) for i in range(8))
# Over the mean speed of those that were found: F_c is up to 2 % off where the velocity is that of a neighbour.
_NEAR: dict[Kind, tuple[float, ...]] = {"sign": (0.9, 1.1), "stribeck": (0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4)}
# Distances over which a bristle bends, over the median distance between reversals. A much longer one is a spring, which
# is part of the response. Steps of 2 instead of its root leave k up to four times as far off under LuGre.
_BENDING = tuple(0.025 * 2 ** (i / 2) for i in range(15))


def candidate_basis(records: Sequence[Record], signs_alone: bool) -> tuple[BasisFunction, ...]:
    """Return the candidates of every motor: a sign, abrupt or smooth, a Stribeck curve, bristles and their damping."""
    shapes: list[BasisFunction] = []
    for location in records[0].inputs:
        motions = [motion_of(record, location) for record in records]
        speed = math.sqrt(np.mean([motion.speed**2 for motion in motions]))
        shapes += [BasisFunction(location, "sign", fraction * speed) for fraction in _TURNING]
        if signs_alone:
            continue
        shapes += [BasisFunction(location, "stribeck", fraction * speed) for fraction in _FALLING if speed > 0]
        if (swing := median_swing(motions)) > 0:
            kinds: tuple[Kind, ...] = ("stop", "bristle", "stop damping", "bristle damping")
            shapes += [BasisFunction(location, kind, fraction * swing) for kind in kinds for fraction in _BENDING]
    return tuple(shapes)


def median_swing(motions: Sequence[Motion]) -> float:
    """Return the median distance between two reversals, rad (m); 0 without any."""
    swings = np.concatenate([motion.swings for motion in motions])
    return float(np.median(swings)) if swings.size else 0.0


def residual_power(
    equations: NormalEquations,
    motor: int,
    members: IntArray,
    solver: Callable[[FloatArray, FloatArray], FloatArray] = solve,
) -> float:
    """Return the cross-validated residual power of a motor with the basis functions of indices `members`."""
    A, b = equations.A[:, members[:, None], members], equations.b[:, members]
    return cross_validated_power(A, b, equations.c[:, motor], solver)


def greedy(
    larger: Callable[[list[int]], list[list[int]]],
    cost: Callable[[list[int]], float],
    pays: Callable[[float, float, list[int]], bool],
) -> tuple[list[int], float]:
    """Select by forward selection: add the member that pays and lowers the cost most."""
    members: list[int] = []
    best_cost = cost(members)
    while better := [(new_total, sets) for sets in larger(members) if pays(best_cost, new_total := cost(sets), sets)]:
        best_cost, members = min(better)
    return members, best_cost


def is_admissible(shape: BasisFunction, shapes: Sequence[BasisFunction]) -> bool:
    """Return True if a motor with basis functions `shapes` admits a further one.

    One Stribeck curve beside any other function; damping only beside a stop or a bristle.
    """
    kinds = {s.kind for s in shapes}
    if shape.kind == "stribeck":
        return bool(kinds) and "stribeck" not in kinds
    return not shape.is_damping or not kinds.isdisjoint(("stop", "bristle"))


def select_motor_basis(
    equations: NormalEquations, motor: int, candidates: IntArray, shapes: Sequence[BasisFunction]
) -> tuple[IntArray, float]:
    """Select the basis functions of a motor by forward selection, and return their residual power ratio.

    candidates (n,): of all shapes.
    """

    def power(members: list[int]) -> float:
        return residual_power(equations, motor, np.array(members, dtype=np.int64))

    def pays(new_total: float, new_cost: float, _: list[int]) -> bool:
        return new_cost < (1 - SLIGHT) * new_total  # False without residual power

    def larger(members: list[int], firsts: list[list[int]]) -> list[list[int]]:
        member_shapes = [shapes[i] for i in members]
        free_indices = [i for i in indices if i not in members and is_admissible(shapes[i], member_shapes)]
        return firsts if not members else [[*members, i] for i in free_indices]

    total, indices = power([]), candidates.tolist()
    singles = [[i] for i in indices if is_admissible(shapes[i], ())]
    elements = [[i, j] for i in indices for j in indices if shapes[i].element == shapes[j].element]
    pairs = [[i, j] for i, j in elements if shapes[j].is_damping and not shapes[i].is_damping]
    members, cost_of_members = greedy(partial(larger, firsts=singles), power, pays)
    if pairs and (damping := greedy(partial(larger, firsts=pairs), power, pays))[1] < PREFERRED_POWER * cost_of_members:
        members, cost_of_members = damping
    return np.array(sorted(members), dtype=np.int64), cost_of_members / total if total > 0 else 1.0


def residual_power_ratios(equations: NormalEquations, motors: int, motor_of: IntArray) -> FloatArray:
    """Return the cross-validated residual power ratio (n_m,) of the basis functions of each motor."""
    ratios = np.ones(motors)
    for motor in range(motors):
        rows = np.flatnonzero(motor_of == motor)
        if (total := residual_power(equations, motor, rows[:0])) > 0:
            ratios[motor] = residual_power(equations, motor, rows) / total
    return ratios


def refine_basis(choice: Basis, coefficients: FloatArray, motors: Sequence[str], velocity_noise: FloatArray) -> Basis:
    """Refine the choice: signs and Stribeck curves of a motor near the mean speed of the selected ones.

    A sign turns over the square root of D^2 - (c sigma)^2, D being the mean speed that fits and sigma (n_m,) the
    velocity_noise: along a noisy motion friction that jumps seems to turn, and its coefficient in sliding is too large.
    Signs that are far from each other stay.
    """
    shapes: list[BasisFunction] = []
    for motor, noise in zip(motors, velocity_noise.tolist(), strict=True):
        pairs = [
            (shape, f) for shape, f in zip(choice.shapes, coefficients.tolist(), strict=True) if shape.place == motor
        ]
        for kind, near in _NEAR.items():
            members = [(shape.threshold, f) for shape, f in pairs if shape.kind == kind and f > 0]
            gradual = [speed for speed, _ in members if speed > 0]
            if not gradual or max(gradual) > 3 * min(gradual):
                continue
            mean = sum(speed * f for speed, f in members) / sum(f for _, f in members)
            if kind == "sign":
                mean = math.sqrt(max(mean**2 - (SIGN_BLUR * noise) ** 2, 0.0))
            pairs = [(shape, f) for shape, f in pairs if shape.kind != kind]
            pairs += [(BasisFunction(motor, kind, factor * mean), 0.0) for factor in (near if mean else near[:1])]
        shapes += [replace(shape, delay_s=choice.delay_s) for shape, _ in pairs]
    return Basis(tuple(shapes), _motors(shapes, motors), choice.residual_power_ratio)


def basis_error_covariance(choice: Basis, coefficients: FloatArray) -> FloatArray:
    """Return the covariance (n_f, n_f) of coefficients (n_f,) by missing basis functions, one factor per motor."""
    is_smooth = np.array([shape.kind != "sign" for shape in choice.shapes], dtype=np.bool_) & (coefficients > 0)
    error = np.where(np.isin(choice.motor_of, choice.motor_of[is_smooth]), SHAPE_ERROR, SIGN_ERROR) * coefficients
    return np.where(choice.motor_of[:, None] == choice.motor_of, np.outer(error, error), 0.0)
