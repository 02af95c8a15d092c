"""Modification indices: what a fit held, or read wrongly, that would explain what V has beyond the noise.

Numbers by one evaluation at the optimum (`score_test`), lateness by its form at the same, readings of channels and
postures by one evaluation more at the start: a fit of responses that were read wrongly may end anywhere.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.diagnosis.modification.lateness import Late, best_hold, late_name, latest
from elastid.fit.diagnosis.modification.misreadings import misreadings
from elastid.fit.diagnosis.modification.missing_springs import missing_springs
from elastid.fit.diagnosis.modification.reading import evaluated_at, thinned
from elastid.fit.diagnosis.modification.score_test import ScoreTest
from elastid.fit.diagnosis.modification.scores import Scores
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum

# Squared correlation, and ratio of the drops, from which two candidates cannot be distinguished.
MIN_ALIKE_CORRELATION = 0.95
MIN_ALIKE_DROP = 0.9
# And from which the more usual of the two is named first.
MIN_EQUAL_DROP = 0.99
# Each further number that is freed at once counts like so much less of the excess; each in a sequence explains so much.
SHARE_OF_NUMBER = 0.03
MIN_FURTHER_SHARE = 0.05
MAX_SEQUENCE = 3
# The table has so many candidates.
MAX_ALONE = 15
MAX_RANKED = 25
# A delay that explains so much is looked at by its form; forms whose V differs by less, in variances of the noise and
# as a part of what is left, cannot be distinguished.
MIN_LATE_SHARE = 0.1
MIN_LATE_PART = 0.5
MAX_LATE = 2
MIN_FORM_DROP = 10.0
MIN_FORM_SHARE = 0.01
# Of ln p of a parameter that the data constrain.
MAX_STD = 1.0
# Springs that the robot lacks are looked for where nothing else explains so much.
MAX_EXPLAINED_SHARE = 0.9


def modification_indices(
    assembly: Assembly, optimum: RelinearisedOptimum, result: FitResult, scores: Scores
) -> tuple[ModificationIndex, ...]:
    """What lowers V by more than chance when it is freed or read otherwise: in sequence, then each alone.

    Largest share first, each further number of a candidate counting against it.
    """
    numbers = _with_forms(_ranked(scores.test, scores), optimum, result, scores)
    found = [*numbers, *misreadings(optimum, result, scores.noise)]
    return _in_sequence(_with_springs(found, assembly, optimum, result, scores), scores)


def held_indices(
    assembly: Assembly, optimum: RelinearisedOptimum, result: FitResult, scores: Scores
) -> tuple[ModificationIndex, ...]:
    """The same of numbers and springs, for fits whose V is that of the noise.

    A share may then be of hardly any excess.
    """
    numbers = _ranked(scores.test, scores)
    return _in_sequence(_with_springs(numbers, assembly, optimum, result, scores), scores)


def _with_springs(
    found: list[ModificationIndex],
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    result: FitResult,
    scores: Scores,
) -> list[ModificationIndex]:
    """The same with springs that the robot lacks, each in place of its linear step, where nothing explains V."""
    explained = max((one.share for one in found), default=0.0)
    if result.exceeds_noise and explained > MAX_EXPLAINED_SHARE:
        return found
    springs = missing_springs(scores.held, assembly, optimum, result, scores.noise, scores.level)
    known = {one.name: one for one in springs if one.drop > scores.least[1]}
    return [*(one for one in found if one.name not in known), *known.values()]


def _in_sequence(found: list[ModificationIndex], scores: Scores) -> tuple[ModificationIndex, ...]:
    """The best and what explains more beside it, then all of them alone."""
    alone = sorted(found, key=_rank, reverse=True)
    if not alone:
        return ()
    first = _most_plausible(alone, scores)
    alone = [first, *(one for one in alone if one.name != first.name)][:MAX_ALONE]
    return (replace(first, place=1), *_beside(first, scores), *alone)


def _rank(one: ModificationIndex) -> float:
    return one.share - SHARE_OF_NUMBER * (len(one.members) - 1) * (not one.name.endswith("*"))


def _most_plausible(alone: list[ModificationIndex], scores: Scores) -> ModificationIndex:
    """Of the best and those that explain as much in the same way, the one whose step is the most usual."""
    best, usual = alone[0], {number.name: number.usual for number in scores.test.numbers}
    equal = [one for one in alone if one.name in best.alike and one.share > MIN_EQUAL_DROP * best.share]
    choice = [one for one in (best, *equal) if one.members]
    if not equal or len(choice) < 2:
        return best
    first = min(choice, key=lambda one: abs(one.steps[0]) / usual.get(one.members[0], math.inf))
    return replace(first, alike=tuple(name for name in (best.name, *best.alike) if name != first.name))


def _beside(first: ModificationIndex, scores: Scores) -> list[ModificationIndex]:
    """The best number beside the first, the best beside both."""
    by_name = {one.name: one for one in scores.candidates}
    before, found = first, list[ModificationIndex]()
    test = scores.test
    for place in range(2, MAX_SEQUENCE + 1):
        linear = _as_delay(before.name)
        if linear not in by_name or before.group == "compliance":  # a further resonance is no linear change
            break
        test = test.freed(by_name[linear])
        best = [one for one in _ranked(test, scores, place, 1)[:1] if one.share >= MIN_FURTHER_SHARE]
        if not best:
            break
        found += best
        before = best[0]
    return found


def _ranked(test: ScoreTest, scores: Scores, place: int = 0, most: int = MAX_RANKED) -> list[ModificationIndex]:
    """Candidates with a significant drop, best first: so many, and every delay, whose form is looked at."""
    steps = [test.step(one) for one in scores.candidates]
    drops, least = np.array([step.drop for step in steps]), scores.least
    charge = SHARE_OF_NUMBER * max(scores.excess, 0.0)
    counts = np.array([one.directions.shape[1] for one in scores.candidates])
    order = [int(i) for i in np.argsort(-(drops - charge * (counts - 1))) if drops[i] > least[int(counts[i])]]
    kept = [i for k, i in enumerate(order) if k < most or scores.candidates[i].name.startswith("delay")]
    correlations = test.correlations(scores.candidates)
    return [_index(test, scores, drops, correlations[i], i, place) for i in kept]


def _index(
    test: ScoreTest, scores: Scores, drops: FloatArray, correlation: FloatArray, i: int, place: int
) -> ModificationIndex:
    """Of candidate i; correlation (n_c,): squared, of its effect with those of all."""
    one = scores.candidates[i]
    step = test.step(one)
    members = [test.numbers[k] for k in one.places]
    is_alike = (drops > MIN_ALIKE_DROP * drops[i]) & (correlation > MIN_ALIKE_CORRELATION)
    alike = [int(j) for j in np.flatnonzero(is_alike) if j != i]
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


def _with_forms(
    numbers: list[ModificationIndex], optimum: RelinearisedOptimum, result: FitResult, scores: Scores
) -> list[ModificationIndex]:
    """The same with the forms of what is late, where a delay would explain a part; a hold in any case."""
    fit, x = thinned(optimum.fit), _within_reach(optimum, result)
    there, prior, free = evaluated_at(fit, x), optimum.fit.prior_slopes, ~result.at_bound
    if not there:
        return numbers
    moved = x - optimum.end.x
    late = [one for one in numbers if one.name.startswith("delay") and one.share > MIN_LATE_SHARE]
    late = [one for one in late if one.share > MIN_LATE_PART * late[0].share][:MAX_LATE]
    cost = sum(float(one.residual @ one.residual) for one in evaluated_at(fit, optimum.end.x))
    lines = fit.n_residuals / max(optimum.fit.n_residuals, 1)
    noise = scores.noise * lines
    excess = max(cost - noise, 1e-300)
    found = list(numbers)
    for one in late:
        role, at = _channel(one.name, fit)
        forms = sorted(latest(there, role, at, float(one.steps[0]), prior, free), key=lambda form: form.read.cost)
        least = forms[0].read.cost
        tolerance = MIN_FORM_DROP * scores.level + MIN_FORM_SHARE * max(least - noise, 0.0)
        alike = [form for form in forms if form.read.cost < least + tolerance]
        of_forms = [_of_form(form, one, alike, (cost - form.read.cost) / excess, moved, scores) for form in alike]
        found[found.index(one) : found.index(one) + 1] = of_forms
    if not any(one.name == "delay" for one in late):
        hold = best_hold(there, prior, free, "delay" in result.parameters.free_names)
        drop = cost - hold.read.cost
        if drop > max(scores.least[1], MIN_LATE_SHARE * (cost - noise)) and drop > max(
            (one.drop * lines for one in late), default=0.0
        ):
            found.append(_of_form(hold, None, [hold], drop / excess, moved, scores))
    return found


def _within_reach(optimum: RelinearisedOptimum, result: FitResult) -> FloatArray:
    """The optimum (n_x,), what the data barely constrain at its start: far out ln p has no slope that leads back."""
    weak = ~(np.sqrt(np.diag(result.covariance)) < MAX_STD)
    log = np.array([p.log for p in optimum.fit.parameters.free])
    return np.where(weak & log, optimum.fit.parameters.x, optimum.end.x)


def _of_form(
    form: Late, linear: ModificationIndex | None, alike: list[Late], share: float, moved: FloatArray, scores: Scores
) -> ModificationIndex:
    """linear: the delay that it is to first order.  alike: all forms that cannot be distinguished.

    share: of the excess.  moved (n_x,): from the optimum to where the step begins.
    """
    held = linear.values if linear is not None and form.name == linear.name else np.zeros(1)
    return ModificationIndex(
        name=form.name,
        group="time",
        members=(form.name,),
        values=held,
        units=("s",),
        log=(False,),
        steps=np.array([form.time]),
        std=math.nan if linear is None else linear.std,
        drop=share * scores.excess / scores.lines,
        share=share,
        effects=moved + form.read.step,
        alike=tuple(other.name for other in alike if other is not form) + (() if linear is None else linear.alike),
    )


def _as_delay(name: str) -> str:
    """The delay that a form of lateness is to first order; any other name as it is."""
    form = next((form for form in ("low_pass", "hold") if name.startswith(form)), "")
    return f"delay{name.removeprefix(form)}" if form else name


def _channel(name: str, fit: ElasticFit) -> tuple[str, str]:
    """Role and place of delay_y_motor_2, none of delay."""
    for part in fit.parts:
        for role, places in (("y", part.kernel.model.outputs), ("u", part.kernel.model.inputs)):
            for at in places:
                if late_name("delay", role, at) == name:
                    return role, at
    return "", ""
