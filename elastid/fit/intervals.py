r"""Intervals beyond the covariance: profile likelihood and bootstrap.

The profile likelihood is V against one parameter, minimised over all others:

.. math:: V_p(x_i) = \min_{x_j, j \ne i} V(x), \qquad
          \{x_i : V_p(x_i) - V(\hat x) \le 1.96^2 c_i\}, \quad c_i = \mathrm{var}\, x_i / (A^{-1})_{ii}

An interval of 95 % that need not be symmetric in x, and is one-sided where the data only bound a parameter. c_i scales
to the stated variance, which holds correlated elements, model error and the floor as well as the curvature of V.
(Raue et al., Bioinformatics 25, 2009, 1923.)

sqrt(V_p - V) is nearly linear in x_i: Brent's method takes a few points to each end, and each point, begun from the one
before along the direction in which the others follow at the optimum, a few evaluations.

The bootstrap repeats the fit on data that are drawn again about its optimum:

.. math:: \hat G^{(b)} = G(\hat\theta) + e^{(b)}

e is drawn from the measured covariance, or where none is known from the weights (Efron and Tibshirani, An Introduction
to the Bootstrap, 1993, 6.5). Numbers of the robot's file are drawn within their tolerances, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import FitError, Note, StudyError, did_you_mean
from elastid.base.execution import Execution
from elastid.base.names import is_match, matching
from elastid.base.statistics import QUANTILE_95
from elastid.fit.frf_problem import RelinearisedOptimum
from elastid.fit.problem.frf_residuals import ElasticFit, Part
from elastid.fit.problem.least_squares import LeastSquares, LocalOptimum
from elastid.fit.problem.weights import Weights, vec
from elastid.fit.result import Result
from elastid.fit.solve.solvers import FINE, ROUGH, solve, trust_region
from elastid.fit.spec import FitSpec
from elastid.parameters import Parameter, Parameters


def bootstrap(
    fit: ElasticFit, weights: Sequence[Weights], x: FloatArray, repetitions: int, seed: int = 0,
    execution: Execution | None = None,
) -> FloatArray:  # fmt: skip
    """Return estimates (repetitions, n_x) from data drawn about the optimum x (n_x,); NaN rows where a fit failed.

    Each repetition has its own random numbers, so that the result does not depend on the execution.
    """
    draws = np.random.SeedSequence(seed).spawn(repetitions)
    pairs = zip(fit.parts, weights, strict=True)
    sources = tuple(_source(part, weight, part.theta(fit.parameters, x)) for part, weight in pairs)
    static = None if fit.loads is None else fit.loads.predicted(fit.parameters, x)[0]
    names = [f"bootstrap-{i}" for i in range(repetitions)]
    ends = (execution or Execution()).resumed(partial(_repeat, fit, sources, static, x), draws, names)
    return np.array([end.x if end.converged else np.full(len(x), np.nan) for end in ends])


def _repeat(
    fit: ElasticFit, sources: "tuple[_Source, ...]", static: FloatArray | None, x: FloatArray,
    draw: np.random.SeedSequence,
) -> LocalOptimum:  # fmt: skip
    rng = np.random.default_rng(draw)
    samples = (source.draw(rng) for source in sources)
    parts = tuple(replace(part, measured=G) for part, G in zip(fit.parts, samples, strict=True))
    pairs = zip(fit.parameters.free, x, strict=True)
    draws = {p.name: _off_file(p, float(xi), rng) for p, xi in pairs if p.is_nuisance}
    parameters = Parameters(tuple(draws.get(p.name, p) for p in fit.parameters)) if draws else fit.parameters
    loads = fit.loads if fit.loads is None or static is None else fit.loads.drawn(static, rng)
    try:
        return solve(replace(fit, parts=parts, parameters=parameters, loads=loads).problem, x, FINE)
    except FitError as error:
        return LocalOptimum(x, x, math.inf, 0, False, str(error))


def _off_file(parameter: Parameter, x: float, rng: np.random.Generator) -> Parameter:
    """Draw another prior mean of a number of the robot model about the optimum x, with its tolerance as std."""
    if parameter.prior is None:
        return parameter
    mean = x + parameter.prior.std * float(rng.standard_normal())
    return replace(parameter, prior=replace(parameter.prior, mean=math.exp(mean) if parameter.log else mean))


@dataclass(frozen=True)
class _Source:
    """The distribution of a measured response: the model's G (F, n_y, n_u), and errors root z, row by row, of white z.

    root (F, m, m).  used: elements that the fit sees.
    """

    G: ComplexArray
    root: ComplexArray
    used: BoolArray

    def draw(self, rng: np.random.Generator) -> ComplexArray:
        """Return a measured response drawn at random."""
        F, m = self.root.shape[:2]
        z = (rng.standard_normal((F, m)) + 1j * rng.standard_normal((F, m))) / np.sqrt(2)
        return np.where(self.used, self.G + (self.root @ z[:, :, None])[:, :, 0].reshape(self.G.shape), self.G)


def _source(part: Part, weights: Weights, theta: FloatArray) -> _Source:
    G, is_used = part.kernel.response(theta), part.gain > 0
    C = weights.noise_covariance()
    F, n_y, n_u = G.shape
    if C is None:
        root = np.where(is_used, weights.sigma, 0.0).reshape(F, -1)[:, :, None] * np.eye(n_y * n_u)
    else:
        row_by_row = vec(np.arange(n_y * n_u).reshape(n_y, n_u)).argsort()
        C = C[:, row_by_row[:, None], row_by_row]
        values, vectors = np.linalg.eigh(C)
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return _Source(G, root.astype(complex), is_used)


MAX_GROWTH = 3.0  # of the distance from the optimum, from one point to the next


def profile_likelihood(
    problem: LeastSquares, x: FloatArray, variance: FloatArray, names: Sequence[str], execution: Execution | None = None
) -> FloatArray:
    """Return the ends (n_x, 2) in x of the intervals about the optimum x (n_x,); NaN for the other parameters.

    variance (n_x,): as the fit states it.
    """
    best = problem.evaluate(x)
    A_inverse = np.asarray(np.linalg.pinv(best.hessian / 2, hermitian=True))
    indices, ends = [problem.parameters.free_names.index(name) for name in names], np.full((len(x), 2), np.nan)
    work = partial(_profile, problem, x, best.cost, A_inverse, variance)
    ends[indices] = np.reshape((execution or Execution()).ordered(work, indices), (-1, 2))
    return ends


def _profile(
    problem: LeastSquares, x: FloatArray, min_cost: float, A_inverse: FloatArray, variance: FloatArray, index: int
) -> tuple[float, float]:
    """Return both ends in x of the interval of one parameter, infinite if unbounded by the data; min_cost: V at x."""
    curvature = max(float(A_inverse[index, index]), 1e-300)
    variance_of_x = float(variance[index]) if 0 < variance[index] < math.inf else curvature
    tangent, threshold = A_inverse[:, index] / curvature, QUANTILE_95 * math.sqrt(variance_of_x / curvature)
    radius, end = QUANTILE_95 * math.sqrt(variance_of_x), partial(_end, problem, x, min_cost, tangent, threshold, index)
    return end(-radius), end(radius)


def _end(
    problem: LeastSquares, x: FloatArray, least: float, tangent: FloatArray, threshold: float, index: int, radius: float
) -> float:
    """Return the end where sqrt(V_p - V) crosses `threshold`, searched from x + reach; infinite if a bound is first."""
    from scipy.optimize import brentq  # slow to load, and seldom needed

    bounds, last = problem.parameters.x_bounds, x
    side, limit = math.copysign(1.0, radius), float(bounds[int(radius > 0)][index] - x[index])

    excess_at = {0.0: -threshold}

    def excess(distance: float) -> float:
        nonlocal last
        if distance in excess_at:
            return excess_at[distance]
        begin = np.clip(last + (x[index] + distance - last[index]) * tangent, *bounds)
        begin[index] = x[index] + distance
        beginning = problem.evaluate(begin)
        if not math.isfinite(beginning.cost):  # no model there
            return threshold
        end = trust_region(problem, begin, beginning, ROUGH, 60, np.arange(len(x)) == index)
        last = end.x
        excess_at[distance] = math.sqrt(max(0.0, end.evaluation.cost - least)) - threshold
        return excess_at[distance]

    far = min(radius, limit, key=abs)
    while excess(far) < 0:
        if far == limit:
            return side * math.inf
        far = min(MAX_GROWTH * far, limit, key=abs)
    return float(x[index]) + float(brentq(excess, 0.0, far, xtol=1e-3 * abs(far)))


# Of ln p, beyond which an end of the symmetric interval errs by a tenth of it where the response is linear in p:
# 1 - t e^t / (e^t - 1), t = 1.96 std.  At most so many are profiled, each with ten to twenty evaluations.
ROUGH_STD, MAX_PROFILES = 0.1, 6


def add_intervals(result: Result, optimum: RelinearisedOptimum, spec: FitSpec, execution: Execution) -> Result:
    """Return the result with the profiles and the bootstrap of the study."""
    x, notes = optimum.end.x, list(result.notes)
    problem, variance = optimum.fit.problem, np.diag(result.covariance)
    if spec.profile == "auto":
        names, skipped_names = choose_profiles(problem.parameters, variance)
        further = f"; intervals of {', '.join(skipped_names)} are symmetric: add these names to fit.profile"
        text = (
            f"{', '.join(names)}: interval by profile likelihood, because the std is above 10 % and the cost is not "
            f"quadratic{further * bool(skipped_names)}"
        )
        notes += [Note("fit/profile", text, severity="information")] if names else []
    else:
        free = result.parameters.free_names
        if unknown := next((key for key in spec.profile if not matching(key, free)), ""):
            text = f"no free parameter is {unknown}; {did_you_mean(unknown, free)}"
            raise StudyError("fit/parameters", text, "fit.profile")
        names = tuple(name for name in free if any(is_match(name, key) for key in spec.profile))
    if names:
        ends = profile_likelihood(problem, x, variance, names, optimum.fit.evaluated_by(execution))
        result = replace(result, profile95=result.parameters.natural(ends.T).T)
    if spec.bootstrap:
        draws = bootstrap(optimum.fit, optimum.weights, x, spec.bootstrap, spec.seed or 0, execution)
        good = np.isfinite(draws).all(axis=1)
        if np.mean(~good) > 0.05:
            text = f"{np.sum(~good)} of {len(draws)} fits of the bootstrap did not converge and are left out"
            notes.append(Note("fit/bootstrap", text))
        ends = np.quantile(draws[good], [0.025, 0.975], axis=0).T if good.any() else np.full((len(x), 2), np.nan)
        result = replace(result, bootstrap95=result.parameters.natural(ends.T).T)
    return replace(result, notes=tuple(notes))


def choose_profiles(parameters: Parameters, variance: FloatArray) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return positive parameters for which a symmetric interval errs: those to profile, and those beyond the limit."""
    std = np.sqrt(variance)
    rough = [i for i, p in enumerate(parameters.of_interest) if p.log and ROUGH_STD < std[i] < math.inf]
    worst = sorted(rough, key=lambda i: -float(std[i]))
    names, skipped_names = sorted(worst[:MAX_PROFILES]), sorted(worst[MAX_PROFILES:])
    return tuple(parameters.free_names[i] for i in names), tuple(parameters.free_names[i] for i in skipped_names)
