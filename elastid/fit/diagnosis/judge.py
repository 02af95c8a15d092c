"""The judge: one score test of everything that a fit held, and the ranking of all causes that hypotheses propose.

Numbers by one evaluation at the optimum (`score_test`), then what hypotheses search for themselves: forms of lateness,
readings of channels and postures, springs that the robot's file lacks.  Causes are ranked by the share of the excess of
V that each explains, times the prior plausibility of its family; the best is followed by what explains more with it.
Last come undetectable errors of held numbers: no test of the responses finds them, since free parameters take them up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.fit.assembly import Assembly, RelinearisedOptimum
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.configurations import LIMITS
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import (
    Columns,
    Evidence,
    Hypothesis,
    Scores,
    explanations,
    hypothesis_of,
    hypothesis_of_index,
)
from elastid.fit.diagnosis.lateness import as_delay
from elastid.fit.diagnosis.prediction import thinned
from elastid.fit.diagnosis.rigid_parts import find_elastic_base, find_rigid_parts
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, ScoreTest
from elastid.fit.diagnosis.sensitivities import RATE, HeldModel, evaluate_held
from elastid.fit.diagnosis.status import MISFIT, decisive_index, estimate_notes, with_status
from elastid.fit.problem.elastic import Part
from elastid.fit.problem.inertia_barrier import find_border_inertias
from elastid.fit.result import FitResult, ModificationIndex
from elastid.parameters import ParameterSet
from elastid.robot import Robot


@dataclass(frozen=True)
class RankingLimits:
    """Thresholds of the ranking of causes.  False alarms of 300 clean logs: modification-index 1."""

    residuals: int = 60_000  # real ones of the score test; with more, every so many lines are taken
    # Squared, and the ratio of the drops, from which two candidates cannot be distinguished.
    equal_correlation: float = 0.95
    equal_drop: float = 0.9
    same_drop: float = 0.99  # ratio from which the more usual of the two is named first
    number_share: float = 0.03  # of the excess, charged for each further number that is freed at once
    further_share: float = 0.05  # of the excess, that each in a sequence explains
    sequence: int = 3  # candidates in a sequence
    alone: int = 15  # in the table
    ranked: int = 25  # judged by their forms


RANKING = RankingLimits()


# J^T J (n, n), J^T r (n,) and r^T r, and the names of the columns of J after those of x (n_x,).
_Sums: TypeAlias = tuple[FloatArray, FloatArray, float, tuple[str, ...]]


def score(evidence: Evidence, execution: Execution) -> Scores:
    """The score test at the optimum; parameters at a bound stay there."""
    assembly, fit, x = evidence.assembly, evidence.optimum.fit, evidence.optimum.end.x
    held, thin = HeldModel.of(assembly, fit.parts[0].kernel.model), thinned(fit, RANKING.residuals)
    columns = tuple(h.columns for h in evidence.hypotheses if h.columns is not None)
    sums = partial(_sums, held, assembly.parameters, x, columns)
    A, b, V, names = _added(execution.ordered(sums, [part for part in thin.parts if part.n_residuals]), len(x))
    numbers, scale = _held_numbers(names, evidence, held, x)
    every = np.concatenate([np.ones(len(x)), scale])
    A, b = A * np.outer(every, every), b * every
    A[range(len(x)), range(len(x))] += fit.prior_slopes**2
    test = ScoreTest.of(numbers, A, b, ~evidence.result.at_bound)
    freed = tuple(candidates(numbers, held.linearisation.model.robot, evidence.hypotheses))
    lines = thin.n_residuals / max(fit.n_residuals, 1)
    noise = evidence.noise_cost * lines
    level = (noise or V) / max(thin.n_residuals - len(x), 1)
    return Scores(held, test, freed, V - noise, level, lines, evidence.noise_cost)


def _sums(held: HeldModel, fitted: ParameterSet, x: FloatArray, columns: Sequence[Columns], part: Part) -> _Sums:
    evaluated = evaluate_held(held, fitted, x, columns, part)
    J = -evaluated.whitened(np.concatenate([evaluated.free, np.stack(list(evaluated.held.values()))]))
    r = evaluated.residual
    return J @ J.T, J @ r, float(r @ r), tuple(evaluated.held)


def _added(every: Iterable[_Sums], n_x: int) -> _Sums:
    names: dict[str, int] = {}
    A, b, V = np.zeros((n_x, n_x)), np.zeros(n_x), 0.0
    for own_A, own_b, own_V, held in every:
        for name in held:
            names.setdefault(name, len(names))
        more = n_x + len(names) - len(b)
        A, b = np.pad(A, (0, more)), np.pad(b, (0, more))
        places = np.concatenate([np.arange(n_x), [n_x + names[name] for name in held]]).astype(int)
        A[np.ix_(places, places)] += own_A
        b[places] += own_b
        V += own_V
    return A, b, V, tuple(names)


def _held_numbers(
    names: Sequence[str], evidence: Evidence, held: HeldModel, x: FloatArray
) -> tuple[list[HeldNumber], FloatArray]:
    """The numbers by name, and dp / d ln p (n_h,) of the logarithmic ones."""
    assembly, robot = evidence.assembly, held.linearisation.model.robot
    theta = held.theta(assembly.parameters, x, assembly.responses[0].configuration.name)
    values = dict(zip(held.parameters, theta.tolist(), strict=True))
    units = {name: unit for name, (_, unit) in robot.parameters(held.linearisation.model.parameters).items()}
    numbers, scale = [], []
    for name in names:
        is_ratio, value, unit = name.startswith("ratio_"), values.get(name, 0.0), units.get(name, "")
        if name in held.rigid:
            name, value, unit = held.rigid[name], 0.0, ""
        elif is_ratio:
            value = abs(robot.ratio(name.removeprefix("ratio_")))
        number = hypothesis_of(name, evidence.hypotheses).number(name, value, unit)
        numbers.append(number)
        scale.append(number.value if number.log and not is_ratio else 1.0)  # the slope of a ratio is to its logarithm
    return numbers, np.array(scale)


def candidates(numbers: Sequence[HeldNumber], robot: Robot, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """Each number alone, then common factors of several, then mass, centre and inertia of each body.

    A torque constant that is wrong in every drive is one error and not six: gain_u_* is a factor of all of them.
    """
    place = {number.name: i for i, number in enumerate(numbers)}
    every = [Candidate(number.name, number.family, np.array([i]), np.eye(1)) for i, number in enumerate(numbers)]

    def add_common(name: str, members: list[int]) -> None:
        if len(members) > 1 and len({numbers[i].log for i in members}) == 1:
            every.append(Candidate(name, numbers[members[0]].family, np.array(members), np.ones((len(members), 1))))

    for prefix in (prefix for h in hypotheses if h.is_common for prefix in h.numbers):
        add_common(f"{prefix}_*", [i for name, i in place.items() if name.startswith(f"{prefix}_")])
    for body in robot.bodies:
        moments = [f"I_{body.name}_{axis}" for axis in ("xx", "yy", "zz")]
        add_common(f"I_{body.name}_*", [place[name] for name in moments if name in place])
        inertial = [f"m_{body.name}", *(f"c_{body.name}_{axis}" for axis in "xyz")]
        inertial += [f"I_{body.name}{suffix}" for suffix in body.inertia_entries]
        members = [place[name] for name in inertial if name in place]
        if inertial[0] in place and len(members) > 1:
            every.append(Candidate(f"payload_{body.name}", "payload", np.array(members), np.eye(len(members))))
    return every


def modification_indices(evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, ...]:
    """Causes that lower V by more than chance: the best and what explains more with it, then each alone.

    Largest share first, each further number of a candidate counting against it.  Where V is that of the noise, a share
    may be of a small excess.
    """
    indices = _ranked(scores.test, scores)
    for search in (h.search for h in evidence.hypotheses if h.search is not None):
        indices = search(indices, evidence, scores)
    if not indices:
        return ()

    def rank(index: ModificationIndex) -> float:
        further = (len(index.members) - 1) * (not index.name.endswith("*"))
        hypothesis = hypothesis_of_index(index, evidence.hypotheses)
        weight = 1.0 if hypothesis is None else hypothesis.plausibility(index)
        return (index.share - RANKING.number_share * further) * weight

    alone = sorted(indices, key=rank, reverse=True)
    first = _most_usual(alone, scores)
    alone = [first, *(index for index in alone if index.name != first.name)][: RANKING.alone]
    return (replace(first, place=1), *_further(first, scores), *alone)


def _most_usual(alone: list[ModificationIndex], scores: Scores) -> ModificationIndex:
    """The best cause; of those that explain as much in the same way, the one whose step is the most usual."""
    best, usual = alone[0], {number.name: number.usual for number in scores.test.numbers}
    equal = [index for index in alone if index.name in best.alike and index.share > RANKING.same_drop * best.share]
    choice = [index for index in (best, *equal) if index.members]
    if not equal or len(choice) < 2:
        return best
    first = min(choice, key=lambda index: abs(index.steps[0]) / usual.get(index.members[0], math.inf))
    return replace(first, alike=tuple(name for name in (best.name, *best.alike) if name != first.name))


def _further(first: ModificationIndex, scores: Scores) -> list[ModificationIndex]:
    """The best number with the first freed, the best with both freed."""
    by_name = {candidate.name: candidate for candidate in scores.candidates}
    before, further, test = first, list[ModificationIndex](), scores.test
    for place in range(2, RANKING.sequence + 1):
        linear = as_delay(before.name)
        if linear not in by_name or before.group == "compliance":  # a further resonance is no linear change
            break
        test = test.freed(by_name[linear])
        best = _ranked(test, scores, place, 1)[:1]
        if not best or best[0].share < RANKING.further_share:
            break
        before = best[0]
        further.append(before)
    return further


def _ranked(test: ScoreTest, scores: Scores, place: int = 0, most: int = RANKING.ranked) -> list[ModificationIndex]:
    """Candidates with a significant drop, best first: so many, and every delay, which has several forms."""
    every, significant = scores.candidates, scores.significant
    steps = [test.step(candidate) for candidate in every]
    drops = np.array([drop for _, drop in steps])
    charge = RANKING.number_share * max(scores.excess, 0.0)
    counts = np.array([candidate.directions.shape[1] for candidate in every])
    order = [int(i) for i in np.argsort(-(drops - charge * (counts - 1))) if drops[i] > significant[int(counts[i])]]
    correlations = test.correlations(every)

    def index(i: int) -> ModificationIndex:
        """The modification index of candidate i, with the candidates that it cannot be distinguished from."""
        candidate, (own, drop) = every[i], steps[i]
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
            share=drop / max(scores.excess, 1e-300),
            effects=test.effects(candidate, own),
            alike=tuple(every[j].name for j in sorted(equal, key=lambda j: -drops[j])),
            place=place,
        )

    return [index(i) for k, i in enumerate(order) if k < most or every[i].name.startswith("delay")]


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
    """A judged result with notes on causes, estimate and undetectable errors, besides `notes` of data and search."""
    result, optimum, scores = evidence.result, evidence.optimum, evidence.scores
    if scores is not None and result.status in ("converged", "at_bound"):
        result = replace(result, rigid_parts=find_rigid_parts(result, scores, scores.held.linearisation.model.robot))
    by_family = {h.family: h.notes(evidence) for h in evidence.hypotheses if h.notes is not None}
    apart = by_family.pop("configurations", ())
    causes = explanations(evidence) if evidence.best_share > LIMITS.explained_share or not apart else ()
    inertias = find_border_inertias(optimum.fit.inertias, optimum.fit.parameters, optimum.end.x)
    estimate = estimate_notes(evidence)
    undetectable = (*find_undetectable_errors(result, evidence.scores), *find_elastic_base(result))
    of_families = (note for family_notes in by_family.values() for note in family_notes)
    return replace(result, notes=(*of_families, *causes, *apart, *notes, *inertias, *estimate, *undetectable))


@dataclass(frozen=True)
class UndetectableError:
    """name, family: of a held number.  per_std: its error that moves parameter (its place in x) by one deviation.

    error: the largest common one that nothing finds; both of ln p where log, else SI in unit.
    """

    name: str
    family: str
    unit: str
    log: bool
    parameter: int
    per_std: float
    error: float

    @property
    def moved(self) -> float:
        """The undetected error of the parameter, in its standard deviations."""
        return self.error / self.per_std

    def amount(self, error: float) -> str:
        """An error with its unit, and the number as the files of study and robot, or fit.parameters, call it."""
        size = f"{100 * error:.2g} %" if self.log or self.unit == "1" else f"{error:.2g} {self.unit}"
        return f"{size} of {'rate_hz' if self.name == RATE else self.name}"


def undetectable_errors(result: FitResult, scores: Scores) -> Iterator[UndetectableError]:
    r"""Of every held number, alone or with all of its kind by one factor, whose error moves a parameter.

    A gear ratio that is wrong by a little changes the response as stiffness and damping do: free parameters take it up.
    Of a number h, with S and the effects of the score test and the standard deviations of x,

    .. math:: e_1 = \min_i \frac{\sigma_i}{|\partial x_i / \partial h|}, \qquad e_\text{undetectable} = \sqrt{D / S}

    are the error that moves a parameter by its standard deviation, and the largest one whose freeing would lower V by
    no more than what shows a model to be wrong (D, `status.MISFIT.drop`).
    """
    n = len(result.parameters.asked)
    test, std = scores.test, np.sqrt(np.diag(result.covariance)[:n])
    for candidate in scores.candidates:
        places, first = candidate.places, test.numbers[candidate.places[0]]
        if candidate.directions.shape[1] > 1 or not math.isfinite(first.usual):
            continue
        direction = candidate.directions[:, 0]
        effects = np.abs(test.response[:n, places] @ direction)
        # A parameter that the data do not reach is not moved.
        moved = np.divide(effects, std, out=np.zeros(len(std)), where=np.isfinite(std) & (std > 0))
        worst = int(np.argmax(moved))
        if moved[worst] == 0:
            continue
        information = float(direction @ test.S[np.ix_(places, places)] @ direction) / scores.lines
        is_detectable = test.known[places].any() and information > 0
        error = min(first.usual, math.sqrt(MISFIT.drop / information)) if is_detectable else first.usual
        of_number = candidate.name, candidate.family, first.unit, first.log
        yield UndetectableError(*of_number, worst, 1 / float(moved[worst]), error)


def find_undetectable_errors(result: FitResult, scores: Scores | None) -> tuple[Note, ...]:
    """A sentence on the worst of several kinds of numbers, where the intervals are stated as they stand."""
    if scores is None or result.status not in ("converged", "at_bound") or not result.noise_is_known:
        return ()
    errors = sorted(undetectable_errors(result, scores), key=lambda error: error.moved, reverse=True)
    errors = [error for error in errors if error.moved > MISFIT.effect]
    if not errors:
        return ()
    worst = {error.family: error for error in reversed(errors)}
    named = [error for error in errors if worst[error.family] is error][:3]  # one of a kind
    further = sum(not error.name.endswith("*") for error in errors if error not in named)
    moves = [
        f"{_stated(place, result)} moves by one standard deviation with "
        + " or ".join(error.amount(error.per_std) for error in named if error.parameter == place)
        for place in dict.fromkeys(error.parameter for error in named)
    ]
    more = f", and others with {further} further numbers" if further else ""
    text = (
        f"the intervals take as exact what the fit held: {', '.join(moves)}{more}; up to "
        f"{errors[0].amount(errors[0].error)} shows in no residual: measure them as exactly, or fit those that can be "
        "with a prior"
    )
    return (Note("held-as-exact", text, severity="information"),)


def _stated(place: int, result: FitResult) -> str:
    parameter = result.parameters.free[place]
    value, std = result.values[parameter.name], result.std[parameter.name]
    share = f"{100 * std / abs(value):.2g} %" if parameter.log else f"{std:.2g} {parameter.unit}"
    return f"{parameter.name} (stated to {share})"
