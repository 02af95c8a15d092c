"""Diagnosis of a fit that ended: its status with a reason, and notes on possible causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.fit.diagnosis.findings import findings, status_and_message
from elastid.fit.diagnosis.frequency_unit import find_wrong_frequency_unit
from elastid.fit.diagnosis.misfit import describe_misfit, telling_index
from elastid.fit.diagnosis.modification.indices import held_indices, modification_indices
from elastid.fit.diagnosis.modification.scores import Scores, score
from elastid.fit.diagnosis.modification.sentences import MISREAD, explanations
from elastid.fit.diagnosis.two_robots import costs_alone, find_two_groups
from elastid.fit.diagnosis.unlike_configurations import find_foreign_configurations, find_unlike_configurations
from elastid.fit.diagnosis.unseen_errors import find_unseen_errors
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.problem.residuals import error_gain
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum
from elastid.fit.uncertainty.covariance import Uncertainty

# Model error beyond which foreign configurations are searched for, and responses that were read wrongly are not the
# robot's; where the noise is unknown, the share of the responses that the model explains below which they are.
SUSPECT_MODEL_ERROR = 10.0
SUSPECT_EXPLAINED_SHARE = 0.9
# Of the excess of V: where one number or reading explains more, no configurations are looked for that differ.
MAX_EXPLAINED_SHARE = 0.8


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


def score_held(
    assembly: Assembly, optimum: RelinearisedOptimum, result: FitResult, execution: Execution
) -> Scores | None:
    """The test of everything that the fit held; None where no noise is known and the responses are not suspect."""
    noise_cost = result.cost_expected if _noise_is_known(optimum) else 0.0
    if noise_cost == 0 and not result.exceeds_noise and not _is_suspect(result, optimum):
        return None
    return score(assembly, optimum, result, noise_cost, execution)


def judge(
    result: FitResult,
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    scores: Scores | None,
) -> FitResult:
    """The result with how it ended, and with modification indices where they bear on it."""
    known, share = _noise_is_known(optimum), _share(result, optimum)
    if scores is not None:
        result = replace(result, indices=_indices(result, assembly, optimum, uncertainty, scores))
    misread = _is_suspect(result, optimum) and any(one.place and one.group in MISREAD for one in result.indices)
    misfit = describe_misfit(result, uncertainty)
    status, message = status_and_message(result, optimum.end, uncertainty.unreached, share, known, misread, misfit)
    return replace(result, status=status, message=message)


def _indices(
    result: FitResult,
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    scores: Scores,
) -> tuple[ModificationIndex, ...]:
    """What the fit held or read wrongly; where V is that of the noise, only what shows the model to be wrong."""
    if result.exceeds_noise or _is_suspect(result, optimum):
        return modification_indices(assembly, optimum, result, scores)
    found = held_indices(assembly, optimum, result, scores)
    return found if telling_index(result, uncertainty, found) is not None else ()


def diagnose(
    result: FitResult,
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    scores: Scores | None,
    notes: tuple[Note, ...],
) -> FitResult:
    """A judged result with notes: why it ended so, foreign configurations, and errors that nothing would show.

    notes: of the data and the search.
    """
    fit, end = optimum.fit, optimum.end
    suspect = _is_suspect(result, optimum)
    explained = next((one.share for one in result.indices), 0.0)
    apart = find_unlike_configurations(fit, end.x) if result.model_error > 1 else ()
    if (result.exceeds_noise or suspect) and not apart and explained < MAX_EXPLAINED_SHARE:
        apart = _parted(result, assembly, optimum, suspect)
    found = (*find_border_inertias(fit.inertias, fit.parameters, end.x), *findings(result, uncertainty.unreached))
    why = explanations(result) if explained > MAX_EXPLAINED_SHARE or not apart else ()
    unseen = find_unseen_errors(result, scores)
    return replace(result, notes=(*find_wrong_frequency_unit(result), *why, *apart, *notes, *found, *unseen))


def _parted(result: FitResult, assembly: Assembly, optimum: RelinearisedOptimum, suspect: bool) -> tuple[Note, ...]:
    """Two groups of configurations, or foreign ones where residuals are suspect."""
    fit, end, found = optimum.fit, optimum.end, tuple[Note, ...]()
    alone = costs_alone(fit, end.x)
    if result.exceeds_noise and alone is not None:
        found = find_two_groups(fit, end.x, alone, end.cost, result.cost_expected, assembly.spec.robots)
    return found or (find_foreign_configurations(fit, end.x, alone) if suspect else ())


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
