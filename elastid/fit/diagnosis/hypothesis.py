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
from elastid.base.display import capital
from elastid.base.errors import Note
from elastid.base.execution import Execution
from elastid.base.statistics import chi_square_limit
from elastid.fit.assembly import Assembly, RelinearisedOptimum
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, ScoreTest
from elastid.fit.diagnosis.sensitivities import Evaluated, HeldModel, HeldResponse, Reading
from elastid.fit.problem.least_squares import error_gain, is_far_from_noise
from elastid.fit.result import NO_CAUSE, ModificationIndex, Result

Columns: TypeAlias = Callable[[HeldResponse], Mapping[str, ComplexArray]]
Changes: TypeAlias = Callable[[Sequence[Evaluated], FloatArray], Iterator[Reading]]


@dataclass(frozen=True)
class Limits:
    """Thresholds of the diagnosis, far above the values of correct models (scripts/studies/results.csv).

    Measured there: V 1.13 of its expectation, and the disagreement of blocks, whose noise is less well known than that
    of all lines together, 1.4; of 330 true models, some with a variance of two degrees of freedom, no number reached a
    drop of 20; friction in a simulated arm of three axes reached 61, with an effect of 2.1 deviations.  A missing
    spring lowers V by 44 to 87 where V shows nothing (5 % of noise).
    false_alarm_rate: Bonferroni over all candidates, not a false discovery rate: a single false cause in a report is
    one too many, and their drops are strongly correlated.
    """

    # A misfit, as `status` has it.
    excess: float = 1.2
    disagreement: float = 1.5
    structure: float = 1.3
    shift: float = 2.0  # standard deviations
    drop: float = 30.0
    effect: float = 0.005  # of a parameter, below which a change is a note and no misfit, and has no words
    effect_on_damping: float = 0.05  # likewise of a damping or a friction
    # An estimate.
    interval_factor: float = 10.0  # of the ends of an interval, beyond which a parameter is weakly determined
    residual_ratio: float = 5.0  # of a configuration to the median of all, beyond which it is unlike the others
    factor_spread: float = 2.5  # of (2 pi)^2 by which all stiffnesses are off where the unit of the frequency is wrong
    stiffness_std: float = 0.5  # the largest, of ln k, of a stiffness that counts there
    suspect_explained_share: float = 0.9  # below which, where the noise is unknown, responses may have been misread
    # Shares of the excess of V that a cause explains.
    further_share: float = 0.05  # that each in a sequence explains
    stated_share: float = 0.1  # below which a cause has no sentence, and a delay no other form
    reason_share: float = 0.3  # below which even the best is not named as the reason, nor a load sought
    half: float = 0.5  # of a variant, of a cause of contradictions; of the responses that a model explains
    explained_share: float = 0.8  # of a reading; from which on no cause is sought that V does not rank
    certain_share: float = 0.9  # below which a cause is said not to be certain, and springs are sought
    whole: float = 0.99  # below which scales and variants are tried, too
    # The ranking of causes.
    false_alarm_rate: float = 0.01  # probability that any candidate has so large a drop by the noise alone
    linear_error: float = 0.002  # of the excess that one step leaves of what the true cause explains
    equal_correlation: float = 0.95  # squared, from which two candidates cannot be distinguished
    equal_drop: float = 0.9  # ratio of their drops, likewise, or of V of two readings or variants
    equal_odds: float = 6.0  # 2 ln of the odds (20 to 1) below which two causes cannot be told apart
    variances: float = 10.0  # difference of V, in variances of the noise, below which there is no minimum, no best form
    form_share: float = 0.01  # likewise of what V has beyond the noise
    sequence: int = 3  # candidates in a sequence
    alone: int = 15  # in the table
    ranked: int = 25  # judged by their forms
    named: int = 3  # parameters, postures, or causes besides, in a sentence
    prior_std: float = 0.5  # the widest prior that is recommended
    # What is searched for.
    exchanged: int = 8  # configurations that fit worst, which are tried in each other's place
    followed: int = 3  # readings, springs and delays that are followed
    predicted_ratio: float = 1.5  # V over that of the fit up to which readings and springs are followed
    screened_ratio: float = 4.0  # likewise of springs by the derivatives of the fit
    frequency_step: float = math.sqrt(2.0)  # ratio of neighbouring resonances of a spring
    stiffnesses: int = 14  # of each spring
    scale: float = 1.7  # a factor nearer to one may be an inertia that is not quite known
    scale_rounds: int = 2  # in which scales and parameters are found in turn
    edge_phase: float = 0.8  # f T at the upper edge of the longest lateness that is sought
    residuals: int = 2_000  # of the fit of a variant
    iterations: int = 15  # of the solver with a reading, a spring, a load or a second source, of the search for T
    rounds: int = 4  # of linearisations, in which a load is found
    load_radius: float = 0.1  # of gyration of a load at the start, m
    load_std: float = 1.0  # of the logarithms of its mass and inertia about the start, and of its place in m
    # A second source: each test errs once in 700 fits.
    tail: float = 1 / 700  # probability of T, and of the factor, by chance
    unreached: float = 30.0  # std of x in a direction that the motors' responses do not reach
    largest: float = 0.9  # factor less 1, beyond which another reading explains what it imitates


LIMITS = Limits()
SCALE = "scale"  # family of channels in another unit, whose readings follow from the size of the responses
# Remedies; a command to copy is at the end, after a colon.
FREE_MOTORS = "Free the viscous friction of all motors, which the robot model lacks: `--set 'fit.parameters.fm_*={}'`"
CHECK_OR_PRIOR = "Check {name}, or free it with a prior: `--set 'fit.parameters.{name}={{prior: {{std: {usual:g}}}}}'`"


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

    def number(self, name: str, value: float, unit: str = "", is_nuisance: bool = False) -> HeldNumber:
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
        return HeldNumber(
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

    held: HeldModel
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
    if sequence and exceeded_tolerance(sequence[0], result):
        stated = stated or sequence[:1]
    elif (sequence and sequence[0].explained_fraction < LIMITS.reason_share) or is_without:
        best = "".join(f" (best: {phrase(i, evidence)}, {_percent(i.explained_fraction)})" for i in stated[:1])
        is_friction = any(map(_is_motor_friction, sequence[:1]))
        return (Note("fit/likely-cause", f"{NO_CAUSE}{best}. {FREE_MOTORS if is_friction else result.test_of_causes}"),)
    return tuple(Note("fit/likely-cause", f"{fault(i, evidence)}. {_remedy(i, evidence)}") for i in stated)


def exceeded_tolerance(index: ModificationIndex, result: Result) -> float:
    """Tolerances by which the data move a value of the robot model, the most of a cause; 0 if not significant."""
    priors = {p.name: p.prior.std for p in result.parameters.free if p.is_nuisance and p.prior is not None}
    steps = zip(index.members, np.abs(index.steps).tolist(), strict=True)
    return max((step / priors.get(name, math.inf) for name, step in steps if index.drop > LIMITS.drop), default=0.0)


def fault(index: ModificationIndex, evidence: Evidence) -> str:
    """The cause with its evidence: `likely cause: m_fore = 75 kg instead of 71 kg (+5.6 %), explains 99 % of ...`."""
    result = evidence.result
    by_name = {index.name: phrase(index, evidence) for index in reversed(result.indices)}
    alternatives = [by_name.get(name, name) for name in index.alike[: LIMITS.named]]
    same = f", or {', or '.join(alternatives)} (indistinguishable)" if alternatives else ""
    tolerances = exceeded_tolerance(index, result)
    of_tolerance = f", {tolerances:.2g} times its tolerance" if tolerances else ""
    name, change = index.most_moved(result.parameters.free_names)
    effect = f"changes {name} by {relative(1 + change)}" if abs(change) > LIMITS.effect else ""
    named = f"{phrase(index, evidence)}{same}{of_tolerance}"
    if not evidence.is_unexplained:
        return f"the data contradict the robot model: {named}{effect and f' ({effect})'}"
    certainty = "likely" if index.explained_fraction >= LIMITS.certain_share else "possible"
    facts = f"explains {_percent(index.explained_fraction)} of the excess residuals{effect and f', {effect}'}"
    return f"{'further' if index.place > 1 else certainty} cause: {named} ({facts})"


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
    change = relative(math.exp(step)) if index.log[0] else f"{step:+.3g}{unit}"
    if index.name.endswith("*"):
        return f"{index.name} {change}"
    return f"{index.name} = {index.changed[0]:.4g}{unit} instead of {float(index.values[0]):.4g}{unit} ({change})"


def _remedy(index: ModificationIndex, evidence: Evidence) -> str:
    hypothesis = hypothesis_of_index(index, evidence.hypotheses)
    advice = (hypothesis and hypothesis.advice) or CHECK_OR_PRIOR
    if _is_motor_friction(index):
        return FREE_MOTORS
    usual = min(hypothesis.size.usual if hypothesis else 0.1, LIMITS.prior_std)
    # The common factor of an inertia's entries is no parameter of a study; they are.
    is_factor = index.name.startswith("I_") and index.name not in evidence.assembly.linearisation.model.parameters
    name = f"{index.name}_*" if is_factor and not index.name.endswith("*") else index.name
    if name == "low_pass":  # of all motions, its inverse of all torques
        name = "low_pass_y" if index.steps[0] > 0 else "low_pass_u"
    return capital(advice.format(name=name, where=index.name.partition("_")[2], usual=usual))


def _is_motor_friction(index: ModificationIndex) -> bool:
    """True for viscous friction of a motor that the robot's file lacks, as no motor does."""
    return index.name.startswith("fm_") and bool(index.members) and not np.any(index.values)


def hypothesis_of_index(index: ModificationIndex, hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    """The hypothesis of an index: by the name of its number, else by its family."""
    by_number = hypothesis_of(index.name, hypotheses)
    if by_number.family == index.group:
        return by_number
    return next((hypothesis for hypothesis in hypotheses if hypothesis.family == index.group), None)


def relative(factor: float) -> str:
    """A factor as a percentage where it is near one."""
    return f"{100 * (factor - 1):+.2g} %" if 0.5 < factor < 2 else f"a factor {factor:.3g}"


def _percent(share: float) -> str:
    return f"{min(100.0, 100 * share):.0f} %" if share < 0.995 else "99 % or more"
