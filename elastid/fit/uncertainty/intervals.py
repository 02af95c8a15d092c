"""Intervals beside those of the covariance, for the parameters and in the way that a study asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.fit.problem.least_squares import LeastSquares
from elastid.fit.result import QUANTILE, FitResult
from elastid.fit.setup.assembly import RelinearisedOptimum
from elastid.fit.spec import FitSpec
from elastid.fit.uncertainty.bootstrap import bootstrap
from elastid.fit.uncertainty.profile import profiles
from elastid.parameters import ParameterSet

# The step h that shows the curvature at the optimum, as a part of the interval: small, but V must rise beyond rounding.
SMALL = 0.1


def bent(problem: LeastSquares, x: FloatArray, variance: FloatArray) -> FloatArray:
    """How much an interval's ends are off for each parameter (n_x,), the larger of |1 - rho|; 0 where none is known.

    variance (n_x,): as the fit states it.
    """
    best = problem.evaluate(x)
    A_inverse = np.linalg.pinv(best.hessian / 2, hermitian=True)
    curvature = np.diag(A_inverse)
    found = np.zeros(len(x))
    lower, upper = problem.parameters.x_bounds
    for i in np.flatnonzero(np.isfinite(variance) & (variance > 0) & (curvature > 0)):
        v = np.sqrt(variance[i]) * A_inverse[:, i] / curvature[i]
        for side in (-QUANTILE, QUANTILE):
            whole, small = (
                problem.evaluate(np.clip(x + step * v, lower, upper)).cost - best.cost for step in (side, SMALL * side)
            )
            if not small > 0 or not np.isfinite(whole):
                found[i] = np.inf
            else:
                found[i] = max(found[i], abs(1 - SMALL * np.sqrt(max(whole, 0.0) / small)))
    return found


# An interval whose end is off by more than this part of it, V not being quadratic, is found by profile likelihood, of
# at most so many parameters: each costs some twenty fits.
BENT = 0.1
MOST = 6
# Repetitions that may fail before the word is said.
FAILED = 0.05


def further_intervals(
    result: FitResult,
    settled: RelinearisedOptimum,
    spec: FitSpec,
    execution: Execution,
) -> FitResult:
    """The result with the profiles and the bootstrap of the study."""
    x, words = settled.end.x, list(result.notes)
    problem, variance = settled.fit.problem, np.diag(result.covariance)
    if spec.profile == "auto":
        names, left = bent_names(problem, x, variance)
        words += _bent_words(names, left)
    else:
        names = profiled_names(spec.profile, result.parameters)
    if names:
        ends = profile_ends(problem, x, variance, names, execution)
        result = replace(result, profile95=_natural(result.parameters, ends))
    if spec.bootstrap:
        kind, weights = spec.bootstrap_kind, settled.weights
        draws = bootstrap(settled.fit, weights, x, spec.bootstrap, kind, spec.seed or 0, execution)
        good = np.isfinite(draws).all(axis=1)
        if np.mean(~good) > FAILED:
            words.append(
                Note(
                    "bootstrap-failures",
                    f"{np.sum(~good)} of {len(draws)} fits of the bootstrap did not converge and are left out",
                )
            )
        ends = np.quantile(draws[good], [0.025, 0.975], axis=0).T if good.any() else np.full((len(x), 2), np.nan)
        result = replace(result, bootstrap95=_natural(result.parameters, ends))
    return replace(result, notes=tuple(words))


def profile_ends(
    problem: LeastSquares,
    x: FloatArray,
    variance: FloatArray,
    names: Sequence[str],
    execution: Execution | None = None,
) -> FloatArray:
    """Ends (n_x, 2) in x of the intervals of some parameters, NaN of the others; arguments as `profiles`."""
    found = profiles(problem, x, variance, names, execution)
    rows = {profile.name: profile.interval for profile in found}
    return np.array([rows.get(name, (np.nan, np.nan)) for name in problem.parameters.free_names])


def bent_names(problem: LeastSquares, x: FloatArray, variance: FloatArray) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Parameters over whose interval V is not quadratic: the worst MOST of them in their order, and the others."""
    off, free = bent(problem, x, variance), problem.parameters.free_names
    worst = sorted(np.flatnonzero(off > BENT), key=lambda i: -off[i])
    chosen, left = sorted(worst[:MOST]), sorted(worst[MOST:])
    return tuple(free[i] for i in chosen), tuple(free[i] for i in left)


def _bent_words(names: Sequence[str], left: Sequence[str]) -> tuple[Note, ...]:
    if not names:
        return ()
    words = (
        f"{', '.join(names)}: known too roughly for an interval that is symmetric (in the logarithm, of a positive "
        "parameter); the interval is by profile likelihood"
    )
    more = f"; so are {', '.join(left)}, whose interval is symmetric all the same: name them in fit.profile"
    return (Note("profiled-interval", words + (more if left else ""), severity="information"),)


def profiled_names(patterns: Sequence[str], parameters: ParameterSet) -> tuple[str, ...]:
    """The free parameters that names or patterns choose, in their order; StudyError for one that chooses none."""
    free = parameters.free_names
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in free):
            raise StudyError(f"fit.profile: {pattern} is no free parameter; {did_you_mean(pattern, list(free))}")
    return tuple(name for name in free if any(fnmatchcase(name, pattern) for pattern in patterns))


def _natural(parameters: ParameterSet, ends: FloatArray) -> FloatArray:
    """Ends (n_x, 2) in x as SI values."""
    log = np.array([parameter.log for parameter in parameters.free])
    with np.errstate(over="ignore"):
        natural: FloatArray = np.where(log[:, None], np.exp(ends), ends)
    return natural
