"""Hypothesis: a kind of cause for excess residuals. Evidence: fit and score test for the judgement.

A hypothesis proposes its causes in one of these ways, each a plain function:

- `columns`: derivatives of the response to numbers that the fit held; one score test judges them all.
- `changes`: other readings of the responses, as changes of the model's, judged by V after a step with each.
- `search`: causes that no derivative at the optimum describes, such as a resonance within the band.

A number that is a parameter of the equations needs none of them: its name, its usual size and words are enough.

The note on a cause has two sentences: the change with its fraction of the excess and its effect on k, and the remedy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.display import capital, percent
from elastid.base.errors import Note
from elastid.base.execution import Execution
from elastid.base.statistics import chi_square_limit
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.priors import contradicted_tolerances, relative, tolerance_of
from elastid.fit.diagnosis.score_test import Candidate, FixedNumber, ScoreTest
from elastid.fit.diagnosis.sensitivities import Evaluated, ExtendedModel, ModelResponse, Reading
from elastid.fit.frf_problem import Assembly, RelinearisedOptimum
from elastid.fit.problem.least_squares import error_gain, is_far_from_noise
from elastid.fit.result import NO_CAUSE, REQUIRED, ModificationIndex, Result

Columns: TypeAlias = Callable[[ModelResponse], Mapping[str, ComplexArray]]
Changes: TypeAlias = Callable[[Sequence[Evaluated], FloatArray], Iterator[Reading]]


SCALE = "scale"  # family of channels in another unit, whose readings follow from the size of the responses
# Remedies; a command to copy is at the end, after a colon.
FREE_MOTORS = "Free the viscous friction of all motors, which the robot model lacks: `--set 'fit.parameters.fm_*={}'`"
CHECK_OR_PRIOR = (
    "Correct {name} in the robot model, or estimate it (prior: value of the robot model; std {size}, wide enough "
    "for this change): "
    "`--set 'fit.parameters.{name}={{prior: {{std: {usual:g}}}}}'`"
)


@dataclass(frozen=True)
class Size:
    """The prior of a change: of ln p where log and the value is positive, else SI.

    usual: within which half of such errors are, as a Cauchy distribution has them, whose tails let no size be
    impossible.  limit: of a plausible step.  grows: only upwards, from 0.
    """

    usual: float
    limit: float
    log: bool = False
    unit: str = ""
    grows: bool = False


@dataclass(frozen=True)
class Hypothesis:
    """family: the noun for its causes.  numbers: how their names begin, up to an underscore.

    size: of a plausible step of its numbers.  is_common: one mistake may scale all of them by one factor.
    phrase: the cause as a clause, with `{name}`; advice: the next action, with `{name}`, `{where}`, `{usual}`.
    plausibility: prior odds of a cause of this family against one of another, all its members together.
    is_stated: True for numbers that a file or a study states; False for what a model of the robot lacks.
    """

    family: str
    numbers: tuple[str, ...] = ()
    size: Size = Size(0.1, 1.0, log=True)
    is_common: bool = False
    phrase: str | Callable[[ModificationIndex], str] = ""
    advice: str = ""
    plausibility: float = 1.0
    is_stated: bool = True
    columns: Columns | None = None
    changes: Changes | None = None
    search: Callable[[list[ModificationIndex], Evidence, Scores], list[ModificationIndex]] | None = None

    def number(self, name: str, value: float, unit: str = "", is_nuisance: bool = False) -> FixedNumber:
        """A held number of its own with the steps that are plausible; a positive quantity of value 0 only grows."""
        size = self.size
        log, limits = size.log and value > 0, (-size.limit, size.limit, size.usual)
        is_product_of_inertia = name.startswith("I_") and name[-3:] in ("_xy", "_xz", "_yz")
        if not log and size.grows:
            limits = 0.0, math.inf, size.usual
        elif not log and size.log and value == 0 and not is_product_of_inertia:
            limits = 0.0, math.inf, math.inf
        elif not log and size.log:
            limits = -math.inf, math.inf, math.inf
        return FixedNumber(
            name, self.family, value, unit or size.unit, log, *limits, is_nuisance=is_nuisance, is_stated=self.is_stated
        )


def hypothesis_of(name: str, hypotheses: Sequence[Hypothesis]) -> Hypothesis:
    """The hypothesis of a number by the beginning of its name; the last one that has numbers where none fits."""
    stem, at, _ = name.partition("@")
    first, second = (*stem.split("_", 2), "")[:2]
    by_number = {number: hypothesis for hypothesis in hypotheses for number in hypothesis.numbers}
    beginnings = (f"{first}{at}", f"{first}_{second}", first, "*")
    return next(by_number[beginning] for beginning in beginnings if beginning in by_number)


@dataclass(frozen=True, eq=False)
class Scores:
    """The score test of all candidates on thinned lines.

    excess: of V over the noise, where it is worse than no model at all that of none; `worse`: what it is beyond that.
    level: of the residuals' variance by the noise.  lines: share of all residuals.  noise: V by the noise alone, of
    all.  held: the model with what is freed.
    """

    held: ExtendedModel
    test: ScoreTest
    candidates: tuple[Candidate, ...]
    excess: float
    worse: float
    level: float
    lines: float
    noise: float

    @property
    def cost(self) -> float:
        """V of all residuals after the step of the free parameters."""
        return self.excess / self.lines + self.noise

    @cached_property
    def significant(self) -> dict[int, float]:
        """The drop that one of all candidates has by the noise alone at the false-alarm rate, by its directions."""
        counts = {4, *(candidate.directions.shape[1] for candidate in self.candidates)}
        tail = LIMITS.false_alarm_rate / max(len(self.candidates), 1)
        return {n: max(self.level, 1e-300) * chi_square_limit(n, tail) for n in counts}


@dataclass(frozen=True, eq=False)
class Evidence:
    """A finished fit, the hypotheses to judge it, and the scores of fixed values if known.

    apart: notes on configurations that differ, where that is the likeliest cause.
    """

    assembly: Assembly
    optimum: RelinearisedOptimum
    uncertainty: Uncertainty
    result: Result
    hypotheses: tuple[Hypothesis, ...]
    execution: Execution
    scores: Scores | None = None
    apart: tuple[Note, ...] = ()

    @property
    def noise_cost(self) -> float:
        """V by the noise alone; where none was measured, residuals are its only estimate, and it excuses nothing."""
        return self.result.cost_expected if self.result.noise_is_known else 0.0

    @cached_property
    def explained(self) -> float:
        """The share of the responses that the model explains, known noise aside; negative if it is worse than none."""
        fit, x = self.optimum.fit, self.optimum.end.x
        left, total = 0.0, 0.0
        for part in fit.parts:
            weight, used = part.gain * np.abs(error_gain(part.criterion, part.measured)), part.gain > 0
            error = part.measured - part.kernel.response(part.theta(fit.parameters, x))
            left += float(np.sum(np.abs(np.where(used, weight * error, 0.0)) ** 2))
            total += float(np.sum(np.abs(np.where(used, weight * part.measured, 0.0)) ** 2))
        return 1 - max(left - self.noise_cost, 0.0) / max(total - self.noise_cost, 1e-300)

    @property
    def is_suspect(self) -> bool:
        """True if the residuals are so large that responses may have been misread."""
        if self.result.noise_is_known:
            return is_far_from_noise(self.result.cost, self.result.cost_expected)
        return self.explained < LIMITS.suspect_explained_share

    @property
    def is_unexplained(self) -> bool:
        """True if V exceeds the noise, or responses may have been misread."""
        return self.result.exceeds_noise or self.is_suspect

    @property
    def cause(self) -> ModificationIndex | None:
        """The likeliest cause, if any is known."""
        return next((index for index in self.result.indices if index.place == 1), None)

    @property
    def best(self) -> ModificationIndex:
        """The first index, or one without effect."""
        return self.result.indices[0] if self.result.indices else ModificationIndex("", "")


def against(
    index: ModificationIndex, cost: float, x: FloatArray, evidence: Evidence, scores: Scores
) -> ModificationIndex:
    """Return the index with cost V and x (n_x,) of a fit that includes it."""
    drop = scores.cost - cost if math.isfinite(cost) else 0.0
    share = drop / max(scores.cost - scores.noise, drop, 1e-300)
    return replace(index, drop=drop, explained_fraction=share, effects=x - evidence.result.x)


def explanations(evidence: Evidence) -> tuple[Note, ...]:
    """Notes on the causes in the order of the ranking, or one that no cause explains enough."""
    result, sequence = evidence.result, [index for index in evidence.result.indices if index.place]
    stated = [index for index in sequence if index.explained_fraction >= LIMITS.stated_share]
    if result.is_within_declared and evidence.best.explained_fraction < LIMITS.reason_share:
        return ()
    is_without = not (sequence or evidence.apart) and result.status == "misfit" and result.exceeds_noise
    if sequence and contradicted_tolerances(result) and (stated or not evidence.is_unexplained):
        stated = stated or sequence[:1]
    elif (sequence and sequence[0].explained_fraction < LIMITS.reason_share) or is_without:
        best = "".join(f" (best: {phrase(i, evidence)}, {_percent(i.explained_fraction)})" for i in stated[:1])
        is_friction = any(map(_is_motor_friction, sequence[:1]))
        return (Note("fit/likely-cause", f"{NO_CAUSE}{best}. {FREE_MOTORS if is_friction else result.test_of_causes}"),)
    return tuple(Note("fit/likely-cause", f"{fault(i, evidence)}. {_remedy(i, evidence)}") for i in stated)


def fault(index: ModificationIndex, evidence: Evidence) -> str:
    """The cause with its evidence: `likely cause: m_fore = 75 kg instead of 71 kg (+5.6 %); explains 99 % of ...`."""
    result = evidence.result
    by_name = {index.name: phrase(index, evidence) for index in reversed(result.indices)}
    alternatives = [by_name.get(name, name) for name in index.alike[: LIMITS.named]]
    same = f", or {', or '.join(alternatives)} (indistinguishable)" if alternatives else ""
    tolerance = tolerance_of(index, result)
    of_tolerance = f"; its prior std in this fit is {tolerance}" if tolerance else ""
    name, change = index.most_moved(result.parameters.free_names)
    effect = f"changes {name} by {relative(math.log1p(max(change, 1e-9 - 1)))}" if abs(change) > LIMITS.effect else ""
    named = f"{phrase(index, evidence)}{same}{of_tolerance}"
    if not evidence.is_unexplained:
        return f"{REQUIRED} {named}{effect and f' ({effect})'}"
    certainty = "likely" if index.explained_fraction >= LIMITS.certain_share else "possible"
    facts = f"explains {_percent(index.explained_fraction)} of the residuals above the noise{effect and f', {effect}'}"
    return f"{'further' if index.place > 1 else certainty} cause: {named}; {facts}"


def phrase(index: ModificationIndex, evidence: Evidence) -> str:
    """The change itself: `m_fore = 71.4 kg instead of 75 kg (-4.8 %)`, `a delay of 0.294 ms`."""
    hypothesis = hypothesis_of_index(index, evidence.hypotheses)
    if hypothesis is not None and hypothesis.phrase:
        words, where = hypothesis.phrase, index.name.partition("@")[2]
        alone = f" in configuration {where} alone" if where else ""
        return words.format(name=index.name) if isinstance(words, str) else f"{words(index)}{alone}"
    return number_phrase(index) if index.members else index.name


def axis(index: ModificationIndex) -> str:
    """Name of the axis that an index is of: 2 of friction_2@c1."""
    return index.name.partition("@")[0].partition("_")[2]


def number_phrase(index: ModificationIndex) -> str:
    """The change of a number, or of a common factor of several, with its values."""
    unit = "" if index.units[0] == "1" else f" {index.units[0]}"
    step = float(index.steps[0])
    change = relative(step) if index.log[0] else f"{step:+.3g}{unit}"
    if index.name.endswith("*"):
        return f"{index.name} {change}"
    before = f"{float(index.values[0]):.4g}{unit} ({change})"
    return f"{index.group} {index.name} = {index.changed[0]:.4g}{unit} instead of {before}"


def _remedy(index: ModificationIndex, evidence: Evidence) -> str:
    hypothesis = hypothesis_of_index(index, evidence.hypotheses)
    advice = (hypothesis and hypothesis.advice) or CHECK_OR_PRIOR
    if _is_motor_friction(index):
        return FREE_MOTORS
    step = max(np.abs(index.steps).tolist(), default=0.0)  # which the prior must not contradict
    usual = min(max(hypothesis.size.usual if hypothesis else 0.1, float(f"{1.1 * step:.1g}")), LIMITS.prior_std)
    # The common factor of an inertia's entries is no parameter of a study; they are.
    is_factor = index.name.startswith("I_") and index.name not in evidence.assembly.linearisation.model.parameters
    name = f"{index.name}_*" if is_factor and not index.name.endswith("*") else index.name
    if name == "low_pass":  # of all motions, its inverse of all torques
        name = "low_pass_y" if index.steps[0] > 0 else "low_pass_u"
    size = percent(usual) if index.log and index.log[0] else f"{usual:g} {index.units[0] if index.units else ''}"
    return capital(advice.format(name=name, where=index.name.partition("_")[2], usual=usual, size=size))


def _is_motor_friction(index: ModificationIndex) -> bool:
    """True for viscous friction of a motor that the robot's file lacks, as no motor does."""
    return index.name.startswith("fm_") and bool(index.members) and not np.any(index.values)


def hypothesis_of_index(index: ModificationIndex, hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    """The hypothesis of an index: by the name of its number, else by its family."""
    by_number = hypothesis_of(index.name, hypotheses)
    if by_number.family == index.group:
        return by_number
    return next((hypothesis for hypothesis in hypotheses if hypothesis.family == index.group), None)


def _percent(share: float) -> str:
    return f"{min(100.0, 100 * share):.0f} %" if share < 0.995 else "99 % or more"
