"""The judge: one score test of everything that a fit held, and the ranking of all causes that hypotheses propose.

Numbers by one evaluation at the optimum (`score_test`), then what hypotheses search for themselves: forms of lateness,
readings of channels and postures, springs that the robot's file lacks, other robots.  Causes are ranked by their odds
(`ranking`); the likeliest is followed by what explains more with it.
Last come undetectable errors of held numbers: no test of the responses finds them, since free parameters take them up.
"""

from __future__ import annotations

from dataclasses import replace

from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.fit.assembly import Assembly, RelinearisedOptimum
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import Evidence, Hypothesis, explanations
from elastid.fit.diagnosis.other_robots import find_missing_gravity
from elastid.fit.diagnosis.ranking import modification_indices
from elastid.fit.diagnosis.rigid_parts import find_elastic_base, find_rigid_parts
from elastid.fit.diagnosis.scoring import score
from elastid.fit.diagnosis.static_loads import static_notes
from elastid.fit.diagnosis.status import decisive_index, estimate_notes, friction_note, is_beyond_tolerance, with_status
from elastid.fit.diagnosis.tool_side import tool_notes
from elastid.fit.diagnosis.undetectable_errors import find_undetectable_errors
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.result import Result

CONSEQUENCES = ("fit/at-bound", "fit/weakly-determined")  # codes of notes


def judge(
    result: Result,
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    uncertainty: Uncertainty,
    execution: Execution,
    hypotheses: tuple[Hypothesis, ...] = HYPOTHESES,
) -> Evidence:
    """The evidence with a result that has its status, and modification indices where they bear on it."""
    evidence = Evidence(assembly, optimum, uncertainty, result, hypotheses, execution)
    # Where no noise is known, only suspect responses are judged.
    if evidence.noise_cost > 0 or evidence.is_unexplained:
        scores = score(evidence)
        indices = modification_indices(evidence, scores)
        # Where V is that of the noise, only a cause counts that shows the model, or the file, to be wrong.
        is_decisive = decisive_index(result, uncertainty, indices) is not None
        if not (evidence.is_unexplained or is_decisive or is_beyond_tolerance(result, indices)):
            indices = ()
        evidence = replace(evidence, result=replace(result, indices=indices), scores=scores)
    disagreement = next((h.notes for h in hypotheses if h.family == "configurations" and h.notes is not None), None)
    if disagreement is not None and (apart := disagreement(evidence)):
        # One cause, in status, notes and page: that configurations differ, where nothing common explains as much.
        indices = tuple(replace(index, place=0) for index in evidence.result.indices if index.place == 0)
        evidence = replace(evidence, apart=apart, result=replace(evidence.result, indices=indices))
    return replace(evidence, result=with_status(evidence))


def diagnose(evidence: Evidence, notes: tuple[Note, ...]) -> Result:
    """A judged result with notes on causes, estimate and undetectable errors, besides `notes` of data and search."""
    result, optimum, scores = evidence.result, evidence.optimum, evidence.scores
    if scores is not None and result.status in ("converged", "at_bound"):
        result = replace(result, rigid_parts=find_rigid_parts(result, scores, scores.held.linearisation.model.robot))
    others = (h for h in evidence.hypotheses if h.notes is not None and h.family != "configurations")
    by_family = {h.family: h.notes(evidence) for h in others if h.notes is not None}
    apart, causes = evidence.apart, explanations(evidence)
    inertias = find_border_inertias(optimum.fit.inertias, optimum.fit.parameters, optimum.end.x)
    estimate = estimate_notes(evidence)
    if evidence.is_unexplained and result.has_lone_cause:
        # A cause that explains all explains bounds and residuals, too; their own advice would be another.
        estimate = tuple(note for note in estimate if note.code not in CONSEQUENCES)
    undetectable = (*find_undetectable_errors(result, evidence.scores), *find_elastic_base(result))
    undetectable = (*undetectable, *find_missing_gravity(evidence))
    static = (*static_notes(result), *tool_notes(result))
    of_families = (note for family_notes in by_family.values() for note in family_notes)
    first = friction_note(evidence)
    return replace(
        result, notes=(*first, *of_families, *causes, *apart, *static, *notes, *inertias, *estimate, *undetectable)
    )
