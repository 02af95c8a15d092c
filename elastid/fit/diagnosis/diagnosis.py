"""Diagnosis of a fit that ended: its status with a reason, and notes on possible causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.findings import findings, status_and_message
from elastid.fit.diagnosis.held_torque import find_held_torque
from elastid.fit.diagnosis.misfit import describe_misfit
from elastid.fit.diagnosis.misread_channels import (
    find_foreign_configurations,
    find_misread_channels,
    find_wrong_frequency_unit,
)
from elastid.fit.diagnosis.two_robots import find_two_groups
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.problem.residuals import error_gain
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import RelinearisedOptimum
from elastid.fit.uncertainty.covariance import Uncertainty
from elastid.fit.uncertainty.jackknife import is_in_error

# Residuals of a configuration over the median of all beyond which it is unlike the others.
MAX_RESIDUAL_RATIO = 5.0
# Model error beyond which misread channels are searched for; so they are where the noise is unknown and the model
# explains less than this share of the responses.
SUSPECT_MODEL_ERROR = 10.0
SUSPECT_EXPLAINED_SHARE = 0.9


def explained_share(fit: ElasticFit, x: FloatArray, noise_cost: float) -> float:
    """The share of the measured responses that the model at x (n_x,) explains; negative where it is worse than none."""
    left, whole = 0.0, 0.0
    for part in fit.parts:
        weight = part.gain * np.abs(error_gain(part.criterion, part.measured))
        used = part.gain > 0
        error = np.where(used, weight * (part.measured - part.kernel.response(fit.theta(part, x))), 0.0)
        left += float(np.sum(np.abs(error) ** 2))
        whole += float(np.sum(np.abs(np.where(used, weight * part.measured, 0.0)) ** 2))
    return 1 - max(left - noise_cost, 0.0) / max(whole - noise_cost, 1e-300)


def find_unlike_configurations(fit: ElasticFit, x: FloatArray) -> tuple[Note, ...]:
    """A note on each configuration that the model at x explains far worse than the others."""
    level = {}
    for part in fit.parts:
        if part.n_residuals:
            name = part.configuration
            level[name] = np.sqrt(part.normal.at(fit.theta(part, x))[0] / part.n_residuals)
    if len(level) < 3:
        return ()
    usual = float(np.median(list(level.values())))
    return tuple(
        Note(
            "unlike-configuration",
            f"its residuals are {one / usual:.0f} times those of the other configurations; is it of "
            "the same robot, with the same load, at the stated angles?",
            f"configuration {name}",
        )
        for name, one in level.items()
        if one > MAX_RESIDUAL_RATIO * usual
    )


def with_status(
    result: FitResult, optimum: RelinearisedOptimum, uncertainty: Uncertainty, misread: bool = False
) -> FitResult:
    """The result with how it ended; misread: whether another reading of the responses fits far better."""
    known = _noise_is_known(optimum)
    share = _share(result, optimum)
    misfit = describe_misfit(result, uncertainty)
    status, message = status_and_message(result, optimum.end, uncertainty.unreached, share, known, misread, misfit)
    return replace(result, status=status, message=message)


def diagnose(
    result: FitResult,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    notes: tuple[Note, ...],
    robots: Mapping[str, Sequence[str]],
) -> FitResult:
    """The same with notes: misread channels, a held torque and foreign configurations first, which takes further fits.

    notes: of the data and the search.  robots: of fit.robots.
    """
    fit, end = optimum.fit, optimum.end
    suspect = _is_suspect(result, optimum)
    misread = find_misread_channels(fit, end.x, end.cost) if suspect else ()
    apart = find_unlike_configurations(fit, end.x) if result.model_error > 1 else ()
    in_error = is_in_error(result.cost, result.cost_expected, result.dof)
    held = find_held_torque(fit, end.x, end.cost, result.cost_expected) if in_error and not misread else ()
    if not apart and not misread and in_error:
        apart = find_two_groups(fit, end.x, end.cost, result.cost_expected, robots)
    apart = apart or (find_foreign_configurations(fit, end.x) if suspect and not misread else ())
    found = (*find_border_inertias(fit.inertias, fit.parameters, end.x), *findings(result, uncertainty.unreached))
    words = (*misread, *held, *find_wrong_frequency_unit(result), *apart, *notes, *found)
    return replace(with_status(result, optimum, uncertainty, bool(misread)), notes=words)


def _is_suspect(result: FitResult, optimum: RelinearisedOptimum) -> bool:
    """Whether the residuals are so large that responses may have been misread."""
    if _noise_is_known(optimum):
        return result.model_error > SUSPECT_MODEL_ERROR
    return _share(result, optimum) < SUSPECT_EXPLAINED_SHARE


def _share(result: FitResult, optimum: RelinearisedOptimum) -> float:
    """The share of the measured responses that the model explains, known noise aside."""
    # Where no noise was measured, the residuals are its only estimate, and it does not excuse them.
    noise_cost = result.cost_expected if _noise_is_known(optimum) else 0.0
    return explained_share(optimum.fit, optimum.end.x, noise_cost)


def _noise_is_known(optimum: RelinearisedOptimum) -> bool:
    return any(weights.noise is not None for weights in optimum.weights)
