"""What a fit that ended says of itself: a status with its reason, and words about what may be wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.findings import findings, status_and_message
from elastid.fit.diagnosis.misread_channels import foreign_words, frequency_words, misread_words
from elastid.fit.diagnosis.two_robots import disagreement
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.inertia_barrier import border_words
from elastid.fit.problem.residuals import error_gain
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import RelinearisedOptimum
from elastid.fit.uncertainty.covariance import Uncertainty
from elastid.fit.uncertainty.jackknife import is_in_error

# A configuration whose residuals are so many times those of the median one is not like the others.
FAR_APART = 5.0


def explained(fit: ElasticFit, x: FloatArray, noise_cost: float) -> float:
    """The share of the measured responses that the model at x (n_x,) explains; negative where it is worse than none."""
    left, whole = 0.0, 0.0
    for part in fit.parts:
        weight = part.gain * np.abs(error_gain(part.criterion, part.measured))
        used = part.gain > 0
        error = np.where(used, weight * (part.measured - part.kernel.response(fit.theta(part, x))), 0.0)
        left += float(np.sum(np.abs(error) ** 2))
        whole += float(np.sum(np.abs(np.where(used, weight * part.measured, 0.0)) ** 2))
    return 1 - max(left - noise_cost, 0.0) / max(whole - noise_cost, 1e-300)


def apart_words(fit: ElasticFit, x: FloatArray) -> tuple[Note, ...]:
    """A word about each configuration that the model at x explains far worse than the others."""
    level = {}
    for part in fit.parts:
        if part.n_residuals:
            name = part.kernel.model.configuration.name
            level[name] = np.sqrt(part.normal.at(fit.theta(part, x))[0] / part.n_residuals)
    if len(level) < 3:
        return ()
    usual = float(np.median(list(level.values())))
    return tuple(
        Note(
            "unlike-configuration",
            f"its residuals are {one / usual:.0f} times those of the other configurations; is it of "
            "the same robot, with the same load, at the angles that it claims?",
            f"configuration {name}",
        )
        for name, one in level.items()
        if one > FAR_APART * usual
    )


# Residuals so many times what the noise explains make one look for channels that were misread.
FAR_BEYOND_NOISE = 10.0
# So does a model that explains less than this share of responses whose noise is unknown.
FAIRLY_EXPLAINED = 0.9


def with_status(
    result: FitResult, optimum: RelinearisedOptimum, uncertainty: Uncertainty, misread: bool = False
) -> FitResult:
    """The result with how it ended; misread: whether another reading of the responses fits far better."""
    known = _noise_is_known(optimum)
    status, message = status_and_message(
        result, optimum.end, uncertainty.unreached, _share(result, optimum), known, misread
    )
    return replace(result, status=status, message=message)


def diagnose(
    result: FitResult,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    notes: tuple[Note, ...],
    robots: Mapping[str, Sequence[str]],
) -> FitResult:
    """The same, and warnings: what was misread or is of another robot first, for which it is fitted again in part.

    notes: known already.  robots: of fit.robots.
    """
    fit, end = optimum.fit, optimum.end
    suspect = _is_suspect(result, optimum)
    misread = misread_words(fit, end.x, end.cost) if suspect else ()
    apart = apart_words(fit, end.x) if result.model_error > 1 else ()
    if not apart and not misread and is_in_error(result.cost, result.cost_expected, result.dof):
        apart = disagreement(fit, end.x, end.cost, result.cost_expected, robots)
    apart = apart or (foreign_words(fit, end.x) if suspect and not misread else ())
    found = (*border_words(fit.inertias, fit.parameters, end.x), *findings(result, uncertainty.unreached))
    words = (*misread, *frequency_words(result), *apart, *notes, *found)
    return replace(with_status(result, optimum, uncertainty, bool(misread)), notes=words)


def _is_suspect(result: FitResult, optimum: RelinearisedOptimum) -> bool:
    """Whether the residuals are so large that one asks how the responses were read."""
    if _noise_is_known(optimum):
        return result.model_error > FAR_BEYOND_NOISE
    return _share(result, optimum) < FAIRLY_EXPLAINED


def _share(result: FitResult, optimum: RelinearisedOptimum) -> float:
    """Of the measured responses that the model explains, known noise aside."""
    # Where no noise was measured, the residuals are the only measure of it, and no excuse for themselves.
    noise_cost = result.cost_expected if _noise_is_known(optimum) else 0.0
    return explained(optimum.fit, optimum.end.x, noise_cost)


def _noise_is_known(optimum: RelinearisedOptimum) -> bool:
    return any(weights.noise is not None for weights in optimum.weights)
