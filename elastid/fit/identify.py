r"""identify: measured responses and a robot -> elastic parameters with their certainty, and predict, its inverse.

    choose -> weigh -> linearise -> search (log, then the criterion, from many starts) -> settle -> certainty

Settle: the operating point moves with the stiffnesses under gravity, so the model is linearised again at the result
and solved again until nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import DataError, FitError, StudyError
from elastid.fit.certainty import Certainty, certainty
from elastid.fit.choose import choose
from elastid.fit.elastic import ElasticFit, elastic_fit, matched
from elastid.fit.explained import apart_words, explained, sign_words
from elastid.fit.findings import at_bound, findings, status_and_message
from elastid.fit.inputs import check_responses
from elastid.fit.multistart import multistart, spread
from elastid.fit.residuals import Criterion
from elastid.fit.result import FitResult, Start
from elastid.fit.robust import robust_factors
from elastid.fit.solvers import distance, solve
from elastid.fit.spec import FitSpec
from elastid.fit.weights import Weights, check_masks, normalised, weigh
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.transfer import to_response
from elastid.model.serial import serial
from elastid.parallel import Progress, silent
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse
from elastid.robot import Robot

# Linearised again until x moves less than this many standard deviations, or this often.
SETTLED = 1e-3
ROUNDS = 5
ROUNDS_OF_LOSS = 30
# A parameter whose effect is this small beside the strongest one's has none; rounding leaves about 1e-16.
NO_EFFECT = 1e-9
# Residuals so many times what the noise explains make one look for a channel with a wrong sign.
FAR_BEYOND_NOISE = 10.0


def identify(
    responses: Sequence[FrequencyResponse],
    robot: Robot,
    spec: FitSpec,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
) -> FitResult:
    """The parameters of `robot` that explain the responses of all configurations.

    seed: of the starts; the result does not depend on `jobs`, the number of processes.  progress(done, starts).
    Raises StudyError for parameters, masks or places that do not exist; DataError where nothing is left to fit;
    FitError for a parameter that reaches no response and where no start leads anywhere.
    """
    check_responses(responses, robot)
    parameters = choose(spec, robot)
    check_masks(responses, spec)
    assembly = Assembly.of(responses, robot, spec, parameters)
    fit = assembly.at(parameters.x, spec.criterion)
    if fit.n_residuals == 0:
        reason = "; ".join(assembly.notes) or "band, masks and the factors of fit.weights leave no line"
        raise DataError(f"nothing is left to fit: {reason}")
    if fit.problem.dof < 1:
        raise DataError(
            f"{fit.n_residuals} real numbers are left to fit {len(parameters.free)} parameters; fix some, or use more "
            "lines"
        )
    refuse_without_effect(fit)
    first = assembly.at(parameters.x, "log") if spec.log_first and spec.criterion == "complex" else fit
    stages = [*widening(first, spec.continuation), *([first] if first is not fit else []), fit]
    starts = spread(parameters, spec.starts, spec.start_factor, seed)
    ranked, hits = multistart([stage.problem for stage in stages], starts, jobs, progress, spec.solver)
    settled = settle(assembly, ranked[0], spec.criterion)
    sure = certainty(settled.fit, assembly.responses, settled.weights, settled.end.x)
    return _result(settled.fit, settled.end, sure, ranked, hits, (*assembly.notes, *settled.notes))


def predict(result: FitResult, robot: Robot, responses: Sequence[FrequencyResponse]) -> tuple[FrequencyResponse, ...]:
    """The fitted model's response for each of `responses`: its lines, inputs, outputs and configuration."""
    theta = result.theta
    models = _linearised(Linearisation.of(serial(robot)), responses, theta)
    return tuple(
        replace(to_response(model, theta, response.freq_hz), rate_is_known=response.rate_is_known)
        for model, response in zip(models, responses, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Assembly:
    """What does not change between linearisations: the measured responses with their weights, and the model."""

    responses: tuple[FrequencyResponse, ...]
    weights: tuple[Weights, ...]
    linearisation: Linearisation
    parameters: ParameterSet
    spec: FitSpec

    @classmethod
    def of(
        cls, responses: Sequence[FrequencyResponse], robot: Robot, spec: FitSpec, parameters: ParameterSet
    ) -> Assembly:
        """Weigh the responses and build the model."""
        weights = tuple(weigh(response, spec) for response in responses)
        if spec.weights.normalise:
            weights = normalised(weights, responses)
        return cls(tuple(responses), weights, Linearisation.of(serial(robot)), parameters, spec)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the weights left out."""
        return tuple(note for weight in self.weights for note in weight.notes)

    def at(self, x: FloatArray, criterion: Criterion) -> ElasticFit:
        """The fit with every configuration linearised at x; elements err one by one where it is but the first stage."""
        models = _linearised(self.linearisation, self.responses, self.parameters.expand(x))
        return elastic_fit(
            self.responses, models, self.weights, self.parameters, criterion, criterion == self.spec.criterion
        )

    def reweighed(self, x: FloatArray) -> Assembly:
        """The same with less weight on what is far off at x, as the study's loss wants it."""
        if self.spec.weights.loss == "square":
            return self
        factors = robust_factors(self.at(x, self.spec.criterion), self.weights, x, self.spec.weights)
        weights = (replace(w, factor=w.factor * factor) for w, factor in zip(self.weights, factors, strict=True))
        return replace(self, weights=tuple(weights))


def widening(fit: ElasticFit, bands: int) -> list[ElasticFit]:
    """Frequency continuation: the fit on the lower 1 / bands, 2 / bands, ... of its lines, all of them not included."""
    freq_hz = np.unique(np.concatenate([part.kernel.freq_hz for part in fit.parts]))
    edges = [freq_hz[math.ceil(len(freq_hz) * band / bands) - 1] for band in range(1, bands)]
    return [replace(fit, parts=tuple(part.below(edge) for part in fit.parts)) for edge in edges]


def refuse_without_effect(fit: ElasticFit) -> None:
    """FitError that names the free parameters which reach none of the responses that count."""
    x = fit.parameters.x
    information = np.diag(fit.evaluate(x).hessian) / 2 - fit.prior_slopes**2
    effect = np.sqrt(np.maximum(information, 0.0)) * _span(fit.parameters)
    silent_ones = effect <= NO_EFFECT * effect.max()
    if silent_ones.any():
        names = ", ".join(name for name, none in zip(fit.parameters.free_names, silent_ones, strict=True) if none)
        raise FitError(
            f"{names}: without effect on any of the {len(fit.parts)} frequency responses, so that no fit can find it; "
            f"fix it (fit.parameters: {{{names.split(', ')[0]}: {{fixed: true}}}}), or measure what it moves"
        )


def _span(parameters: ParameterSet) -> FloatArray:
    """A change of x that means something: a factor e, or the bounds of a linear parameter."""
    return np.array(
        [1.0 if p.log or not np.isfinite(p.upper - p.lower) else p.upper - p.lower for p in parameters.free]
    )


@dataclass(frozen=True, eq=False)
class Settled:
    """Where a fit came to rest: the end, its fit and weights there, and a word where it did not."""

    end: Start
    fit: ElasticFit
    weights: tuple[Weights, ...]
    notes: tuple[str, ...] = ()


def settle(assembly: Assembly, start: Start, criterion: Criterion) -> Settled:
    """Linearise, and weigh as the loss wants it, at the result and solve again until x stays."""
    rounds = ROUNDS if assembly.spec.weights.loss == "square" else ROUNDS_OF_LOSS
    end = start
    for _ in range(rounds):
        try:
            there = assembly.reweighed(end.x)
            fit = there.at(end.x, criterion)
        except StudyError as error:
            raise FitError(f"the best start ended where the robot cannot stand: {error}") from None
        before, end = end, solve(fit.problem, end.x, method=assembly.spec.solver)
        moved = distance(end.x - before.x, fit.evaluate(end.x), fit.problem.dof)
        if moved < SETTLED:
            return Settled(end, fit, there.weights)
    note = (
        "the operating point under gravity, or the weights of fit.weights.loss, still move: "
        f"round {rounds} of {rounds} changed the estimate by {moved:.2g} standard deviations"
    )
    return Settled(end, fit, there.weights, (note,))


def _linearised(
    linearisation: Linearisation, responses: Sequence[FrequencyResponse], theta: FloatArray
) -> list[LinearModel]:
    """The model of each response at theta, with its inputs and outputs in its order; theta ends with the delay."""
    return [
        matched(linearisation.at(response.configuration, theta[:-1], response.outputs, response.quantity), response)
        for response in responses
    ]


def _result(
    fit: ElasticFit, end: Start, sure: Certainty, ranked: tuple[Start, ...], hits: int, notes: tuple[str, ...]
) -> FitResult:
    dof = fit.problem.dof
    # Without any noise (a simulation) there is nothing to compare with but the weights.
    expected = sure.expected_cost if sure.expected_cost > 1e-12 * dof else dof
    result = FitResult(
        parameters=fit.parameters,
        x=end.x,
        covariance=sure.covariance,
        cost=end.cost,
        dof=dof,
        cost_expected=float(expected),
        status="converged",
        message="",
        starts=ranked,
        hits=hits,
        at_bound=at_bound(fit.parameters, end.x),
        singular_values=sure.singular_values,
        criterion=fit.parts[0].criterion,
    )
    share = explained(fit, end.x, result.cost_expected)
    status, message = status_and_message(result, end, sure.unreached, share)
    signs = sign_words(fit, end.x, end.cost) if result.model_error > FAR_BEYOND_NOISE else ()
    apart = apart_words(fit, end.x) if result.model_error > 1 else ()
    found = findings(result, sure.unreached)
    return replace(result, status=status, message=message, warnings=(*signs, *apart, *notes, *found))
