"""Further intervals than those of the covariance: profile likelihood and bootstrap, as a study asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.execution import Execution
from elastid.base.names import matching
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.problem.least_squares import LeastSquares
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import RelinearisedOptimum
from elastid.fit.spec import FitSpec
from elastid.fit.uncertainty.bootstrap import bootstrap
from elastid.fit.uncertainty.profile import profiles
from elastid.parameters import ParameterSet

# The error of an interval's end, as a share of the interval, above which it is found by profile likelihood, and for how
# many parameters at most: each costs some ten to twenty evaluations.
MAX_INTERVAL_ERROR = 0.1
MAX_PROFILES = 6
# Share of the repetitions of a bootstrap that may fail without a note.
MAX_FAILED_SHARE = 0.05


def interval_errors(
    problem: LeastSquares, x: FloatArray, variance: FloatArray, execution: Execution | None = None
) -> FloatArray:
    """The error of the ends of each symmetric interval (n_x,) as a share of it, V not being quadratic; 0 without one.

    At an end dx from the optimum a quadratic V has risen by g^T dx / 2, g being its gradient there: the share by which
    it has not, which is b t / a for V = a t^2 / 2 + b t^3.  variance (n_x,): as the fit states it.
    """
    best = problem.evaluate(x)
    A_inverse = np.linalg.pinv(best.hessian / 2, hermitian=True)
    curvature = np.diag(A_inverse)
    known = np.flatnonzero(np.isfinite(variance) & (variance > 0) & (curvature > 0))
    half = [QUANTILE_95 * np.sqrt(variance[i]) * A_inverse[:, i] / curvature[i] for i in known]
    errors = np.zeros(len(x))
    errors[known] = (execution or Execution()).ordered(partial(_error_of_ends, problem, x, best.cost), half)
    return errors


def _error_of_ends(problem: LeastSquares, x: FloatArray, cost: float, half: FloatArray) -> float:
    """Of the interval x -+ half (n_x,), V at x being `cost`."""
    lower, upper, worst = *problem.parameters.x_bounds, 0.0
    for step in (-half, half):
        end = np.clip(x + step, lower, upper)
        ending = problem.evaluate(end)
        rise = ending.cost - cost
        if not (rise > 0 and np.isfinite(rise)):
            return np.inf
        worst = max(worst, abs(1 - 0.5 * float(ending.gradient @ (end - x)) / rise))
    return worst


def add_intervals(
    result: FitResult,
    optimum: RelinearisedOptimum,
    spec: FitSpec,
    execution: Execution,
) -> FitResult:
    """The result with the profiles and the bootstrap of the study."""
    x, notes = optimum.end.x, list(result.notes)
    problem, variance = optimum.fit.problem, np.diag(result.covariance)
    if spec.profile == "auto":
        names, left = choose_profiles(problem, x, variance, execution.quiet)
        notes += _profile_notes(names, left)
    else:
        names = match_names(spec.profile, result.parameters)
    if names:
        ends = profile_ends(problem, x, variance, names, execution)
        result = replace(result, profile95=_natural(result.parameters, ends))
    if spec.bootstrap:
        kind, weights = spec.bootstrap_kind, optimum.weights
        draws = bootstrap(optimum.fit, weights, x, spec.bootstrap, kind, spec.seed or 0, execution)
        good = np.isfinite(draws).all(axis=1)
        if np.mean(~good) > MAX_FAILED_SHARE:
            notes.append(
                Note(
                    "bootstrap-failures",
                    f"{np.sum(~good)} of {len(draws)} fits of the bootstrap did not converge and are left out",
                )
            )
        ends = np.quantile(draws[good], [0.025, 0.975], axis=0).T if good.any() else np.full((len(x), 2), np.nan)
        result = replace(result, bootstrap95=_natural(result.parameters, ends))
    return replace(result, notes=tuple(notes))


def profile_ends(
    problem: LeastSquares,
    x: FloatArray,
    variance: FloatArray,
    names: Sequence[str],
    execution: Execution | None = None,
) -> FloatArray:
    """Ends (n_x, 2) in x of the intervals of some parameters, NaN of the others; arguments as `profiles`."""
    profiled = profiles(problem, x, variance, names, execution)
    rows = {profile.name: profile.interval for profile in profiled}
    return np.array([rows.get(name, (np.nan, np.nan)) for name in problem.parameters.free_names])


def choose_profiles(
    problem: LeastSquares, x: FloatArray, variance: FloatArray, execution: Execution | None = None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Parameters over whose interval V is not quadratic: those to profile, and those beyond the limit."""
    off, free = interval_errors(problem, x, variance, execution), problem.parameters.free_names
    worst = sorted(np.flatnonzero(off > MAX_INTERVAL_ERROR), key=lambda i: -off[i])
    chosen, left = sorted(worst[:MAX_PROFILES]), sorted(worst[MAX_PROFILES:])
    return tuple(free[i] for i in chosen), tuple(free[i] for i in left)


def _profile_notes(names: Sequence[str], left: Sequence[str]) -> tuple[Note, ...]:
    if not names:
        return ()
    text = (
        f"{', '.join(names)}: V is not quadratic over the symmetric interval (in the logarithm, of a positive "
        "parameter); the interval is by profile likelihood"
    )
    more = f"; {', '.join(left)} likewise, but with the symmetric interval: name them in fit.profile" if left else ""
    return (Note("profiled-interval", text + more, severity="information"),)


def match_names(patterns: Sequence[str], parameters: ParameterSet) -> tuple[str, ...]:
    """The free parameters that names or patterns choose, in their order; StudyError for one that chooses none."""
    free = parameters.free_names
    chosen = {pattern: matching(pattern, free) for pattern in patterns}
    for pattern, names in chosen.items():
        if not names:
            raise StudyError(f"fit.profile: {pattern} is no free parameter; {did_you_mean(pattern, list(free))}")
    return tuple(name for name in free if any(name in names for names in chosen.values()))


def _natural(parameters: ParameterSet, ends: FloatArray) -> FloatArray:
    """Ends (n_x, 2) in x as SI values."""
    log = np.array([parameter.log for parameter in parameters.free])
    with np.errstate(over="ignore"):
        return np.where(log[:, None], np.exp(ends), ends)
