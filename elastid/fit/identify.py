r"""identify: measured responses and a robot -> elastic parameters with their uncertainty.

    choose -> weigh -> linearise -> search (log, then the criterion, from many starts) -> settle -> certainty

Settle: the operating point moves with the stiffnesses under gravity, so the model is linearised again at the result
and solved again until nothing moves. Where springs are nonlinear the search itself linearises at every step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, FitError
from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.fit.diagnosis.diagnosis import diagnosed, with_status
from elastid.fit.diagnosis.findings import at_bound
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.inertia_barrier import possible
from elastid.fit.result import FitResult, LocalOptimum
from elastid.fit.setup import geometry
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum, settle, widening
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.setup.response_checks import alike_words, check_responses, posture_words
from elastid.fit.solve.multistart import Interrupted, multistart, spread
from elastid.fit.spec import FitSpec
from elastid.fit.uncertainty.covariance import Uncertainty, certainty
from elastid.fit.uncertainty.intervals import further_intervals
from elastid.fit.weights.weights import check_masks
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse
from elastid.robot import Robot

# A parameter whose effect is this small beside the strongest one's has none; rounding leaves about 1e-16.
NO_EFFECT = 1e-9


def identify(
    responses: Sequence[FrequencyResponse],
    robot: Robot,
    spec: FitSpec,
    *,
    model: ModelSpec = EXACT,
    execution: Execution | None = None,
) -> FitResult:
    """The parameters of `robot` that explain the responses of all configurations.

    model: the formulation of the equations.  execution: how the starts, profiles and repetitions are computed; the
    result does not depend on it.
    Raises StudyError for parameters, masks or places that do not exist; DataError where nothing is left to fit;
    FitError for a parameter that reaches no response and where no start leads anywhere; Interrupted, with the starts
    that were done, on Ctrl-C once the search has begun.
    """
    execution = execution or Execution()
    assembly, ranked, hits = _searched(responses, robot, spec, model, execution)
    try:
        settled, sure, result = _settled(assembly, ranked, hits)
        result = diagnosed(result, settled, sure, _notes(assembly, settled), spec.robots)
        return further_intervals(result, settled, spec, execution)
    except KeyboardInterrupt:
        raise Interrupted(ranked) from None


def fit_parameters(
    responses: Sequence[FrequencyResponse], robot: Robot, spec: FitSpec, *, model: ModelSpec = EXACT
) -> FitResult:
    """The same estimate and status, for fits that are many and compared: no look at what may be wrong with the
    responses, no interval beyond the covariance.  Arguments and errors as `identify`.
    """
    assembly, ranked, hits = _searched(responses, robot, spec, model, Execution())
    settled, sure, result = _settled(assembly, ranked, hits)
    return with_status(result, settled, sure)


def _searched(
    responses: Sequence[FrequencyResponse],
    robot: Robot,
    spec: FitSpec,
    model: ModelSpec,
    execution: Execution,
) -> tuple[Assembly, tuple[LocalOptimum, ...], int]:
    """What is fitted, where all starts ended, and how many of them at the best."""
    check_responses(responses, robot)
    parameters = choose(spec, robot, [response.configuration.name for response in responses])
    check_masks(responses, spec)
    geometry.refuse(parameters, robot, {r.configuration.name: r.configuration.angles for r in responses})
    assembly = Assembly.of(responses, robot, spec, parameters, model)
    fit = assembly.at(parameters.x, spec.criterion)
    if fit.n_residuals == 0:
        reason = "; ".join(map(str, assembly.notes)) or "band, masks and the factors of fit.weights leave no line"
        raise DataError(f"nothing is left to fit: {reason}")
    if fit.problem.dof < 1:
        raise DataError(
            f"{fit.n_residuals} real numbers are left to fit {len(parameters.free)} parameters; fix some, or use more "
            "lines"
        )
    refuse_without_effect(fit, robot)
    first = assembly.at(parameters.x, "log") if spec.log_first and spec.criterion == "complex" else fit
    criterion = "log" if first is not fit else spec.criterion
    stages = [assembly.searched(stage, criterion) for stage in (*widening(first, spec.continuation), first)]
    stages += [assembly.searched(fit, spec.criterion)] if first is not fit else []
    starts = possible(spread(parameters, spec.starts, spec.start_factor, spec.seed or 0), fit.shapes, parameters)
    ranked, hits = multistart(stages, starts, spec.solver, execution)
    return assembly, ranked, hits


def _settled(
    assembly: Assembly, ranked: tuple[LocalOptimum, ...], hits: int
) -> tuple[RelinearisedOptimum, Uncertainty, FitResult]:
    """The best start at rest, with its certainty, as a result that does not know yet how it ended."""
    settled = settle(assembly, ranked[0], assembly.spec.criterion)
    sure = certainty(settled.fit, assembly.responses, settled.weights, settled.end.x)
    return settled, sure, _result(settled, sure, ranked, hits)


def _notes(assembly: Assembly, settled: RelinearisedOptimum) -> tuple[Note, ...]:
    """What is known before the result is looked at: what counts twice, what was left out, what still moves."""
    responses = assembly.responses
    twice = alike_words(responses) or posture_words(responses, assembly.parameters, assembly.spec.robots)
    return (*twice, *assembly.notes, *settled.notes, *assembly.spring_words(settled.end.x))


def refuse_without_effect(fit: ElasticFit, robot: Robot) -> None:
    """FitError that names the free parameters which reach none of the responses that count."""
    x = fit.parameters.x
    information = np.diag(replace(fit, shapes=()).evaluate(x).hessian) / 2 - fit.prior_slopes**2
    effect = np.sqrt(np.maximum(information, 0.0)) * _span(fit.parameters)
    silent_ones = effect <= NO_EFFECT * effect.max()
    if silent_ones.any():
        names = ", ".join(name for name, none in zip(fit.parameters.free_names, silent_ones, strict=True) if none)
        places = any(name.partition("@")[0] in robot.geometry for name in names.split(", "))
        hint = "; a coordinate along the axis of a joint does nothing, one across it may from another start"
        raise FitError(
            f"{names}: without effect on any of the {len(fit.parts)} frequency responses, so that no fit can find it; "
            f"fix it (fit.parameters: {{{names.split(', ')[0]}: {{fixed: true}}}}), or measure what it moves"
            + (hint if places else "")
        )


def _span(parameters: ParameterSet) -> FloatArray:
    """A change of x that means something: a factor e, or the bounds of a linear parameter."""
    return np.array(
        [1.0 if p.log or not np.isfinite(p.upper - p.lower) else p.upper - p.lower for p in parameters.free]
    )


def _result(settled: RelinearisedOptimum, sure: Uncertainty, ranked: tuple[LocalOptimum, ...], hits: int) -> FitResult:
    fit, end = settled.fit, settled.end
    dof = fit.problem.dof
    # Without any noise (a simulation) there is nothing to compare with but the weights.
    expected = sure.expected_cost if sure.expected_cost > 1e-12 * dof else dof
    return FitResult(
        parameters=fit.parameters.with_means(end.x),
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
        configurations=tuple(part.kernel.model.configuration.name for part in fit.parts),
        share=sure.informed.share,
        informing_hz=sure.informed.band_hz,
        weakest=sure.informed.weakest,
    )
