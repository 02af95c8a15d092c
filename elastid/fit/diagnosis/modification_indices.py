"""Modification indices of a fit: the numbers it held that would explain what its residuals have beyond the noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from elastid.base.arrays import FloatArray
from elastid.fit.diagnosis.candidates import candidates, held_number
from elastid.fit.diagnosis.held_numbers import HeldNumbers
from elastid.fit.diagnosis.read_again import thinned
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, ScoreTest
from elastid.fit.diagnosis.sensitivities import Evaluated, evaluated
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum

# Real residuals that are looked at: with more, every so many lines of each configuration are.
MAX_RESIDUALS = 60_000
MIN_LINES = 20
# Probability that any of the candidates has so large a drop by the noise alone.
FALSE_ALARM_RATE = 0.01
# Squared correlation, and ratio of the drops, from which two candidates cannot be told apart.
MIN_ALIKE_CORRELATION = 0.95
MIN_ALIKE_DROP = 0.9
# Each further number that is freed at once counts like so much less of the excess; each in a sequence explains so much.
SHARE_OF_NUMBER = 0.03
MIN_FURTHER_SHARE = 0.05
MAX_SEQUENCE = 3
# The table has so many candidates.
MAX_ALONE = 15


@dataclass(frozen=True, eq=False)
class Scores:
    """The test of all candidates on the lines looked at.

    excess: of V over the noise.  level: of the residuals' variance by the noise.  lines: share of all residuals.
    """

    test: ScoreTest
    candidates: tuple[Candidate, ...]
    excess: float
    level: float
    lines: float

    @property
    def least(self) -> dict[int, float]:
        """The drop that one of all candidates has by the noise alone at the false alarm rate, by its directions."""
        counts = {one.directions.shape[1] for one in self.candidates}
        tail = FALSE_ALARM_RATE / max(len(self.candidates), 1)
        return {n: max(self.level, 1e-300) * float(chdtri(n, tail)) for n in counts}


def modification_indices(
    assembly: Assembly, optimum: RelinearisedOptimum, result: FitResult
) -> tuple[ModificationIndex, ...]:
    """What was held and lowers V by more than chance when it is freed: in sequence, then each alone.

    Largest share first, each further number of a candidate counting against it. One evaluation of the model with
    everything as a parameter, at the optimum.
    """
    scores = score(assembly, optimum, result)
    return (*_sequence(scores), *_ranked(scores.test, scores)[:MAX_ALONE])


def score(assembly: Assembly, optimum: RelinearisedOptimum, result: FitResult) -> Scores:
    """The test at the optimum; parameters at a bound stay there."""
    held, fit, x = HeldNumbers.of(assembly), optimum.fit, optimum.end.x
    lines = max((len(part.measured) for part in fit.parts), default=1)
    few = max(MIN_LINES, math.floor(lines * min(1.0, MAX_RESIDUALS / max(fit.n_residuals, 1))))
    thin = thinned(fit, few)
    A, b, V, names = _sums(evaluated(assembly, held, thin, x), len(x))
    numbers, scale = _held_numbers(names, assembly, held, x)
    every = np.concatenate([np.ones(len(x)), scale])
    A, b = A * np.outer(every, every), b * every
    A[range(len(x)), range(len(x))] += fit.prior_slopes**2
    share = thin.n_residuals / max(fit.n_residuals, 1)
    noise = result.cost_expected * share
    return Scores(
        ScoreTest.of(numbers, A, b, ~result.at_bound),
        tuple(candidates(numbers, held.linearisation.model.robot)),
        V - noise,
        noise / max(thin.n_residuals - len(x), 1),
        share,
    )


def _ranked(test: ScoreTest, scores: Scores, place: int = 0) -> list[ModificationIndex]:
    """All candidates with a significant drop, best first."""
    steps = [test.step(one) for one in scores.candidates]
    drops, least = np.array([step.drop for step in steps]), scores.least
    charge = SHARE_OF_NUMBER * max(scores.excess, 0.0)
    dims = np.array([one.directions.shape[1] for one in scores.candidates])
    order = [int(i) for i in np.argsort(-(drops - charge * (dims - 1))) if drops[i] > least[int(dims[i])]]
    return [_index(test, scores, drops, i, place) for i in order]


def _index(test: ScoreTest, scores: Scores, drops: FloatArray, i: int, place: int) -> ModificationIndex:
    one = scores.candidates[i]
    step = test.step(one)
    members = [test.numbers[k] for k in one.places]
    alike = [
        j
        for j, other in enumerate(scores.candidates)
        if j != i and drops[j] > MIN_ALIKE_DROP * drops[i] and test.correlation(one, other) > MIN_ALIKE_CORRELATION
    ]
    return ModificationIndex(
        name=one.name,
        group=one.group,
        members=tuple(number.name for number in members),
        values=np.array([number.value for number in members]),
        units=tuple(number.unit for number in members),
        log=tuple(number.log for number in members),
        steps=step.steps,
        std=test.std(one) * math.sqrt(max(scores.level, 0.0)),
        drop=step.drop / scores.lines,
        share=step.drop / max(scores.excess, 1e-300),
        effects=test.effects(one, step),
        alike=tuple(scores.candidates[j].name for j in sorted(alike, key=lambda j: -drops[j])),
        place=place,
    )


def _sequence(scores: Scores) -> list[ModificationIndex]:
    """The best candidate, the best beside it, and so on."""
    test, found = scores.test, list[ModificationIndex]()
    by_name = {one.name: one for one in scores.candidates}
    for place in range(1, MAX_SEQUENCE + 1):
        best = _ranked(test, scores, place)[:1]
        if not best or best[0].share < MIN_FURTHER_SHARE:
            break
        found += best
        test = test.freed(by_name[best[0].name])
    return found


def _sums(every: Iterable[Evaluated], n_x: int) -> tuple[FloatArray, FloatArray, float, tuple[str, ...]]:
    """J^T J, J^T r and r^T r over all configurations, and the names of the columns behind those of x."""
    names: dict[str, int] = {}
    A, b, V = np.zeros((n_x, n_x)), np.zeros(n_x), 0.0
    for one in every:
        for name in one.held:
            names.setdefault(name, len(names))
        more = n_x + len(names) - len(b)
        A, b = np.pad(A, (0, more)), np.pad(b, (0, more))
        places = np.concatenate([np.arange(n_x), [n_x + names[name] for name in one.held]]).astype(int)
        J = -one.whitened(np.concatenate([one.free, np.stack(list(one.held.values()))]))
        r = one.residual
        A[np.ix_(places, places)] += J @ J.T
        b[places] += J @ r
        V += float(r @ r)
    return A, b, V, tuple(names)


def _held_numbers(
    names: Sequence[str], assembly: Assembly, held: HeldNumbers, x: FloatArray
) -> tuple[list[HeldNumber], FloatArray]:
    """The numbers by name, and dp / d ln p (n_h,) of the logarithmic ones."""
    theta = held.theta(assembly, x, assembly.responses[0].configuration.name)
    at = dict(zip(held.parameters, theta.tolist(), strict=True))
    robot = held.linearisation.model.robot
    units = {name: unit for name, (_, unit) in robot.parameters(held.linearisation.model.parameters).items()}
    found, scale = [], []
    for name in names:
        of_ratio = name.startswith("ratio_")
        if name in held.rigid:
            one = held_number(held.rigid[name], 0.0)
        elif of_ratio:
            one = held_number(name, abs(robot.ratio(name.removeprefix("ratio_"))))
        else:
            one = held_number(name, at.get(name, 0.0), units.get(name, ""))
        found.append(one)
        scale.append(one.value if one.log and not of_ratio else 1.0)  # the slope of a ratio is to its logarithm
    return found, np.array(scale)
