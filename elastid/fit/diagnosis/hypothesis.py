"""Hypothesis: a kind of cause for excess residuals, with the evidence of the fit by which it is judged.

A hypothesis proposes its causes in one of these ways, each a plain function:

- `columns`: derivatives of the response with respect to fixed numbers, for one score test of all numbers.
- `changes`: wrong interpretations of the responses, compared by V after one Gauss-Newton step each.
- `search`: causes that are no small linear change at the optimum, such as a resonance within the band.

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


SCALE = "scale"  # family of channels in another unit, estimated from the magnitude of the responses


@dataclass(frozen=True)
class Size:
    """Prior of the change of a number p: of ln p if `log` and p > 0, else of p in SI.

    usual: median absolute error; scale of a Cauchy distribution, whose tails make no error impossible.  limit: largest
    plausible step.  grows: p is 0 and can only increase.
    """

    usual: float
    limit: float
    log: bool = False
    unit: str = ""
    grows: bool = False


@dataclass(frozen=True)
class Hypothesis:
    """Kind of cause with its prior, sentences and search.

    family: noun for the causes.  numbers: beginnings of the names of their numbers, up to an underscore.
    size: prior of their changes.  is_common: True if one error can scale all numbers by one factor.
    phrase: the cause as a clause, with `{name}`.  advice: next action, with `{name}`, `{where}`, `{usual}`.
    summary: noun for the error, shown by `elastid explain causes`.  plant: simulated fault in tests/plants/faults.py or
    scripts/studies/causes.py.  plausibility: prior odds of the family relative to other families.
    is_stated: True for values of a file or study; False for effects that the robot model lacks.
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
    """Return the hypothesis of a number by the beginning of its name, else the hypothesis of `*`."""
    stem, at, _ = name.partition("@")
    first, second = (*stem.split("_", 2), "")[:2]
    by_number = {number: hypothesis for hypothesis in hypotheses for number in hypothesis.numbers}
    beginnings = (f"{first}{at}", f"{first}_{second}", first, "*")
    return next(by_number[beginning] for beginning in beginnings if beginning in by_number)


@dataclass(frozen=True, eq=False)
class Scores:
    """Score test of all candidates on a subset of the DFT lines.

    extended: model with the fixed numbers as parameters.  excess: V above the noise, at most the excess of the model
    G = 0.  excess_beyond_zero_model: the remainder of V above the noise.  variance_ratio: of residuals to noise.
    residual_fraction: fraction of all residuals in the subset.  noise: V by the noise alone, of all residuals.
    """

    extended: ExtendedModel
    test: ScoreTest
    candidates: tuple[Candidate, ...]
    excess: float
    excess_beyond_zero_model: float
    variance_ratio: float
    residual_fraction: float
    noise: float

    @property
    def cost(self) -> float:
        """V of all residuals after the step of the free parameters."""
        return self.excess / self.residual_fraction + self.noise

    def detectable(self, indices: IntArray, direction: FloatArray) -> float:
        """Return the smallest error along a direction (n_m,) that changes V by `LIMITS.min_drop`, or inf."""
        information = float(direction @ self.test.S[np.ix_(indices, indices)] @ direction) / self.residual_fraction
        is_distinct = self.test.is_distinct[indices].any() and information > 0
        return math.sqrt(LIMITS.min_drop / information) if is_distinct else math.inf

    @cached_property
    def significant(self) -> dict[int, float]:
        """Drop of V that noise alone exceeds in any candidate at the false-alarm rate, by number of directions."""
        counts = {4, *(candidate.directions.shape[1] for candidate in self.candidates)}
        tail = LIMITS.false_alarm_rate / max(len(self.candidates), 1)
        return {n: max(self.variance_ratio, 1e-300) * chi_square_limit(n, tail) for n in counts}


@dataclass(frozen=True, eq=False)
class Evidence:
    """A finished fit, the hypotheses of its diagnosis, and the scores of fixed values if computed.

    inconsistency_notes: notes on configurations with far larger residuals, if they are the likeliest cause.
    """

    assembly: Assembly
    optimum: RelinearisedOptimum
    uncertainty: Uncertainty
    result: Result
    hypotheses: tuple[Hypothesis, ...]
    execution: Execution
    scores: Scores | None = None
    inconsistency_notes: tuple[Note, ...] = ()

    @property
    def noise_cost(self) -> float:
        """V by the noise alone; 0 without measured noise."""
        return self.result.cost_expected if self.result.noise_is_known else 0.0

    @cached_property
    def explained(self) -> float:
        """Fraction of the responses' power above the noise that the model explains; negative if worse than G = 0."""
        fit, x = self.optimum.fit, self.optimum.x
        remaining, total = 0.0, 0.0
        for frf in fit.frfs:
            weight, is_used = frf.gain * np.abs(error_gain(frf.criterion, frf.measured)), frf.gain > 0
            error = frf.measured - frf.kernel.response(frf.theta(fit.parameters, x))
            remaining += float(np.sum(np.abs(np.where(is_used, weight * error, 0.0)) ** 2))
            total += float(np.sum(np.abs(np.where(is_used, weight * frf.measured, 0.0)) ** 2))
        return 1 - max(remaining - self.noise_cost, 0.0) / max(total - self.noise_cost, 1e-300)

    @property
    def is_suspect(self) -> bool:
        """True if the residuals are so large that channels may be misinterpreted."""
        if self.result.noise_is_known:
            return is_far_from_noise(self.result.cost, self.result.cost_expected)
        return self.explained < LIMITS.certain_fraction

    @property
    def is_unexplained(self) -> bool:
        """True if V exceeds the noise, or channels may be misinterpreted."""
        return self.result.exceeds_noise or self.is_suspect

    @property
    def cause(self) -> ModificationIndex | None:
        """The likeliest cause; None without a significant one."""
        return next((index for index in self.result.indices if index.place == 1), None)

    @property
    def best(self) -> ModificationIndex:
        """The first index, or one without effect."""
        return self.result.indices[0] if self.result.indices else ModificationIndex("", "")


def index_of(candidate: Candidate, numbers: Sequence[FixedNumber], steps: FloatArray) -> ModificationIndex:
    """Return the modification index of a candidate for steps (n_m,) of its members among all numbers."""
    members = [numbers[i] for i in candidate.indices]
    return ModificationIndex(
        candidate.name, candidate.family, tuple(number.name for number in members),
        np.array([number.value for number in members]), tuple(number.unit for number in members),
        tuple(number.log for number in members), steps,
    )  # fmt: skip


def with_refit(
    index: ModificationIndex, cost: float, x: FloatArray, evidence: Evidence, scores: Scores
) -> ModificationIndex:
    """Return the index with cost V and x (n_x,) of a fit that includes it."""
    drop = scores.cost - cost if math.isfinite(cost) else 0.0
    fraction = drop / max(scores.cost - scores.noise, drop, 1e-300)
    return replace(index, drop=drop, explained_fraction=fraction, effects=x - evidence.result.x)


def axis_name(index: ModificationIndex) -> str:
    """Return the name of the axis in the name of an index: 2 for friction_2@c1."""
    return index.name.partition("@")[0].partition("_")[2]


def hypothesis_of_index(index: ModificationIndex, hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    """Return the hypothesis of an index: by the name of its number, else by its family."""
    by_number = hypothesis_of(index.name, hypotheses)
    if by_number.family == index.group:
        return by_number
    return next((hypothesis for hypothesis in hypotheses if hypothesis.family == index.group), None)
