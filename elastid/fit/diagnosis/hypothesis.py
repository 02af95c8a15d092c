"""Hypothesis: a kind of cause for excess residuals, with the evidence of the fit by which it is judged.

A hypothesis proposes its causes in one of these ways, each a plain function:

- `columns`: derivatives of the response to fixed numbers, for one score test of all of them.
- `changes`: misreadings of the responses, compared by V after one step with each.
- `search`: causes without a small linear effect at the optimum, such as a resonance within the band.

A number that is a parameter of the equations needs only its name, typical size and sentences.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import Note
from elastid.base.execution import Execution
from elastid.base.statistics import chi_square_limit
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.extended_model import ExtendedModel, ModelResponse
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import EvaluatedResponse, ResponseChange
from elastid.fit.diagnosis.score_test import Candidate, FixedNumber, ScoreTest
from elastid.fit.frf_problem import Assembly, RelinearisedOptimum
from elastid.fit.problem.least_squares import error_gain, is_far_from_noise
from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex

Columns: TypeAlias = Callable[[ModelResponse], Mapping[str, ComplexArray]]
Changes: TypeAlias = Callable[[Sequence[EvaluatedResponse], FloatArray], Iterator[ResponseChange]]


SCALE = "scale"  # family of channels in another unit, whose readings follow from the size of the responses


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
    summary: noun for the error, shown by `elastid explain causes`.  plant: the fault that shows it, of
    tests/plants/faults.py or scripts/studies/causes.py.
    plausibility: prior odds of a cause of this family against one of another, all its members together.
    is_stated: True for numbers of a file or study; False for effects that the robot model lacks.
    """

    family: str
    numbers: tuple[str, ...] = ()
    size: Size = Size(0.1, 1.0, log=True)
    is_common: bool = False
    phrase: str | Callable[[ModificationIndex], str] = ""
    advice: str = ""
    summary: str = ""
    plant: str = ""
    plausibility: float = 1.0
    is_stated: bool = True
    columns: Columns | None = None
    changes: Changes | None = None
    search: Callable[[list[ModificationIndex], Evidence, Scores], list[ModificationIndex]] | None = None

    def number(self, name: str, value: float, unit: str = "", is_nuisance: bool = False) -> FixedNumber:
        """Return a fixed number with its plausible steps; a positive quantity of value 0 only grows."""
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
    """Return the hypothesis of a number by the beginning of its name; the last one that has numbers where none fits."""
    stem, at, _ = name.partition("@")
    first, second = (*stem.split("_", 2), "")[:2]
    by_number = {number: hypothesis for hypothesis in hypotheses for number in hypothesis.numbers}
    beginnings = (f"{first}{at}", f"{first}_{second}", first, "*")
    return next(by_number[beginning] for beginning in beginnings if beginning in by_number)


@dataclass(frozen=True, eq=False)
class Scores:
    """The score test of all candidates on thinned lines.

    excess: of V over the noise, where it is worse than no model at all that of none; `worse`: what it is beyond that.
    variance_ratio: of the residuals over the noise.  lines: share of all residuals.  noise: V by the noise alone, of
    all.  extended: the model with the freed numbers.
    """

    extended: ExtendedModel
    test: ScoreTest
    candidates: tuple[Candidate, ...]
    excess: float
    worse: float
    variance_ratio: float
    lines: float
    noise: float

    @property
    def cost(self) -> float:
        """V of all residuals after the step of the free parameters."""
        return self.excess / self.lines + self.noise

    def detectable(self, indices: IntArray, direction: FloatArray) -> float:
        """Return the smallest error along a direction (n_m,) that changes V by `LIMITS.drop`; infinite if none does."""
        information = float(direction @ self.test.S[np.ix_(indices, indices)] @ direction) / self.lines
        is_distinct = self.test.is_distinct[indices].any() and information > 0
        return math.sqrt(LIMITS.drop / information) if is_distinct else math.inf

    @cached_property
    def significant(self) -> dict[int, float]:
        """The drop that one of all candidates has by the noise alone at the false-alarm rate, by its directions."""
        counts = {4, *(candidate.directions.shape[1] for candidate in self.candidates)}
        tail = LIMITS.false_alarm_rate / max(len(self.candidates), 1)
        return {n: max(self.variance_ratio, 1e-300) * chi_square_limit(n, tail) for n in counts}


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
        remaining, total = 0.0, 0.0
        for part in fit.parts:
            weight, is_used = part.gain * np.abs(error_gain(part.criterion, part.measured)), part.gain > 0
            error = part.measured - part.kernel.response(part.theta(fit.parameters, x))
            remaining += float(np.sum(np.abs(np.where(is_used, weight * error, 0.0)) ** 2))
            total += float(np.sum(np.abs(np.where(is_used, weight * part.measured, 0.0)) ** 2))
        return 1 - max(remaining - self.noise_cost, 0.0) / max(total - self.noise_cost, 1e-300)

    @property
    def is_suspect(self) -> bool:
        """True if the residuals are so large that responses may have been misread."""
        if self.result.noise_is_known:
            return is_far_from_noise(self.result.cost, self.result.cost_expected)
        return self.explained < LIMITS.certain_fraction

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
    fraction = drop / max(scores.cost - scores.noise, drop, 1e-300)
    return replace(index, drop=drop, explained_fraction=fraction, effects=x - evidence.result.x)


def axis(index: ModificationIndex) -> str:
    """Return the name of the axis in the name of an index: 2 for friction_2@c1."""
    return index.name.partition("@")[0].partition("_")[2]


def hypothesis_of_index(index: ModificationIndex, hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    """Return the hypothesis of an index: by the name of its number, else by its family."""
    by_number = hypothesis_of(index.name, hypotheses)
    if by_number.family == index.group:
        return by_number
    return next((hypothesis for hypothesis in hypotheses if hypothesis.family == index.group), None)
