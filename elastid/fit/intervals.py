r"""Intervals beyond the covariance: profile likelihood and bootstrap.

The profile likelihood is V against one parameter, minimised over all others:

.. math:: V_p(x_i) = \min_{x_j, j \ne i} V(x), \qquad
          \{x_i : V_p(x_i) - V(\hat x) \le 1.96^2 c_i\}, \quad c_i = \mathrm{var}\, x_i / (A^{-1})_{ii}

The 95 % interval need not be symmetric in x; it is one-sided if the data only bound a parameter. c_i scales the
curvature of V to the estimated variance, which includes correlated elements and the model error. (Raue et al.,
Bioinformatics 25, 2009, 1923.)

sqrt(V_p - V) is nearly linear in x_i, so Brent's method needs few points for each end. Each point starts from the
previous one, along the direction in which the other parameters follow at the optimum.

The bootstrap repeats the fit with data that are drawn about its optimum:

.. math:: \hat G^{(b)} = G(\hat\theta) + e^{(b)}

e is drawn from the measured covariance, or, if it is unknown, from the weights (Efron and Tibshirani, An Introduction
to the Bootstrap, 1993, 6.5). The prior means of nuisance parameters are drawn within their tolerances.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import FitError, Note, StudyError, did_you_mean
from elastid.base.execution import Execution
from elastid.base.names import is_match, match_names
from elastid.base.statistics import QUANTILE_95
from elastid.fit.frf_problem import RelinearisedOptimum
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals
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
    """Return estimates (repetitions, n_x) from data drawn about the optimum x (n_x,); NaN rows for failed fits.

    Each repetition has its own random numbers; the result does not depend on the execution.
    """
    draws = np.random.SeedSequence(seed).spawn(repetitions)
    pairs = zip(fit.frfs, weights, strict=True)
    sources = tuple(_source(frf, weight, frf.theta(fit.parameters, x)) for frf, weight in pairs)
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
    frfs = tuple(replace(frf, measured=G) for frf, G in zip(fit.frfs, samples, strict=True))
    pairs = zip(fit.parameters.free, x, strict=True)
    draws = {p.name: _redraw_prior_mean(p, float(xi), rng) for p, xi in pairs if p.is_nuisance}
    parameters = Parameters(tuple(draws.get(p.name, p) for p in fit.parameters)) if draws else fit.parameters
    loads = fit.loads if fit.loads is None or static is None else fit.loads.drawn(static, rng)
    try:
        return solve(replace(fit, frfs=frfs, parameters=parameters, loads=loads).problem, x, FINE)
    except FitError as error:
        return LocalOptimum(x, x, math.inf, 0, False, str(error))


def _redraw_prior_mean(parameter: Parameter, x: float, rng: np.random.Generator) -> Parameter:
    """Draw another prior mean of a number of the robot model about the optimum x, with its tolerance as std."""
    if parameter.prior is None:
        return parameter
    mean = x + parameter.prior.std * float(rng.standard_normal())
    return replace(parameter, prior=replace(parameter.prior, mean=math.exp(mean) if parameter.log else mean))


@dataclass(frozen=True)
class _Source:
    """Distribution of a measured response, G + root z with white z (F, m), elements row by row.

    G (F, n_y, n_u): of the model.  root (F, m, m).  is_used: fitted elements.
    """

    G: ComplexArray
    root: ComplexArray
    is_used: BoolArray

    def draw(self, rng: np.random.Generator) -> ComplexArray:
        """Return a measured response drawn at random."""
        F, m = self.root.shape[:2]
        z = (rng.standard_normal((F, m)) + 1j * rng.standard_normal((F, m))) / np.sqrt(2)
        return np.where(self.is_used, self.G + (self.root @ z[:, :, None])[:, :, 0].reshape(self.G.shape), self.G)


def _source(frf: FrfResiduals, weights: Weights, theta: FloatArray) -> _Source:
    G, is_used = frf.kernel.response(theta), frf.gain > 0
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


MAX_GROWTH = 3.0  # ratio of the distances of successive points from the optimum


def profile_likelihood(
    problem: LeastSquares, x: FloatArray, variance: FloatArray, names: Sequence[str], execution: Execution | None = None
) -> FloatArray:
    """Return the ends (n_x, 2) in x of the profile intervals of `names`; NaN for other parameters.

    x (n_x,): optimum.  variance (n_x,): estimated variances of x.
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
    """Return the end where sqrt(V_p - V) crosses `threshold`, searched from x + radius; infinite beyond a bound."""
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
        if not math.isfinite(beginning.cost):  # no equilibrium there
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


# Std of ln p above which an end of the symmetric interval errs by a tenth, for a response that is linear in p:
# 1 - t e^t / (e^t - 1), t = 1.96 std.  Largest number of profiles, each of ten to twenty evaluations.
ROUGH_STD, MAX_PROFILES = 0.1, 6


def add_intervals(result: Result, optimum: RelinearisedOptimum, spec: FitSpec, execution: Execution) -> Result:
    """Return the result with profile and bootstrap intervals as the study requests them."""
    x, notes = optimum.x, list(result.notes)
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
        if unknown := next((key for key in spec.profile if not match_names(key, free)), ""):
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
    """Return positive parameters with an inaccurate symmetric interval: up to MAX_PROFILES, and the rest."""
    std = np.sqrt(variance)
    rough = [i for i, p in enumerate(parameters.of_interest) if p.log and ROUGH_STD < std[i] < math.inf]
    worst = sorted(rough, key=lambda i: -float(std[i]))
    names, skipped_names = sorted(worst[:MAX_PROFILES]), sorted(worst[MAX_PROFILES:])
    return tuple(parameters.free_names[i] for i in names), tuple(parameters.free_names[i] for i in skipped_names)
