r"""Ranking of model-error hypotheses (causes) by their posterior odds.

Candidates are fixed numbers, by one score test at the optimum (`score_test`), and results of hypotheses with a search
of their own (delays, misinterpreted channels and postures, missing springs, other robots). Further causes, which
explain more together with the likeliest one, follow it in the ranking.

The changes p of the numbers of a cause h have a prior with zero mean and W = diag(w^2), w: typical sizes. The posterior
odds are the prior odds of the family times the Bayes factor (Laplace's approximation),

.. math:: 2 \ln O_h = \frac{\Delta V_h}{\tau^2} - \ln \det\Big(1 + \frac{W S_h}{\tau^2}\Big)
          - \sum_i 2 \ln\Big(1 + \frac{p_i^2}{w_i^2}\Big) + 2 \ln \frac{\pi_h}{n_h}

The determinant is Occam's factor: it penalises causes with wide priors and many numbers. The third term is a prior with
the tails of a Cauchy distribution. n_h: number of causes of the family, which share its prior odds pi_h. tau^2:
variance ratio of the noise plus `LIMITS.linear_error` times the excess of V, the error of one linear step.
"""

import math
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, values_by_name
from elastid.base.errors import Note
from elastid.base.execution import Execution
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.cause_notes import explanations
from elastid.fit.diagnosis.confounded_parameters import find_elastic_base, find_rigid_parts, find_undetectable_errors
from elastid.fit.diagnosis.delay_hypotheses import as_delay
from elastid.fit.diagnosis.estimate_notes import (
    contradictions,
    estimate_notes,
    find_disagreement,
    find_wrong_frequency_unit,
)
from elastid.fit.diagnosis.extended_model import ExtendedModel, evaluate_extended
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import (
    Columns,
    Evidence,
    Hypothesis,
    Scores,
    hypothesis_of,
    hypothesis_of_index,
    index_of,
)
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.priors import contradicted_tolerances, scattered_ratios
from elastid.fit.diagnosis.refit import evenly_spaced, line_subset
from elastid.fit.diagnosis.response_derivatives import inertial_names
from elastid.fit.diagnosis.score_test import Candidate, FixedNumber, ScoreTest, free_drop
from elastid.fit.diagnosis.status import decisive_index, with_status
from elastid.fit.diagnosis.unmodelled_payload import DISTANCE_M, MASS_KG, find_load
from elastid.fit.frf_problem import Assembly, RelinearisedOptimum
from elastid.fit.problem.frf_residuals import FrfResiduals, map_chunks
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex
from elastid.parameters import Parameters
from elastid.robot import Robot

RESIDUALS = 60_000  # largest number of real residuals in the score test, of a subset of lines if there are more


# J^T J (n, n), J^T r (n,) and r^T r, residuals, and the names of the columns of J after x (n_x,).
_Sums: TypeAlias = tuple[FloatArray, FloatArray, float, int, tuple[str, ...]]


def score(evidence: Evidence) -> Scores:
    """Return the score test at the optimum; parameters at a bound stay there."""
    assembly, fit, x = evidence.assembly, evidence.optimum.fit, evidence.optimum.x
    extended = ExtendedModel.of(assembly, fit.frfs[0].kernel.model)
    # Each configuration adds about twenty numbers.
    subset = replace(fit, frfs=fit.frfs[evenly_spaced(len(fit.frfs))])
    names_q = {frf.configuration for frf in subset.frfs}
    columns = [h.columns for h in evidence.hypotheses if h.columns]
    sums = partial(_sums, extended, fit.parameters, x, columns, names_q, line_subset(subset, RESIDUALS))
    A, b, V, n_residuals, names = _add_sums(filter(None, map_chunks(sums, fit.frfs, evidence.execution)), len(x))
    numbers, scale = _fixed_numbers(names, evidence, extended, x)
    scales, lines = np.concatenate([np.ones(len(x)), scale]), n_residuals / max(fit.n_residuals, 1)
    A, b, beyond, pull = _with_priors(A * np.outer(scales, scales), b * scales, evidence, lines)
    numbers += beyond
    test = ScoreTest.of(numbers, A, b, ~evidence.result.at_bound)
    options = tuple(candidates(numbers, extended.linearisation.model.robot, evidence.hypotheses))
    noise, V = evidence.noise_cost * lines, V + pull - free_drop(A, b, ~evidence.result.at_bound)
    variance = (noise or V) / max(n_residuals - len(x), 1)
    excess = (V - noise) / (max(1.0, 1 - evidence.explained) if evidence.is_unexplained else 1.0)
    return Scores(extended, test, options, excess, V - noise - excess, variance, lines, evidence.noise_cost)


def _with_priors(
    A: FloatArray, b: FloatArray, evidence: Evidence, lines: float
) -> tuple[FloatArray, FloatArray, list[FixedNumber], float]:
    """Return A and b with priors and static loads, the prior means of nuisance parameters as numbers, and V of both.

    The shift of a prior mean is a fixed number with the residual (x - mean - shift) / s.  lines: fraction of residuals.
    """
    fit, x, free = evidence.optimum.fit, evidence.optimum.x, evidence.result.parameters.free
    (distance, slope), (r, J), n_x = fit.parameters.priors(x), fit.static(x), len(free)
    weight, pull = lines * slope**2, lines * slope * distance
    A[range(n_x), range(n_x)] += weight
    b[:n_x] += pull
    A[:n_x, :n_x] += lines * J.T @ J
    b[:n_x] += lines * J.T @ r
    nuisance = [i for i, p in enumerate(free) if p.is_nuisance and slope[i] > 0]
    A, b = np.pad(A, (0, len(nuisance))), np.append(b, -pull[nuisance])
    numbers = []
    for row, i in zip(range(len(b) - len(nuisance), len(b)), nuisance, strict=True):
        A[row, row], A[i, row], A[row, i] = weight[i], -weight[i], -weight[i]
        parameter, prior = free[i], free[i].prior
        hypothesis = hypothesis_of(parameter.name, evidence.hypotheses)
        number = hypothesis.number(parameter.name, prior.mean if prior is not None else 0.0, parameter.unit, True)
        numbers.append(replace(number, log=parameter.log))
    return A, b, numbers, float(lines * (distance @ distance + r @ r))


def _sums(
    extended: ExtendedModel, parameters: Parameters, x: FloatArray, columns: Sequence[Columns], names: Container[str],
    thin: Callable[[FrfResiduals], FrfResiduals], frf: FrfResiduals,
) -> _Sums | None:  # fmt: skip
    """Return the sums of a configuration over a subset of its lines; None if it is not in `names`."""
    if frf.configuration not in names or not (frf := thin(frf)).n_residuals:
        return None
    # Residuals of the fitted model: the extended model has slightly compliant instead of rigid coordinates.
    G = frf.kernel.response(frf.theta(parameters, x))
    evaluated = replace(evaluate_extended(extended, parameters, x, columns, frf), G=G)
    J = -evaluated.whitened(np.concatenate([evaluated.free, np.stack(list(evaluated.fixed.values()))]))
    r = evaluated.residual
    return J @ J.T, J @ r, float(r @ r), frf.n_residuals, tuple(evaluated.fixed)


def _add_sums(sums: Iterable[_Sums], n_x: int) -> _Sums:
    names: dict[str, int] = {}
    A, b, V, n_residuals = np.zeros((n_x, n_x)), np.zeros(n_x), 0.0, 0
    for A_q, b_q, V_q, count_q, names_q in sums:
        for name in names_q:
            names.setdefault(name, len(names))
        n_missing = n_x + len(names) - len(b)
        A, b = np.pad(A, (0, n_missing)), np.pad(b, (0, n_missing))
        indices = np.concatenate([np.arange(n_x), [n_x + names[name] for name in names_q]]).astype(int)
        A[np.ix_(indices, indices)] += A_q
        b[indices] += b_q
        V, n_residuals = V + V_q, n_residuals + count_q
    return A, b, V, n_residuals, tuple(names)


def _fixed_numbers(
    names: Sequence[str], evidence: Evidence, extended: ExtendedModel, x: FloatArray
) -> tuple[list[FixedNumber], FloatArray]:
    """Return the fixed numbers, and dp / d ln p (n_h,), 1 for linear ones."""
    assembly, robot = evidence.assembly, extended.linearisation.model.robot
    theta = extended.theta(assembly.parameters, x, assembly.responses[0].configuration.name)
    values = values_by_name(extended.parameters, theta)
    units = {name: unit for name, (_, unit) in robot.parameters(extended.linearisation.model.parameters).items()}
    numbers, scale = [], []
    turning = (joint for joint in robot.joints if not joint.slides and f"k_{joint.name}" not in extended.rigid)
    springs = [joint.spring.stiffness for joint in turning if joint.spring is not None]
    for name in names:
        stem, is_ratio = name.partition("@")[0], name.startswith("ratio_")
        value, unit = values.get(stem, 0.0), units.get(stem, "")
        if name in extended.rigid:
            name, value, unit = extended.rigid[name], 0.0, ""
        elif is_ratio:
            value = abs(robot.ratio(name.removeprefix("ratio_")))
        number = hypothesis_of(name, evidence.hypotheses).number(name, value, unit)
        if math.isinf(number.usual) and name in extended.rigid.values() and springs:
            number = replace(number, usual=1 / float(np.median(springs)))  # rad/(N*m), typical of this robot
        numbers.append(number)
        scale.append(number.value if number.log and not is_ratio else 1.0)  # ratios have slopes to their logarithm
    return numbers, np.array(scale)


def candidates(numbers: Sequence[FixedNumber], robot: Robot, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """Return candidates: single values, then common factors of several values, then values with a common cause.

    gain_u_* is a factor of all torque constants, since one error can affect all drives. A payload changes mass, centre
    and inertia of a body; the angle of an axis can be wrong in every configuration.
    """
    index_of = {number.name: i for i, number in enumerate(numbers)}
    options = [
        Candidate(n.name, n.family, np.array([i]), np.eye(1))
        for i, n in enumerate(numbers)
        if not ("@" in n.name and n.name.startswith(("m_", "c_", "I_")))
    ]

    def add_common(name: str, members: list[int]) -> None:
        if len(members) > 1 and len({numbers[i].log for i in members}) == 1:
            options.append(Candidate(name, numbers[members[0]].family, np.array(members), np.ones((len(members), 1))))

    for prefix in (prefix for h in hypotheses if h.is_common for prefix in h.numbers):
        add_common(f"{prefix}_*", [i for name, i in index_of.items() if name.startswith(f"{prefix}_")])
    for body in robot.bodies:
        moments = [f"I_{body.name}_{axis}" for axis in ("xx", "yy", "zz")]
        if f"I_{body.name}" not in index_of:
            add_common(f"I_{body.name}_*", [index_of[name] for name in moments if name in index_of])
    for name, family, members in _common_causes(robot, index_of):
        together = [index_of[member] for member in members if member in index_of]
        if len(together) > 1:
            options.append(Candidate(name, family, np.array(together), np.eye(len(together))))
    return options


def _common_causes(robot: Robot, index_of: dict[str, int]) -> Iterator[tuple[str, str, list[str]]]:
    postures = sorted({name.partition("@")[2] for name in index_of if "@" in name})
    for body in robot.bodies:
        for at in ("", *(f"@{posture}" for posture in postures)):
            numbers = [f"{name}{at}" for name in inertial_names(body)]  # with a posture only for the last body
            yield f"payload_{body.name}{at}", "payload of one posture" if at else "payload", numbers
    for joint in robot.driven:
        yield f"angles_{joint.name}", "angles by posture", [f"angle_{joint.name}@{posture}" for posture in postures]


def drop_variance(scores: Scores) -> float:
    """Return tau^2, the variance of a drop of V by noise and by the error of a linear step."""
    return max(scores.variance_ratio, 1e-300) + LIMITS.linear_error * max(scores.excess, 0.0)


def modification_indices(evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, ...]:
    """Return significant causes: the likeliest cause, further causes in sequence, then each cause alone."""
    indices = rank(scores.test, scores)
    # Causes that linear steps do not show are searched if the residuals exceed the noise.
    for search in (h.search for h in evidence.hypotheses if h.search is not None and evidence.is_unexplained):
        indices = search(indices, evidence, scores)
    if not indices:
        return ()
    counts, odds = Counter(index.group for index in indices), dict[str, float]()
    for index in indices:  # 2 ln O
        hypothesis = hypothesis_of_index(index, evidence.hypotheses)
        prior = math.log(max(hypothesis.plausibility if hypothesis else 1.0, 1e-300) / counts[index.group])
        odds[index.name] = index.drop * scores.residual_fraction / drop_variance(scores) - index.occam + 2 * prior
    single = sorted(indices, key=lambda index: odds[index.name], reverse=True)
    best = odds[single[0].name]
    single = [replace(index, odds=odds[index.name] - best) for index in single]
    equal = [index.name for index in single[1:] if index.odds > -LIMITS.equal_odds]
    names = dict.fromkeys(
        [*equal, *(name for name in single[0].alike if odds.get(name, best) > best - 4 * LIMITS.equal_odds)]
    )
    first = replace(single[0], alike=tuple(name for name in names if name != single[0].name))
    return (replace(first, place=1), *_following_causes(first, scores), first, *single[1 : LIMITS.n_single_causes])


def _following_causes(first: ModificationIndex, scores: Scores) -> list[ModificationIndex]:
    by_name = {candidate.name: candidate for candidate in scores.candidates}
    previous, following, test = first, list[ModificationIndex](), scores.test
    for rank_number in range(2, LIMITS.n_refits + 1):
        linear = as_delay(previous.name)
        # Further resonances, and results of a separate fit, are no linear changes.
        if linear not in by_name or previous.group == "compliance" or math.isnan(previous.std):
            break
        test = test.freed(by_name[linear])
        best = rank(test, scores, rank_number, 1)[:1]
        if not best or best[0].explained_fraction < LIMITS.min_further_fraction:
            break
        previous = best[0]
        following.append(previous)
    return following


def rank(test: ScoreTest, scores: Scores, place: int = 0, count: int = LIMITS.n_ranked) -> list[ModificationIndex]:
    """Return up to `count` candidates with a significant drop, best first, and all delays, which have several forms."""
    options, significant, tau2 = scores.candidates, scores.significant, drop_variance(scores)
    steps = [_step(test, candidate, scores) for candidate in options]
    drops = np.maximum([drop - scores.excess_beyond_zero_model for _, drop, _ in steps], 0.0)
    occams = np.array([occam for _, _, occam in steps])
    counts = [4 if candidate.name.startswith("payload_") else candidate.directions.shape[1] for candidate in options]
    order = [int(i) for i in np.argsort(occams - drops / tau2) if drops[i] > significant[counts[i]]]
    correlations = test.correlations(options)

    def index(i: int) -> ModificationIndex:
        """Return the modification index of candidate i, with the candidates that are indistinguishable from it."""
        candidate, (step, _, occam), drop = options[i], steps[i], float(drops[i])
        is_equal = (drops > LIMITS.equal_drop * drops[i]) & (correlations[i] > LIMITS.equal_correlation)
        equal = [int(j) for j in np.flatnonzero(is_equal) if j != i]
        return replace(
            index_of(candidate, test.numbers, step), drop=drop / scores.residual_fraction,
            std=test.std(candidate) * math.sqrt(max(scores.variance_ratio, 0.0)), place=place, occam=float(occam),
            explained_fraction=drop / max(scores.excess, drop, 1e-300), effects=test.effects(candidate, step),
            alike=tuple(options[j].name for j in sorted(equal, key=lambda j: -drops[j])),
        )  # fmt: skip

    return [index(i) for k, i in enumerate(order) if k < count or options[i].name.startswith("delay")]


def _step(test: ScoreTest, candidate: Candidate, scores: Scores) -> tuple[FloatArray, float, float]:
    tau2, no_load = drop_variance(scores), (np.zeros(len(candidate.indices)), 0.0, 0.0)
    # A smaller drop is neither significant nor equivalent to a significant cause.
    if test.max_drop(candidate) < LIMITS.equal_drop * min(scores.significant.values()):
        return no_load
    if candidate.name.startswith("payload_"):
        min_drop = max(scores.significant[4], LIMITS.min_cause_fraction * scores.excess)
        load = find_load(test, candidate, scores.variance_ratio, min_drop)
        if load is None:
            return no_load
        W = np.array([MASS_KG, *3 * [DISTANCE_M]])
        sizes = (load.mass / MASS_KG, *load.position / DISTANCE_M)
        return load.steps, load.drop, occam_factor(load.information / tau2, W, np.array(sizes))
    steps, drop = test.step(candidate)
    first = np.argmax(candidate.directions != 0, axis=0)  # number of each direction
    usual = np.array([min(test.numbers[i].usual, 1e6) for i in candidate.indices[first]])
    return steps, drop, occam_factor(test.along(candidate)[0] / tau2, usual, steps[first] / usual)


def occam_factor(S: FloatArray, usual: FloatArray, sizes: FloatArray) -> float:
    """Return ln det(1 + W S) plus the term of the Cauchy prior.  sizes (n_d,): steps relative to typical ones."""
    _, log_det = np.linalg.slogdet(np.eye(len(S)) + usual[:, None] * S * usual)
    return float(log_det + 2 * np.sum(np.log1p(sizes**2)))


CONSEQUENCES = ("fit/at-bound", "fit/weakly-identifiable")  # codes of notes


def rank_causes(
    result: Result, assembly: Assembly, optimum: RelinearisedOptimum, uncertainty: Uncertainty, execution: Execution,
    hypotheses: tuple[Hypothesis, ...] = HYPOTHESES,
) -> Evidence:  # fmt: skip
    """Rank the causes. Return the evidence with the status of the result, and its modification indices."""
    evidence = Evidence(assembly, optimum, uncertainty, result, hypotheses, execution)
    # Without measured noise, causes are ranked only for suspect responses.
    if evidence.noise_cost > 0 or evidence.is_unexplained:
        scores = score(evidence)
        indices = modification_indices(evidence, scores)
        # If V is within the noise, causes count only with a decisive index or contradicted tolerances.
        is_decisive = decisive_index(result, uncertainty, indices) is not None
        if uncertainty.ratios.explains or not (
            evidence.is_unexplained or is_decisive or contradicted_tolerances(result)
        ):
            indices = ()
        evidence = replace(evidence, result=replace(result, indices=indices), scores=scores)
    if inconsistent := find_disagreement(evidence):
        # The inconsistency of configurations is then the only cause.
        indices = tuple(replace(index, place=0) for index in evidence.result.indices if index.place == 0)
        evidence = replace(evidence, inconsistency_notes=inconsistent, result=replace(evidence.result, indices=indices))
    return replace(evidence, result=with_status(evidence))


def diagnose(evidence: Evidence, notes: tuple[Note, ...]) -> Result:
    """Return the result with `notes` of data and search, and notes on causes, estimate and undetectable errors."""
    result, optimum, scores = evidence.result, evidence.optimum, evidence.scores
    if scores is not None and result.status in ("converged", "at_bound"):
        result = replace(result, assumed_rigid=find_rigid_parts(result, scores))
    inertias = find_border_inertias(optimum.fit.inertias, optimum.fit.parameters, optimum.x)
    estimate = estimate_notes(evidence)
    if evidence.is_unexplained and result.has_single_cause:
        # A single cause also explains bounds and weak parameters, whose advice would contradict its remedy.
        estimate = tuple(note for note in estimate if note.code not in CONSEQUENCES)
    ratios = scattered_ratios(evidence.uncertainty.ratios, evidence.assembly.responses)
    causes = (*find_wrong_frequency_unit(evidence), *ratios, *explanations(evidence), *evidence.inconsistency_notes)
    undetectable = *find_undetectable_errors(result, scores), *find_elastic_base(result)
    return replace(result, notes=(*causes, *contradictions(result), *notes, *inertias, *estimate, *undetectable))
