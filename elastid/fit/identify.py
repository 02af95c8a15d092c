r"""identify: measured responses and a robot -> elastic parameters with their certainty, and predict, its inverse.

    choose -> weigh -> linearise -> search (log, then the criterion, from many starts) -> settle -> certainty

Settle: the operating point moves with the stiffnesses under gravity, so the model is linearised again at the result
and solved again until nothing moves. Where springs are nonlinear the search itself linearises at every step.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import DataError, FitError
from elastid.fit import geometry
from elastid.fit.assembly import Assembly, Settled, linearised, settle, widening
from elastid.fit.between import is_in_error
from elastid.fit.certainty import Certainty, certainty
from elastid.fit.choose import choose
from elastid.fit.disagreement import disagreement
from elastid.fit.elastic import ElasticFit
from elastid.fit.explained import apart_words, explained
from elastid.fit.findings import at_bound, findings, status_and_message
from elastid.fit.inputs import alike_words, check_responses, posture_words
from elastid.fit.intervals import further_intervals
from elastid.fit.misread import foreign_words, frequency_words, misread_words
from elastid.fit.multistart import Interrupted, multistart, spread
from elastid.fit.physical import border_words, possible
from elastid.fit.result import FitResult, Start
from elastid.fit.spec import FitSpec
from elastid.fit.weights import check_masks
from elastid.linear.linearise import Linearisation
from elastid.linear.transfer import to_response
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.parallel import Progress, silent
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse
from elastid.robot import Robot

# A parameter whose effect is this small beside the strongest one's has none; rounding leaves about 1e-16.
NO_EFFECT = 1e-9
# Residuals so many times what the noise explains make one look for channels that were misread.
FAR_BEYOND_NOISE = 10.0
# So does a model that explains less than this share of responses whose noise is unknown.
FAIRLY_EXPLAINED = 0.9


def identify(
    responses: Sequence[FrequencyResponse],
    robot: Robot,
    spec: FitSpec,
    *,
    model: ModelSpec = EXACT,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
    finished: MutableMapping[str, Any] | None = None,
) -> FitResult:
    """The parameters of `robot` that explain the responses of all configurations.

    model: the formulation of the equations.  seed: of the starts; the result does not depend on `jobs`, the number of
    processes.  progress(done, starts).  finished: where each start, profile and repetition is kept as soon as it is
    done, and taken from where it was done before, of the same arguments; a dict, or one that outlives the process.
    Raises StudyError for parameters, masks or places that do not exist; DataError where nothing is left to fit;
    FitError for a parameter that reaches no response and where no start leads anywhere; Interrupted, with the starts
    that were done, on Ctrl-C once the search has begun.
    """
    check_responses(responses, robot)
    parameters = choose(spec, robot, [response.configuration.name for response in responses])
    check_masks(responses, spec)
    geometry.refuse(parameters, robot, {r.configuration.name: r.configuration.angles for r in responses})
    assembly = Assembly.of(responses, robot, spec, parameters, model)
    fit = assembly.at(parameters.x, spec.criterion)
    if fit.n_residuals == 0:
        reason = "; ".join(assembly.notes) or "band, masks and the factors of fit.weights leave no line"
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
    starts = possible(spread(parameters, spec.starts, spec.start_factor, seed), fit.shapes, parameters)
    finished = {} if finished is None else finished
    ranked, hits = multistart(stages, starts, jobs, progress, spec.solver, finished)
    try:
        return _concluded(assembly, ranked, hits, seed, jobs, progress, finished)
    except KeyboardInterrupt:
        raise Interrupted(ranked) from None


def _concluded(
    assembly: Assembly,
    ranked: tuple[Start, ...],
    hits: int,
    seed: int,
    jobs: int,
    progress: Progress,
    finished: MutableMapping[str, Any],
) -> FitResult:
    """What is made of the best start: settled, with its certainty and the intervals that the study asks for."""
    spec, responses = assembly.spec, assembly.responses
    settled = settle(assembly, ranked[0], spec.criterion)
    sure = certainty(settled.fit, responses, settled.weights, settled.end.x)
    twice = alike_words(responses) or posture_words(responses, assembly.parameters, spec.robots)
    notes = (*twice, *assembly.notes, *settled.notes, *assembly.spring_words(settled.end.x))
    result = _result(settled, sure, ranked, hits, notes, spec.robots)
    return further_intervals(result, settled, spec, seed, jobs, progress, finished)


def predict(
    result: FitResult, robot: Robot, responses: Sequence[FrequencyResponse], model: ModelSpec = EXACT
) -> tuple[FrequencyResponse, ...]:
    """The fitted model's response for each of `responses`: its lines, inputs, outputs and configuration."""
    equations = formulate(robot, model, result.parameters.names)
    models = linearised(Linearisation.of(equations), responses, result.parameters, result.x)
    return tuple(
        replace(
            to_response(linear, result.theta_of(linear.configuration.name), response.freq_hz),
            rate_is_known=response.rate_is_known,
        )
        for linear, response in zip(models, responses, strict=True)
    )


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


def _result(
    settled: Settled,
    sure: Certainty,
    ranked: tuple[Start, ...],
    hits: int,
    notes: tuple[str, ...],
    robots: Mapping[str, Sequence[str]],
) -> FitResult:
    fit, end = settled.fit, settled.end
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
        configurations=tuple(part.kernel.model.configuration.name for part in fit.parts),
        share=sure.informed.share,
        informing_hz=sure.informed.band_hz,
        weakest=sure.informed.weakest,
    )
    # Where no noise was measured, the residuals are the only measure of it, and no excuse for themselves.
    noise_is_known = any(weights.noise is not None for weights in settled.weights)
    share = explained(fit, end.x, result.cost_expected if noise_is_known else 0.0)
    suspect = result.model_error > FAR_BEYOND_NOISE if noise_is_known else share < FAIRLY_EXPLAINED
    misread = misread_words(fit, end.x, end.cost) if suspect else ()
    status, message = status_and_message(result, end, sure.unreached, share, noise_is_known, bool(misread))
    apart = apart_words(fit, end.x) if result.model_error > 1 else ()
    if not apart and not misread and is_in_error(result.cost, result.cost_expected, dof):
        apart = disagreement(fit, end.x, end.cost, result.cost_expected, robots)
    apart = apart or (foreign_words(fit, end.x) if suspect and not misread else ())
    found = (*border_words(fit.shapes, fit.parameters, end.x), *findings(result, sure.unreached))
    words = (*misread, *frequency_words(result), *apart, *notes, *found)
    return replace(result, parameters=fit.parameters.with_means(end.x), status=status, message=message, warnings=words)
