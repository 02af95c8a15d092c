r"""The judge: one score test of everything that a fit held, and the ranking of all causes that hypotheses propose.

Numbers by one evaluation at the optimum (`score_test`), then what hypotheses search for themselves: forms of lateness,
readings of channels and postures, springs that the robot's file lacks, other robots.  Causes are ranked by their odds
(below); the likeliest is followed by what explains more with it.
Last come undetectable errors of held numbers: no test of the responses finds them, since free parameters take them up.

The judgement of causes: the odds of each by the drop of V, by what is plausible beforehand, and by what remains.

A cause h has d numbers p with a prior about no change, W = diag(w^2) of the usual sizes w.  Its odds against another,
Bayes' factor times the prior odds of its family, are to second order (Laplace)

.. math:: 2 \ln O_h = \frac{\Delta V_h}{\tau^2} - \ln \det\Big(1 + \frac{W S_h}{\tau^2}\Big)
          - \sum_i 2 \ln\Big(1 + \frac{p_i^2}{w_i^2}\Big) + 2 \ln \frac{\pi_h}{n_h}

The determinant is Occam's factor: a cause that can be of any size, or has many numbers, explains any data a little.
The third term is the prior's, whose tails are those of Cauchy's distribution.  n_h: causes of the family, which share
its odds pi_h.  One linear step leaves a part of what even the true cause explains, so that residuals by the noise alone
do not remain: tau^2 is the noise's variance and `linear_error` of the excess of V.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.base.execution import Execution
from elastid.fit.assembly import Assembly, RelinearisedOptimum
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import Evidence, Hypothesis, Scores, explanations, hypothesis_of_index
from elastid.fit.diagnosis.readings import as_delay
from elastid.fit.diagnosis.score_test import DISTANCE_M, MASS_KG, Candidate, ScoreTest, find_load
from elastid.fit.diagnosis.scoring import score
from elastid.fit.diagnosis.second_source import static_notes, tool_notes
from elastid.fit.diagnosis.status import (
    decisive_index,
    estimate_notes,
    find_disagreement,
    find_wrong_frequency_unit,
    friction_note,
    is_beyond_tolerance,
    with_status,
)
from elastid.fit.diagnosis.undetectable_errors import find_elastic_base, find_rigid_parts, find_undetectable_errors
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.result import ModificationIndex, Result


@dataclass(frozen=True)
class RankingLimits:
    """Thresholds of the ranking of causes."""

    linear_error: float = 0.002  # of the excess that one step leaves of what the true cause explains
    # Squared, and the ratio of the drops, from which two candidates cannot be distinguished.
    equal_correlation: float = 0.95
    equal_drop: float = 0.9
    equal_odds: float = 6.0  # 2 ln of the odds (20 to 1) below which two causes cannot be told apart
    further_share: float = 0.05  # of the excess, that each in a sequence explains
    sequence: int = 3  # candidates in a sequence
    alone: int = 15  # in the table
    load_share: float = 0.3  # of the excess, that the numbers of a body must explain for a load of it to be sought
    ranked: int = 25  # judged by their forms


RANKING = RankingLimits()


def temper(scores: Scores) -> float:
    """tau^2 of all causes."""
    return max(scores.level, 1e-300) + RANKING.linear_error * max(scores.excess, 0.0)


def log_odds(index: ModificationIndex, count: int, evidence: Evidence, scores: Scores) -> float:
    """2 ln O of a cause, one of `count` of its family."""
    hypothesis = hypothesis_of_index(index, evidence.hypotheses)
    prior = 1.0 if hypothesis is None else hypothesis.plausibility
    occam = index.occam
    if len(index.members) == 1 and occam == 0 and math.isfinite(index.std) and index.std > 0:
        usual = hypothesis.size.usual if hypothesis is not None and hypothesis.size is not None else math.inf
        occam = single_occam(usual, index.std**2 / max(scores.level, 1e-300), float(index.steps[0]), temper(scores))
    return index.drop * scores.lines / temper(scores) - occam + 2 * math.log(max(prior, 1e-300) / count)


def single_occam(usual: float, variance: float, step: float, tau2: float) -> float:
    """The terms of the determinant and of the prior of a single number; variance: of its step, at unit noise."""
    if not 0 < usual < math.inf:
        return 0.0
    return math.log1p(usual**2 / max(variance * tau2, 1e-300)) + 2 * math.log1p((step / usual) ** 2)


def modification_indices(evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, ...]:
    """Causes that lower V by more than chance: the likeliest and what explains more with it, then each alone."""
    indices = ranked(scores.test, scores)
    for search in (h.search for h in evidence.hypotheses if h.search is not None):
        indices = search(indices, evidence, scores)
    if not indices:
        return ()
    counts = Counter(index.group for index in indices)
    odds = {index.name: log_odds(index, counts[index.group], evidence, scores) for index in indices}
    alone = sorted(indices, key=lambda index: odds[index.name], reverse=True)
    best = odds[alone[0].name]
    alone = [replace(index, odds=odds[index.name] - best) for index in alone]
    equal = [index.name for index in alone[1:] if index.odds > -RANKING.equal_odds]
    names = dict.fromkeys(
        [*equal, *(name for name in alone[0].alike if odds.get(name, best) > best - 4 * RANKING.equal_odds)]
    )
    first = replace(alone[0], alike=tuple(name for name in names if name != alone[0].name))
    return (replace(first, place=1), *_further(first, scores), first, *alone[1 : RANKING.alone])


def _further(first: ModificationIndex, scores: Scores) -> list[ModificationIndex]:
    """The best number with the first freed, the best with both freed."""
    by_name = {candidate.name: candidate for candidate in scores.candidates}
    before, further, test = first, list[ModificationIndex](), scores.test
    for place in range(2, RANKING.sequence + 1):
        linear = as_delay(before.name)
        # Further resonances, and what a fit of its own has found, are no linear changes.
        if linear not in by_name or before.group == "compliance" or math.isnan(before.std):
            break
        test = test.freed(by_name[linear])
        best = ranked(test, scores, place, 1)[:1]
        if not best or best[0].share < RANKING.further_share:
            break
        before = best[0]
        further.append(before)
    return further


def ranked(test: ScoreTest, scores: Scores, place: int = 0, most: int = RANKING.ranked) -> list[ModificationIndex]:
    """Candidates with a significant drop, best first: so many, and every delay, which has several forms."""
    every, significant, tau2 = scores.candidates, scores.significant, temper(scores)
    steps = [_step(test, candidate, scores) for candidate in every]
    drops, occams = np.array([drop for _, drop, _ in steps]), np.array([occam for _, _, occam in steps])
    counts = [4 if candidate.name.startswith("payload_") else candidate.directions.shape[1] for candidate in every]
    order = [int(i) for i in np.argsort(occams - drops / tau2) if drops[i] > significant[counts[i]]]
    correlations = test.correlations(every)

    def index(i: int) -> ModificationIndex:
        """The modification index of candidate i, with the candidates that it cannot be distinguished from."""
        candidate, (own, drop, occam) = every[i], steps[i]
        members = [test.numbers[k] for k in candidate.places]
        is_equal = (drops > RANKING.equal_drop * drops[i]) & (correlations[i] > RANKING.equal_correlation)
        equal = [int(j) for j in np.flatnonzero(is_equal) if j != i]
        return ModificationIndex(
            name=candidate.name,
            group=candidate.family,
            members=tuple(number.name for number in members),
            values=np.array([number.value for number in members]),
            units=tuple(number.unit for number in members),
            log=tuple(number.log for number in members),
            steps=own,
            std=test.std(candidate) * math.sqrt(max(scores.level, 0.0)),
            drop=drop / scores.lines,
            share=drop / max(scores.excess, drop, 1e-300),
            effects=test.effects(candidate, own),
            alike=tuple(every[j].name for j in sorted(equal, key=lambda j: -drops[j])),
            place=place,
            occam=float(occam),
        )

    return [index(i) for k, i in enumerate(order) if k < most or every[i].name.startswith("delay")]


def _step(test: ScoreTest, candidate: Candidate, scores: Scores) -> tuple[FloatArray, float, float]:
    """Steps (n_m,) of a candidate, the drop of V, and what Occam's factor and the prior of its size take of 2 ln O."""
    tau2 = temper(scores)
    # Less than that is neither significant nor like what is.
    if test.most(candidate) < RANKING.equal_drop * min(scores.significant.values()):
        return np.zeros(len(candidate.places)), 0.0, 0.0
    if candidate.name.startswith("payload_"):
        load = find_load(test, candidate, scores.level, max(scores.significant[4], RANKING.load_share * scores.excess))
        if load is None:
            return np.zeros(len(candidate.places)), 0.0, 0.0
        W = np.array([MASS_KG, *3 * [DISTANCE_M]])
        sizes = (load.mass / MASS_KG, *load.place / DISTANCE_M)
        return load.steps, load.drop, _occam(load.information / tau2, W, np.array(sizes))
    steps, drop = test.step(candidate)
    D, places = candidate.directions, candidate.places
    usual = np.array([min(test.numbers[i].usual, 1e6) for i in places])
    along = np.array([float(usual[D[:, k] != 0][0]) for k in range(D.shape[1])])
    S = D.T @ test.S[np.ix_(places, places)] @ D
    of_direction = np.array([float(steps[D[:, k] != 0][0]) for k in range(D.shape[1])])
    return steps, drop, _occam(S / tau2, along, of_direction / along)


def _occam(S: FloatArray, usual: FloatArray, sizes: FloatArray) -> float:
    """ln det(1 + W S) and the prior's term of sizes (n_d,) relative to the usual ones."""
    _, log_det = np.linalg.slogdet(np.eye(len(S)) + usual[:, None] * S * usual)
    return float(log_det + 2 * np.sum(np.log1p(sizes**2)))


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
    if apart := find_disagreement(evidence):
        # One cause, in status, notes and page: that configurations differ, where nothing common explains as much.
        indices = tuple(replace(index, place=0) for index in evidence.result.indices if index.place == 0)
        evidence = replace(evidence, apart=apart, result=replace(evidence.result, indices=indices))
    return replace(evidence, result=with_status(evidence))


def diagnose(evidence: Evidence, notes: tuple[Note, ...]) -> Result:
    """A judged result with notes on causes, estimate and undetectable errors, besides `notes` of data and search."""
    result, optimum, scores = evidence.result, evidence.optimum, evidence.scores
    if scores is not None and result.status in ("converged", "at_bound"):
        result = replace(result, rigid_parts=find_rigid_parts(result, scores, scores.held.linearisation.model.robot))
    apart, causes = evidence.apart, explanations(evidence)
    inertias = find_border_inertias(optimum.fit.inertias, optimum.fit.parameters, optimum.end.x)
    estimate = estimate_notes(evidence)
    if evidence.is_unexplained and result.has_lone_cause:
        # A cause that explains all explains bounds and residuals, too; their own advice would be another.
        estimate = tuple(note for note in estimate if note.code not in CONSEQUENCES)
    undetectable = (*find_undetectable_errors(result, evidence.scores), *find_elastic_base(result))
    static = (*static_notes(result), *tool_notes(result))
    first = (*friction_note(evidence), *find_wrong_frequency_unit(evidence))
    return replace(result, notes=(*first, *causes, *apart, *static, *notes, *inertias, *estimate, *undetectable))
