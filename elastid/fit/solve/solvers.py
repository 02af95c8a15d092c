r"""Local solve and multistart of any LeastSquares problem, by a trust-region method or by IPOPT.

.. math:: \min_x V(x) \quad \text{s.t.} \quad x_{lower} \le x \le x_{upper}, \qquad \nabla^2 V \approx 2 J^T J

From start values with errors of 50 % a local solve finds the global optimum in only half of the cases. Each of many
starts is therefore solved with the logarithmic and then with the complex criterion, and the starts that reach the best
cost are counted.

The step is a Gauss-Newton step within a trust region and bounds, from the gradient g and H = 2 J^T J.

.. math:: \min_s g^T s + \tfrac12 s^T H s \quad \text{s.t.} \quad \|s\| \le \Delta, \qquad
          s = -(H + \lambda 1)^{-1} g, \quad \lambda \ge 0: \|s\| = \Delta \text{ or } \lambda = 0

(More, The Levenberg-Marquardt algorithm, 1978; Conn, Gould and Toint, Trust-Region Methods, 2000, 7.3.) A variable that
the step takes to its bound stays there, and the step of the others is computed again. If V falls as predicted, Delta
doubles; otherwise it shrinks to the minimum of a parabola through V, its slope and the new V.

If V has a barrier, the region is also within Dikin's ellipsoid s^T D s < beta^2, in which V is finite. Shortening steps
until V is finite would converge slowly along the border.

.. math:: \|s\|^2 = s^T M s, \qquad M = 1 + (\Delta / \beta)^2 D

An increase s of a logarithmic parameter p gives p (1 + s) instead of p e^s, equal to first order: a response is nearly
linear in a small damping, whose step in ln p would otherwise be too large by orders of magnitude.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg import eigh

from elastid.base.arrays import BoolArray, FloatArray, quotient
from elastid.base.errors import FitError
from elastid.base.execution import Execution
from elastid.fit.problem.least_squares import (
    Ending,
    Evaluation,
    LeastSquares,
    LocalOptimum,
    distance_to_optimum,
    find_active_bounds,
    is_far_from_noise,
)
from elastid.parameters import Parameters

FIRST_RADIUS = np.log(2.0)  # for each variable: a factor of two in all logarithmic parameters
# Ratio of actual to predicted decrease of V below which the radius shrinks, and above which it doubles.
POOR_RATIO = 0.25
GOOD_RATIO = 1 - POOR_RATIO
# Limits of the new radius as a fraction of the step; the lower one if V is not finite.
SHRINK = (0.1, 0.5)
# Fraction of the radius above which a step was limited by it; tolerance of the length of a step.
AT_RADIUS, RADIUS_TOLERANCE = 0.8, 1.05
# Largest step towards a border as a fraction of its distance; largest condition number of a metric.
MAX_BORDER_FRACTION, MAX_CONDITION = 0.7, 1e12
# Smallest predicted decrease as a fraction of V, and smallest radius, above rounding errors.
ROUNDING, MIN_RADIUS = 1e-15, 1e-9
# Far above the noise a search ends if V falls by less than this fraction in so many iterations: Gauss-Newton converges
# slowly for a wrong model, whose exact optimum is not needed.
CREEPING_ITERATIONS, MIN_PROGRESS = 8, 1e-4
CREEPING = "the cost no longer decreases"


def trust_region(
    problem: LeastSquares, x0: FloatArray, beginning: Evaluation, tolerance: float, max_iterations: int,
    fixed: BoolArray | None = None,
) -> Ending:  # fmt: skip
    """Return the optimum that the steps reach from x0 (n_x,) within bounds; beginning: the problem at x0.

    tolerance: distance to the stationary point in standard deviations.  An iteration is one evaluation.
    fixed (n_x,): True for variables that do not change.
    """
    parameters = problem.parameters
    unit, fixed = _units(parameters, x0, beginning), np.zeros(len(x0), dtype=bool) if fixed is None else fixed
    x, current, radius, costs = x0, beginning, FIRST_RADIUS * np.sqrt(len(x0)), [beginning.cost]
    for iteration in range(max_iterations + 1):
        at_bounds = fixed | find_active_bounds(problem, x, current)
        if distance_to_optimum(current, problem.dof, at_bounds) < tolerance:
            return Ending(x, current, "", iteration)
        if iteration == max_iterations:
            break
        is_far = len(costs) > CREEPING_ITERATIONS and is_far_from_noise(current.cost, problem.dof)
        if is_far and costs[-1 - CREEPING_ITERATIONS] - current.cost < MIN_PROGRESS * current.cost:
            return Ending(x, current, CREEPING, iteration)
        gradient, hessian = unit * current.gradient, np.outer(unit, unit) * current.hessian
        border = None if problem.border is None else np.outer(unit, unit) * problem.border(x)
        metric, step, predicted = np.eye(len(x)), np.zeros(len(x)), 0.0
        # A step that takes many variables to their bounds can increase V: a shorter step fixes fewer.
        while not predicted > ROUNDING * current.cost and radius > MIN_RADIUS:
            if border is not None:  # limited so that rounding errors of the metric stay below 1
                weight = min((radius / MAX_BORDER_FRACTION) ** 2, MAX_CONDITION / max(float(np.trace(border)), 1e-300))
                metric = np.eye(len(x)) + weight * border
            step = _bounded_step(gradient, hessian, metric, _distance_to_bounds(parameters, x, unit), at_bounds, radius)
            predicted = -float(gradient @ step + 0.5 * step @ hessian @ step)
            radius *= 1.0 if predicted > ROUNDING * current.cost else SHRINK[0]
        if not predicted > ROUNDING * current.cost:
            return Ending(x, current, "no further decrease", iteration)
        x_new = _clip(parameters, x, unit * step)
        new = problem.evaluate(x_new)
        gain_ratio = (current.cost - new.cost) / predicted if np.isfinite(new.cost) else -np.inf
        length = float(np.sqrt(step @ metric @ step))
        radius = _next_radius(radius, length, gain_ratio, predicted, float(gradient @ step))
        if gain_ratio > 1e-4:
            x, current = x_new, new
        costs.append(current.cost)
    return Ending(x, current, "stopped", max_iterations)


def _units(parameters: Parameters, x: FloatArray, current: Evaluation) -> FloatArray:
    """Return the scale (n_x,) of each variable: 1 for a logarithm, else the typical size of a linear parameter.

    The size is the largest of value, Newton step and standard deviation, and at most the width of the bounds.
    """
    curvature = np.diag(current.hessian)
    newton, deviation = quotient(np.abs(current.gradient), curvature), np.sqrt(quotient(2.0, curvature))
    size = np.maximum(np.abs(x), np.maximum(newton, deviation))
    size[size == 0] = 1.0
    return np.where(parameters.is_log, 1.0, np.minimum(size, -np.subtract(*parameters.x_bounds)))


def _distance_to_bounds(parameters: Parameters, x: FloatArray, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest steps (n_x,) within the bounds, in units; see `_clip`."""
    lower, upper = parameters.x_bounds
    with np.errstate(over="ignore"):
        return (lower - x) / unit, np.where(parameters.is_log, np.expm1(upper - x), (upper - x) / unit)


def _clip(parameters: Parameters, x: FloatArray, step: FloatArray) -> FloatArray:
    """Return x (n_x,) after a step: x + s, or x + ln(1 + s) for an increase of a logarithmic parameter."""
    up = parameters.is_log & (step > 0)
    return np.clip(x + np.where(up, np.log1p(np.where(up, step, 0.0)), step), *parameters.x_bounds)


def _bounded_step(
    gradient: FloatArray, hessian: FloatArray, metric: FloatArray, bounds: tuple[FloatArray, FloatArray],
    at_bounds: BoolArray, radius: float,
) -> FloatArray:  # fmt: skip
    """Return the step (n_x,) within radius and bounds of the free variables."""
    step, free = np.zeros(len(gradient)), ~at_bounds
    while free.any():
        squared_radius = radius**2 - float(step[~free] @ metric[np.ix_(~free, ~free)] @ step[~free])
        if squared_radius <= 0:
            step[free] = 0.0
            break
        slope = gradient[free] + hessian[np.ix_(free, ~free)] @ step[~free]
        among = np.ix_(free, free)
        step[free] = _step_within(slope, hessian[among], metric[among], float(np.sqrt(squared_radius)))
        within = np.clip(step, *bounds)
        beyond = free & (step != within)
        if not beyond.any():
            break
        step[beyond] = within[beyond]
        free &= ~beyond
    return step


def _step_within(gradient: FloatArray, hessian: FloatArray, metric: FloatArray, radius: float) -> FloatArray:
    """Return the step (n,) within the radius, without bounds: lambda by Newton's method on 1 / |s|, from below."""
    values, vectors = eigh(hessian, metric)
    along = vectors.T @ gradient
    damping = max(0.0, -float(values[0])) + 1e-12 * max(float(values[-1]), 1e-300)
    while (length := float(np.linalg.norm(along / (values + damping)))) > RADIUS_TOLERANCE * radius:
        damping += (length / radius - 1) * length**2 / float(np.sum(along**2 / (values + damping) ** 3))
    return np.asarray(-(vectors @ (along / (values + damping))))


def _next_radius(radius: float, length: float, gain_ratio: float, predicted: float, slope: float) -> float:
    """Return the radius after a step of given length.  gain_ratio: actual over predicted decrease of V.  slope: dV."""
    if gain_ratio < POOR_RATIO:
        if not np.isfinite(gain_ratio):
            return SHRINK[0] * length
        return float(np.clip(slope / (2 * (gain_ratio * predicted + slope)), *SHRINK)) * length
    return 2 * radius if gain_ratio > GOOD_RATIO and length > AT_RADIUS * radius else radius


SolverName: TypeAlias = Literal["trust_region", "ipopt"]

# Distance to the stationary point, in standard deviations of the estimate, at which a solve stops: FINE for the
# estimate, ROUGH if another solve continues from there, NEAR if that solve has another criterion or other lines.
FINE, ROUGH, NEAR = 1e-3, 0.1, 3.0


def solve(
    problem: LeastSquares, x0: FloatArray, tolerance: float = FINE, max_iterations: int = 200,
    method: SolverName = "trust_region",
) -> LocalOptimum:  # fmt: skip
    """Return the local optimum that the solver reaches from x0 (n_x,).

    converged: by the distance to the stationary point instead of the status of the solver.
    Raises FitError if the cost is not finite at x0, errors of the problem unchanged, and KeyboardInterrupt for Ctrl-C.
    """
    x0 = np.clip(x0, *problem.parameters.x_bounds)
    beginning = problem.evaluate(x0)
    if not np.isfinite(beginning.cost):
        raise FitError(
            "fit/no-start", f"the cost is not finite at the start {problem.parameters.as_dict(x0)}; move the start"
        )
    if len(x0) == 0:
        return LocalOptimum(x0, x0, beginning.cost, 0, True, "nothing is free")
    solver: Callable[..., Ending] = trust_region
    if method == "ipopt":
        from elastid.fit.solve.ipopt import ipopt  # for few studies

        solver = ipopt
    end = solver(problem, x0, beginning, tolerance, max_iterations)
    off = distance_to_optimum(end.evaluation, problem.dof, find_active_bounds(problem, end.x, end.evaluation))
    outcome = f"{end.status} after {end.iterations} iterations" if end.status else f"{end.iterations} iterations"
    message = f"{outcome}, {off:.1e} standard deviations from the stationary point"
    # A tenth of a standard deviation does not change an interval. CREEPING counts as converged: the model is wrong, not
    # the search.
    return LocalOptimum(x0, end.x, end.evaluation.cost, end.iterations, off < ROUGH or end.status == CREEPING, message)


# A start reached the optimum if its V exceeds the best by less than this fraction of the cost of one std.
MAX_HIT_EXCESS = 0.1
DAMPING_UNITS = ("N*m*s/rad", "N*s/m")  # of frictions, too


def latin_hypercube(parameters: Parameters, starts: int, factor: float, seed: int) -> FloatArray:
    """Return starts (starts, n_x) in x: the nominal one first, then a Latin hypercube, uniform in x, around it.

    Ranges within the bounds: a factor `factor` for logarithmic parameters, factor^2 for dampings and frictions, a tenth
    of the width of the bounds for linear parameters; unbounded linear parameters do not change.
    """
    lower, upper = parameters.x_bounds
    n, n_x = starts - 1, len(parameters.free)
    rng = np.random.default_rng(seed)
    cube = 2 * (np.array([rng.permutation(n) for _ in range(n_x)]).reshape(n_x, n).T + rng.random((n, n_x))) / n - 1
    radius = [
        math.log(factor) * (2 if p.unit in DAMPING_UNITS else 1) if p.log else 0.1 * (p.upper - p.lower)
        for p in parameters.free
    ]
    step = cube * np.where(np.isfinite(radius), radius, 0.0)
    return np.vstack([parameters.x, np.clip(parameters.x + step, lower, upper)])


def multistart(
    problems: Sequence[LeastSquares],
    starts: FloatArray,
    method: SolverName = "trust_region",
    execution: Execution | None = None,
) -> tuple[tuple[LocalOptimum, ...], int]:
    """Return the approximate optima from starts (starts, n_x), best first, and how many reached the best cost.

    The result does not depend on the execution. Raises FitError if every start fails.
    """
    begin, names = partial(_search_from, tuple(problems), method), [f"start-{i}" for i in range(len(starts))]
    ends = (execution or Execution()).resumed(begin, list(starts), names)
    optima = tuple(sorted(ends, key=lambda end: end.cost))
    best = optima[0].cost
    if not np.isfinite(best):
        raise FitError("fit/no-start", f"all {len(ends)} starts failed; the first with: {ends[0].message}")
    # At one standard deviation from its minimum V is larger by max(1, V / dof).
    max_cost = best + MAX_HIT_EXCESS * max(1.0, best / max(problems[-1].dof, 1))
    return optima, sum(end.cost <= max_cost for end in optima)


def _search_from(problems: tuple[LeastSquares, ...], method: SolverName, x_start: FloatArray) -> LocalOptimum:
    x, iterations = x_start, 0
    try:
        for problem in problems:
            end = solve(problem, x, ROUGH if problem is problems[-1] else NEAR, method=method)
            x, iterations = end.x, iterations + end.iterations
    except FitError as error:
        return LocalOptimum(x_start, x, math.inf, iterations, False, str(error))
    return replace(end, x_start=x_start, iterations=iterations)
