"""What a fit that ended says of itself: a status with its reason, and words about what may be wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from elastid.fit.assembly import Settled
from elastid.fit.between import is_in_error
from elastid.fit.certainty import Certainty
from elastid.fit.disagreement import disagreement
from elastid.fit.explained import apart_words, explained
from elastid.fit.findings import findings, status_and_message
from elastid.fit.misread import foreign_words, frequency_words, misread_words
from elastid.fit.physical import border_words
from elastid.fit.result import FitResult

# Residuals so many times what the noise explains make one look for channels that were misread.
FAR_BEYOND_NOISE = 10.0
# So does a model that explains less than this share of responses whose noise is unknown.
FAIRLY_EXPLAINED = 0.9


def with_status(result: FitResult, settled: Settled, sure: Certainty, misread: bool = False) -> FitResult:
    """The result with how it ended; misread: whether another reading of the responses fits far better."""
    known = _noise_is_known(settled)
    status, message = status_and_message(result, settled.end, sure.unreached, _share(result, settled), known, misread)
    return replace(result, status=status, message=message)


def diagnosed(
    result: FitResult,
    settled: Settled,
    sure: Certainty,
    notes: tuple[str, ...],
    robots: Mapping[str, Sequence[str]],
) -> FitResult:
    """The same, and warnings: what was misread or is of another robot first, for which it is fitted again in part.

    notes: known already.  robots: of fit.robots.
    """
    fit, end = settled.fit, settled.end
    suspect = _is_suspect(result, settled)
    misread = misread_words(fit, end.x, end.cost) if suspect else ()
    apart = apart_words(fit, end.x) if result.model_error > 1 else ()
    if not apart and not misread and is_in_error(result.cost, result.cost_expected, result.dof):
        apart = disagreement(fit, end.x, end.cost, result.cost_expected, robots)
    apart = apart or (foreign_words(fit, end.x) if suspect and not misread else ())
    found = (*border_words(fit.shapes, fit.parameters, end.x), *findings(result, sure.unreached))
    words = (*misread, *frequency_words(result), *apart, *notes, *found)
    return replace(with_status(result, settled, sure, bool(misread)), warnings=words)


def _is_suspect(result: FitResult, settled: Settled) -> bool:
    """Whether the residuals are so large that one asks how the responses were read."""
    if _noise_is_known(settled):
        return result.model_error > FAR_BEYOND_NOISE
    return _share(result, settled) < FAIRLY_EXPLAINED


def _share(result: FitResult, settled: Settled) -> float:
    """Of the measured responses that the model explains, known noise aside."""
    # Where no noise was measured, the residuals are the only measure of it, and no excuse for themselves.
    noise_cost = result.cost_expected if _noise_is_known(settled) else 0.0
    return explained(settled.fit, settled.end.x, noise_cost)


def _noise_is_known(settled: Settled) -> bool:
    return any(weights.noise is not None for weights in settled.weights)
