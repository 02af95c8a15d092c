r"""identify: measured responses and a robot -> elastic parameters with their certainty, and predict, its inverse.

    choose -> weigh -> linearise -> search (log, then the criterion, from many starts) -> settle -> certainty

Settle: the operating point moves with the stiffnesses under gravity, so the model is linearised again at the result
and solved again until nothing moves. Where springs are nonlinear the search itself linearises at every step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import DataError, FitError, StudyError
from elastid.fit.certainty import Certainty, certainty
from elastid.fit.choose import choose
from elastid.fit.elastic import ElasticFit, elastic_fit, matched
from elastid.fit.explained import explained, sign_words
from elastid.fit.findings import at_bound, findings, status_and_message
from elastid.fit.moving import MovingFit
from elastid.fit.multistart import multistart, spread
from elastid.fit.problem import LeastSquares
from elastid.fit.residuals import Criterion
from elastid.fit.result import FitResult, Start
from elastid.fit.solvers import distance, solve
from elastid.fit.spec import FitSpec
from elastid.fit.weights import Weights, check_masks, weigh
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.preload import spring_words
from elastid.linear.transfer import to_response
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.parallel import Progress, silent
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse
from elastid.robot import Robot

# Linearised again until x moves less than this many standard deviations, or this often.
SETTLED = 1e-3
ROUNDS = 5
# A parameter whose effect is this small beside the strongest one's has none; rounding leaves about 1e-16.
NO_EFFECT = 1e-9
# Residuals so many times what the noise explains make one look for a channel with a wrong sign.
FAR_BEYOND_NOISE = 10.0


def identify(
    responses: Sequence[FrequencyResponse],
    robot: Robot,
    spec: FitSpec,
    *,
    model: ModelSpec = EXACT,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
) -> FitResult:
    """The parameters of `robot` that explain the responses of all configurations.

    model: the formulation of the equations.  seed: of the starts; the result does not depend on `jobs`, the number of
    processes.  progress(done, starts).
    Raises StudyError for parameters, masks or places that do not exist; DataError where nothing is left to fit;
    FitError for a parameter that reaches no response and where no start leads anywhere.
    """
    parameters = choose(spec, robot)
    check_masks(responses, spec.mask)
    assembly = Assembly.of(responses, robot, spec, parameters, model)
    fit = assembly.at(parameters.x, spec.criterion)
    if fit.n_residuals == 0:
        raise DataError("nothing is left to fit: " + " ".join(assembly.notes or ("band and masks leave no line",)))
    if fit.problem.dof < 1:
        raise DataError(
            f"{fit.n_residuals} real numbers are left to fit {len(parameters.free)} parameters; fix some, or use more "
            "lines"
        )
    refuse_without_effect(fit)
    criteria: list[Criterion] = ["log"] if spec.log_first and spec.criterion == "complex" else []
    stages = [assembly.problem(parameters.x, criterion) for criterion in (*criteria, spec.criterion)]
    starts = spread(parameters, spec.starts, spec.start_factor, seed)
    ranked, hits = multistart(stages, starts, jobs, progress)
    end, fit, moved = settle(assembly, ranked[0], spec.criterion)
    sure = certainty(fit, assembly.responses, assembly.weights, end.x)
    return _result(fit, end, sure, ranked, hits, (*assembly.notes, *moved, *assembly.spring_words(end.x)))


def predict(
    result: FitResult, robot: Robot, responses: Sequence[FrequencyResponse], model: ModelSpec = EXACT
) -> tuple[FrequencyResponse, ...]:
    """The fitted model's response for each of `responses`: its lines, inputs, outputs and configuration."""
    theta = result.theta
    models = _linearised(Linearisation.of(formulate(robot, model)), responses, theta)
    return tuple(
        replace(to_response(linear, theta, response.freq_hz), rate_is_known=response.rate_is_known)
        for linear, response in zip(models, responses, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Assembly:
    """What does not change between linearisations: the measured responses with their weights, and the model."""

    responses: tuple[FrequencyResponse, ...]
    weights: tuple[Weights, ...]
    linearisation: Linearisation
    parameters: ParameterSet

    @classmethod
    def of(
        cls,
        responses: Sequence[FrequencyResponse],
        robot: Robot,
        spec: FitSpec,
        parameters: ParameterSet,
        model: ModelSpec = EXACT,
    ) -> Assembly:
        """Weigh the responses and build the model."""
        weights = tuple(weigh(response, spec) for response in responses)
        return cls(tuple(responses), weights, Linearisation.of(formulate(robot, model)), parameters)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the weights left out."""
        return tuple(note for weight in self.weights for note in weight.notes)

    def spring_words(self, x: FloatArray) -> tuple[str, ...]:
        """Springs that no one stiffness describes where the robot rests at x."""
        model, theta = self.linearisation.model, self.parameters.expand(x)[:-1]
        configurations = {response.configuration.name: response.configuration for response in self.responses}
        return spring_words(model, theta, [equilibrium(model, theta, one) for one in configurations.values()])

    def at(self, x: FloatArray, criterion: Criterion) -> ElasticFit:
        """The fit with every configuration linearised at x."""
        models = _linearised(self.linearisation, self.responses, self.parameters.expand(x))
        return elastic_fit(self.responses, models, self.weights, self.parameters, criterion)

    def problem(self, x: FloatArray, criterion: Criterion) -> LeastSquares:
        """What the search solves: linearised at x once, or anew wherever it gets to if springs are nonlinear."""
        fit = self.at(x, criterion)
        if not self.linearisation.follows:
            return fit.problem
        return MovingFit(partial(self.at, criterion=criterion), fit).problem


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


def settle(assembly: Assembly, start: Start, criterion: Criterion) -> tuple[Start, ElasticFit, tuple[str, ...]]:
    """Linearise at the result and solve again until x stays: the end, its fit, and a word where it does not."""
    end = start
    for _ in range(ROUNDS):
        try:
            fit = assembly.at(end.x, criterion)
        except StudyError as error:
            raise FitError(f"the best start ended where the robot cannot stand: {error}") from None
        before, end = end, solve(fit.problem, end.x)
        moved = distance(end.x - before.x, fit.evaluate(end.x), fit.problem.dof)
        if moved < SETTLED:
            return end, fit, ()
    note = (
        f"the operating point under gravity still moves: linearisation {ROUNDS} of {ROUNDS} changed the estimate by "
        f"{moved:.2g} standard deviations"
    )
    return end, fit, (note,)


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
    return replace(result, status=status, message=message, warnings=(*signs, *notes, *findings(result, sure.unreached)))
