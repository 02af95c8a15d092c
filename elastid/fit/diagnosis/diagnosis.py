"""Diagnosis of a fit that ended: its status with a reason, modification indices, and notes on possible causes."""

from __future__ import annotations

from dataclasses import replace

from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.fit.diagnosis.configurations import LIMITS
from elastid.fit.diagnosis.estimate_notes import estimate_notes
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import Evidence, Hypothesis
from elastid.fit.diagnosis.judge import modification_indices, score
from elastid.fit.diagnosis.sentences import explanations
from elastid.fit.diagnosis.status import decisive_index, with_status
from elastid.fit.diagnosis.undetectable_errors import find_undetectable_errors
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum
from elastid.fit.uncertainty.covariance import Uncertainty


def judge(
    result: FitResult,
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    execution: Execution,
    hypotheses: tuple[Hypothesis, ...] = HYPOTHESES,
) -> Evidence:
    """The evidence with a result that has its status, and modification indices where they bear on it."""
    evidence = Evidence(assembly, optimum, uncertainty, result, hypotheses)
    # Where no noise is known, only suspect responses are judged.
    if evidence.noise_cost > 0 or evidence.is_unexplained:
        scores = score(evidence, execution)
        indices = modification_indices(evidence, scores)
        # Where V is that of the noise, only a cause counts that shows the model to be wrong.
        if not evidence.is_unexplained and decisive_index(result, uncertainty, indices) is None:
            indices = ()
        evidence = replace(evidence, result=replace(result, indices=indices), scores=scores)
    return replace(evidence, result=with_status(evidence))


def diagnose(evidence: Evidence, notes: tuple[Note, ...]) -> FitResult:
    """A judged result with notes on causes, on the estimate, and on errors that nothing would show.

    notes: of the data and the search.
    """
    result, optimum = evidence.result, evidence.optimum
    by_family = {h.family: h.notes(evidence) for h in evidence.hypotheses if h.notes is not None}
    apart = by_family.pop("configurations", ())
    causes = explanations(evidence) if evidence.best_share > LIMITS.explained_share or not apart else ()
    inertias = find_border_inertias(optimum.fit.inertias, optimum.fit.parameters, optimum.end.x)
    estimate = estimate_notes(result, evidence.uncertainty.unreached)
    undetectable = find_undetectable_errors(result, evidence.scores)
    others = (note for family_notes in by_family.values() for note in family_notes)
    return replace(result, notes=(*others, *causes, *apart, *notes, *inertias, *estimate, *undetectable))
