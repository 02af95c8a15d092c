r"""identify: measured responses and a robot -> elastic parameters with their uncertainty.

    choose -> weigh -> linearise -> search (log, then the criterion, from many starts) -> relinearise -> uncertainty

If the study declares no model error, the search uses the typical one. The estimate uses none, or, if the residuals
exceed the noise, the smallest one with which they do not.

The operating point under gravity depends on the stiffnesses. The model is therefore linearised again at the optimum and
solved again until x converges. With nonlinear springs the search linearises at every step.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, values_by_name
from elastid.base.errors import DataError, FitError, StudyError, check_kind, notes_of
from elastid.base.execution import Execution, persistent_workers
from elastid.fit.covariance import Uncertainty, estimate_uncertainty
from elastid.fit.diagnosis.delay_hypotheses import common_delay
from elastid.fit.diagnosis.estimate_notes import at_bound
from elastid.fit.diagnosis.hypotheses import WITHOUT_OTHER_ROBOTS, all_hypotheses
from elastid.fit.diagnosis.hypothesis import Evidence, Hypothesis
from elastid.fit.diagnosis.priors import contradicted_priors, contradicted_tolerances
from elastid.fit.diagnosis.rank_hypotheses import RESIDUALS, diagnose, rank_causes
from elastid.fit.diagnosis.refit import line_subset
from elastid.fit.frf_problem import (
    Assembly,
    NoEquilibriumError,
    RelinearisedOptimum,
    is_distorted_by_friction,
    is_friction_compensated,
    model_error_of_residuals,
    relinearise,
)
from elastid.fit.intervals import add_intervals
from elastid.fit.load_tests import StaticAgreement, ToolAgreement
from elastid.fit.parameter_selection import choose, tolerances_of, with_ratio_std, with_tolerances
from elastid.fit.presliding import are_identified, find_presliding, without_presliding
from elastid.fit.problem.frf_residuals import ElasticFit, chunk_execution, map_chunks
from elastid.fit.problem.inertia_barrier import feasible_starts
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.problem.weights import check_factors, weigh, with_model_error
from elastid.fit.result import Result
from elastid.fit.solve.solvers import FINE, NEAR, latin_hypercube, multistart, solve
from elastid.fit.spec import TYPICAL_MODEL_ERROR, FitSpec
from elastid.linear.linear_model import is_load
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import DELAY, Parameters
from elastid.record import REFERENCE
from elastid.response import Response
from elastid.robot import Robot, channel_name

if TYPE_CHECKING:
    from elastid.fit.problem.static_loads import PlacedTest


def identify(
    responses: Sequence[Response], robot: Robot, spec: FitSpec, *, model: ModelSpec = EXACT,
    execution: Execution | None = None, hypotheses: tuple[Hypothesis, ...] | None = None,
    parameters: Parameters | None = None, loads: "Sequence[PlacedTest]" = (),
) -> Result:  # fmt: skip
    """Estimate the parameters of `robot` from the responses of all configurations and static load tests.

    model: formulation of the equations.  execution: of starts, profiles and bootstrap repetitions; the result does not
    depend on it.  hypotheses: causes of residuals for the diagnosis; by default all, including those of other packages
    (entry points elastid.causes).  parameters: replace spec.parameters; by default `choose`.  loads: load tests in
    their configurations (`placed_tests`), whose deflections are further residuals. Raises StudyError for unknown
    parameters or locations.  DataError if no data remain.  FitError for a parameter without effect, if every start
    fails, or if no equilibrium exists at the optimum and on the way back to the start.
    """
    return identify_with_motion_bias(responses, robot, spec, model, execution, hypotheses, parameters, loads)[0]


@persistent_workers()
def identify_with_motion_bias(
    responses: Sequence[Response], robot: Robot, spec: FitSpec, model: ModelSpec = EXACT,
    execution: Execution | None = None, hypotheses: tuple[Hypothesis, ...] | None = None,
    parameters: Parameters | None = None, loads: "Sequence[PlacedTest]" = (),
) -> tuple[Result, dict[str, ComplexArray]]:  # fmt: skip
    """Return the result of `identify`, and the motion-induced bias (F, n_y, n_u) of each response by configuration."""
    execution = execution or Execution()
    hypotheses = all_hypotheses() if hypotheses is None else hypotheses
    assembly, ends = _search(responses, robot, spec, model, execution, parameters, loads)
    try:
        try:
            estimate = _with_model_error(assembly, spec, ends, execution.quiet)
            assembly, optimum, uncertainty, result = _with_agreements(estimate, assembly, spec, ends)
            evidence = rank_causes(result, assembly, optimum, uncertainty, execution.quiet, hypotheses)
            evidence, previous = _with_springs(evidence, spec, ends, hypotheses), evidence.result
            assembly, optimum, result = evidence.assembly, evidence.optimum, evidence.result
        except StudyError as error:  # no equilibrium along the search
            raise NoEquilibriumError(error) from None
        if robot.tolerances is None or not (result.has_tolerances and evidence.result.status == "model_error"):
            notes = *notes_of(assembly.weights), *optimum.notes, *assembly.spring_notes(optimum.x)
            result = add_intervals(diagnose(evidence, notes), optimum, spec, execution)
            notes = *result.notes, *contradicted_priors(result), *contradicted_tolerances(result)
            result = replace(result, notes=notes)
            result = without_presliding(result, assembly, previous)
            pairs = zip(assembly.responses, optimum.responses, strict=True)
            effects = {G.configuration.name: G.G - rested.G for G, rested in pairs if rested.G is not G.G}
            return result, effects
    except FitError as error:
        if not isinstance(error, NoEquilibriumError) or robot.tolerances is None:
            if not loads:
                raise
            fit_parameters(responses, robot, spec, model=model)  # raises if the responses are the cause
            text = f"{error}; the responses alone can be fitted: check units, signs and directions of the load tests"
            raise FitError("fit/loads", text) from None
    # A gross fault also biases the nuisance parameters, which hides its cause: fit again with exact values.
    return identify_with_motion_bias(
        responses, replace(robot, tolerances=None), spec, model, execution, hypotheses, parameters, loads
    )


def _with_springs(evidence: Evidence, spec: FitSpec, ends: "_Ends", hypotheses: tuple[Hypothesis, ...]) -> Evidence:
    """Add relaxing springs of motors to the fit if they are significant and the extended fit converges."""
    (starts, n_converged), quiet = ends, evidence.execution
    try:
        if (extension := find_presliding(evidence)) is None:
            return evidence
        assembly, begin = extension[0], (replace(starts[0], x=extension[1]), *starts[1:])
        near = evidence.optimum if evidence.optimum.end.converged else None
        assembly, optimum, uncertainty, result = _with_model_error(assembly, spec, (begin, n_converged), quiet, near)
        if not are_identified(result, assembly.linearisation.presliding):
            return evidence
        trial = rank_causes(result, assembly, optimum, uncertainty, quiet, hypotheses)
    except (StudyError, FitError, np.linalg.LinAlgError):  # no equilibrium along the search
        return evidence
    # A relaxing spring that drives another parameter to its bound replaces this parameter and is rejected.
    is_new_bound = trial.result.status == "at_bound" != evidence.result.status
    return trial if trial.result.status in ("converged", "at_bound", "misfit") and not is_new_bound else evidence


def fit_parameters(responses: Sequence[Response], robot: Robot, spec: FitSpec, *, model: ModelSpec = EXACT) -> Result:
    """Estimate the parameters without profiles, bootstrap and hypotheses of other robots, to compare fits."""
    bare = replace(spec, profile=(), bootstrap=0)
    return identify(responses, robot, bare, model=model, hypotheses=WITHOUT_OTHER_ROBOTS)


def _search(
    responses: Sequence[Response], robot: Robot, spec: FitSpec, model: ModelSpec, execution: Execution,
    parameters: Parameters | None = None, loads: "Sequence[PlacedTest]" = (),
) -> "tuple[Assembly, _Ends]":  # fmt: skip
    check_kind(spec, FitSpec, "spec", "FitSpec() has the defaults, and a study has one as study.seeded_fit")
    check_kind(parameters, Parameters | None, "parameters", "elastid.choose(robot, 'k_*') makes them")
    check_responses(responses, robot)
    responses = [with_ratio_std(response, robot) for response in responses]
    has_references = any(response.controller is not None for response in responses)
    names = [response.configuration.name for response in responses]
    parameters = parameters or choose(spec, robot, names, has_references)
    check_factors(responses, spec)
    # With weights from noise alone, DFT lines at resonances would lead the search to local minima.
    search_spec = with_model_error(spec, TYPICAL_MODEL_ERROR) if spec.weights.model_error is None else spec
    home = chunk_execution(responses, execution)
    weights = tuple(map_chunks(partial(weigh, spec=search_spec), responses, home))
    assembly = Assembly.of(responses, robot, search_spec, parameters, model, loads, weights, home)
    fit = assembly.at(parameters.x)
    if fit.n_residuals == 0:
        reason = "; ".join(map(str, notes_of(weights))) or "fit.band_hz and the factors of fit.weights leave no line"
        raise DataError("fit/not-identifiable", reason, "nothing is left to fit")
    if fit.problem.dof < 1:
        counts = f"{fit.n_residuals} real numbers are left to fit {len(fit.parameters.free)} parameters"
        raise DataError("fit/not-identifiable", f"{counts}; fix some, or use more lines")
    check_effects(fit, robot)
    assembly, fit = _from_common_delay(assembly, fit, spec)
    starts, n_converged = _from_all_starts(assembly, fit, spec, execution)
    if next(tolerances_of(robot), None) is not None:
        assembly, starts = free_nuisance_parameters(assembly, starts, robot, loads)
    return assembly, (starts, n_converged)


def _from_common_delay(assembly: Assembly, fit: ElasticFit, spec: FitSpec) -> tuple[Assembly, ElasticFit]:
    """Start free delays of zero at the common delay of the responses. Returns the fit at its new start."""
    unknown = [p.name for p in fit.parameters.free if p.name.startswith(DELAY) and p.value == 0]
    if not unknown or not (T := common_delay(fit, fit.parameters.x)):
        return assembly, fit
    of_torques = [name for name in unknown if name.startswith(channel_name(DELAY, "u"))]
    # A late torque signal looks like an early motion.
    delays = dict.fromkeys(of_torques, -T) or dict.fromkeys(unknown, T)
    of_all = (replace(p, value=float(np.clip(delays.get(p.name, p.value), p.lower, p.upper))) for p in fit.parameters)
    assembly = replace(assembly, parameters=Parameters(tuple(of_all)))
    return assembly, assembly.at(assembly.parameters.x)


def check_responses(responses: Sequence[Response], robot: Robot) -> None:
    """Raise DataError for responses that do not belong to this robot or cannot be fitted together.

    These are: no response, one configuration twice or under two names, a wrong number of angles, unknown locations, and
    known together with unknown sampling rates.  Raises TypeError for arguments of another type.
    """
    check_kind(responses, Sequence, "responses", "give a sequence of Response, such as [response]")
    for response in responses:
        check_kind(response, Response, "one of the responses", "read_responses and estimate make them")
    check_kind(robot, Robot, "robot", "elastid.read_robot(path) reads one")
    if not responses:
        raise DataError("fit/responses", "there is no response to fit; measure at least one configuration")
    names = Counter(response.configuration.name for response in responses)
    if twice := sorted(name for name, count in names.items() if count > 1):
        raise DataError(
            "fit/responses",
            f"two responses for configuration {', '.join(twice)}: its lines would count twice. Remove one, or give "
            "separate measurements different names",
        )
    for response in responses:
        _check_robot(response, robot)
    first_name = dict[int, str]()  # names of configurations by the hash of their numbers: there may be thousands
    for response in (response for response in responses if response.uncertainty is not None):
        name, numbers = response.configuration.name, hash((response.inputs, response.outputs, response.G.tobytes()))
        if first_name.setdefault(numbers, name) != name:
            raise DataError(
                "fit/responses",
                f"the responses of {first_name[numbers]} and {name} are the same numbers: "
                "one measurement under two names, or one file for two postures; leave one of them out",
            )
    if len({response.has_rate for response in responses}) > 1:
        unknown = ", ".join(r.configuration.name for r in responses if not r.has_rate)
        text = f"the lines of {unknown} are in units of an unknown sampling rate, the others in Hz"
        raise DataError("fit/responses", text)


def _check_robot(response: Response, robot: Robot) -> None:
    place, angles = f"configuration {response.configuration.name}", response.configuration.angles
    advice = "is this response from another robot?"
    if refusal := robot.count_refusal(angles.size):
        raise DataError("fit/responses", f"{place}: {refusal}" + (f"; {advice}" if angles.size else ""))
    at_tool = any(map(is_load, response.inputs))
    locations = robot.load_locations if at_tool else robot.motor_locations
    if response.controller is not None:
        locations = tuple(f"{REFERENCE}{name}" for name in robot.driven_names)
    if unknown := [name for name in response.inputs if name not in locations]:
        text = f"robot {robot.name} has no input {', '.join(unknown)}. Possible inputs: {', '.join(locations)}"
        both = ". Use either motor torques or forces at frames in one response" if at_tool else ""
        raise DataError("fit/responses", f"{text}{both}; {advice}", place)
    refusal, still = "", ", ".join(location for location in response.outputs if location.startswith("motor "))
    if response.motors != "free" and not at_tool:
        refusal = f"its inputs are motor torques, but its motors are {response.motors}. Set motors: free"
    elif response.motors == "locked" and still:
        refusal = f"nothing moves at {still} while the motors are locked. Remove this output"
    elif response.motors == "controlled" and (response.loop is None or np.any(response.loop.ki)):
        refusal = "its motors are controlled; give their loop, stiffness kp and damping kd without ki"
    if refusal:
        raise DataError("fit/responses", refusal, place)
    for location in response.outputs:
        try:
            robot.check_location(location)
        except StudyError as error:
            raise DataError("fit/responses", f"an output, {error}; {advice}", place) from None


def check_effects(fit: ElasticFit, robot: Robot) -> None:
    """Raise FitError that lists free parameters without effect on the responses."""
    parameters = fit.parameters
    information = np.diag(replace(fit, inertias=()).evaluate(parameters.x).hessian) / 2 - parameters.prior_slopes**2
    # A plausible change of x: a factor e, or the range of the bounds of a linear parameter.
    spans = [1.0 if p.log or not np.isfinite(p.upper - p.lower) else p.upper - p.lower for p in parameters.free]
    effect = np.sqrt(np.maximum(information, 0.0)) * np.array(spans)
    without = effect <= 1e-9 * effect.max()  # rounding leaves about 1e-16
    if without.any():
        names = ", ".join(name for name, none in zip(parameters.free_names, without, strict=True) if none)
        has_geometry = any(name.partition("@")[0] in robot.geometry for name in names.split(", "))
        hint = ". Coordinates along the axis of a joint have no effect" * has_geometry
        raise FitError(
            "fit/not-identifiable",
            f"{names}: not identifiable, without effect on the frequency responses. Fix it "
            f"(`{names.split(', ')[0]}: {{fixed: true}}`), or measure a signal that it changes{hint}",
        )


def _from_all_starts(assembly: Assembly, fit: ElasticFit, spec: FitSpec, execution: Execution) -> "_Ends":
    """Search from all starts. Return the optima, best first, and how many reached the best. fit: at the first start."""
    parameters, problems = fit.parameters, [assembly.search_problem(fit)]
    if spec.criterion == "complex":
        log = assembly.at(parameters.x, "log")
        if not assembly.is_local:  # fewer residuals lead to the same minimum
            log = replace(log, frfs=tuple(map_chunks(line_subset(log, RESIDUALS // 3), log.frfs, assembly.home)))
        problems.insert(0, assembly.search_problem(log))
    candidates = latin_hypercube(parameters, spec.starts, spec.start_factor, spec.seed or 0)
    starts = feasible_starts(candidates, fit.inertias, parameters)
    return multistart(problems, starts, spec.solver, fit.evaluated_by(execution))


# V over its degrees of freedom, above which the fit with free nuisance parameters starts again; number of its starts.
COST_RATIO, ATTEMPTS = 1.5, 4


def free_nuisance_parameters(
    assembly: Assembly, starts: tuple[LocalOptimum, ...], robot: Robot, loads: "Sequence[PlacedTest]"
) -> tuple[Assembly, tuple[LocalOptimum, ...]]:
    """Free the nuisance parameters within their tolerances. Return the assembly and the optima, best first.

    The first start is the best optimum with nominal values. As long as V exceeds COST_RATIO times its degrees of
    freedom, the start of the study and the next best optima follow, because a wrong robot model can mislead the search.
    If no start leads to a robot with an equilibrium (for example with exchanged channels), the nominal values stay
    fixed, and the diagnosis names the cause.
    """
    parameters = with_tolerances(assembly.parameters, robot, assembly.spec)

    def widen(x: FloatArray) -> FloatArray:
        return parameters.x_with(values_by_name(assembly.parameters.free_names, x))

    ends = [replace(start, x_start=widen(start.x_start), x=widen(start.x)) for start in starts]
    nuisance = Assembly.of(
        assembly.responses, robot, assembly.spec, parameters, assembly.model, loads, assembly.weights
    )
    begins = [ends[0], replace(ends[0], x=parameters.x, x_start=parameters.x, iterations=0), *ends[1:]]
    best = None
    for begin in begins[:ATTEMPTS]:
        try:
            end, dof = _refine_start(nuisance, begin)
        except (StudyError, FitError):  # no equilibrium along the search
            continue
        best = end if best is None or end.cost < best.cost else best
        if best.cost <= COST_RATIO * dof:
            break
    return (assembly, starts) if best is None else (nuisance, (best, *ends[1:]))


def _refine_start(assembly: Assembly, begin: LocalOptimum) -> tuple[LocalOptimum, int]:
    """Return the optimum near a start, and its degrees of freedom.

    Two linearisations suffice, because products such as m c^2 change little within tolerances.
    """
    end = begin
    for tolerance in (NEAR, FINE):
        fit = assembly.at(end.x)
        end = solve(fit.problem, end.x, tolerance, method=assembly.spec.solver)
    return replace(end, x_start=begin.x_start, iterations=begin.iterations + end.iterations), fit.problem.dof


_Ends: TypeAlias = tuple[tuple[LocalOptimum, ...], int]  # optima, best first, and how many reached the best
_Estimate: TypeAlias = tuple[Assembly, RelinearisedOptimum, Uncertainty, Result]


def _with_model_error(
    assembly: Assembly, spec: FitSpec, ends: _Ends, execution: Execution, near: RelinearisedOptimum | None = None
) -> _Estimate:
    """Estimate with the model error of the study, by default estimated from the residuals; near: see `relinearise`.

    The residuals do not show the error of uncompensated dry friction: it is similar at all lines, and springs and
    dampers absorb it. The model error is then the typical one.
    """
    if spec.weights.model_error is not None:
        return assembly, *_estimate(assembly, ends, execution, near)
    bare = assembly.with_model_error(None)
    estimate = _estimate(bare, ends, execution, near)
    is_distorted = any(map(is_distorted_by_friction, assembly.responses))
    if estimate[0].end.converged and not estimate[2].exceeds_noise and not is_distorted:
        return bare, *estimate
    with_error = assembly.with_model_error(
        TYPICAL_MODEL_ERROR if is_distorted else model_error_of_residuals(bare, estimate[0])
    )
    del bare, estimate  # weights are most of the memory of a fit
    return with_error, *_estimate(with_error, ends, execution, near)


def _with_agreements(estimate: _Estimate, assembly: Assembly, spec: FitSpec, ends: _Ends) -> _Estimate:
    """Compare load tests and responses at the tool with the motors' responses; add the comparisons to the result.

    Contradicting data are excluded, and the covariance includes the difference to the estimate from all data.
    """
    alone, at_tool = assembly.select_responses(of_tool=False), assembly.select_responses(of_tool=True)
    if (assembly.loads is None and not at_tool.responses) or not alone.responses:
        return estimate
    from elastid.fit.diagnosis.static_and_tool_data import static_agreement, tool_agreement

    starts, n_converged = ends
    begin = replace(starts[0], x=estimate[1].end.x)

    def refit(assembly_: Assembly, is_global: bool = False) -> _Estimate:
        if not is_global:
            return _with_model_error(assembly_, spec, ((begin, *starts[1:]), n_converged), Execution())
        ends = _from_all_starts(assembly_, assembly_.at(begin.x), spec, Execution())
        return _with_model_error(assembly_, spec, ends, Execution())

    def compare(motors: Result) -> tuple[StaticAgreement | None, ToolAgreement | None]:
        tool = tool_agreement(at_tool, motors) if at_tool.responses else None
        return None if assembly.loads is None else static_agreement(assembly.loads, motors), tool

    of_motors = refit(alone)
    if of_motors[3].exceeds_noise or any(map(_disagree, compare(of_motors[3]))):
        # A deflection in a wrong unit leads the fit of all data to a minimum that the responses alone do not have.
        of_motors = min(of_motors, refit(alone, is_global=True), key=lambda fit: (fit[3].model_error, fit[3].cost))
    static, tool = compare(of_motors[3])
    if not (_disagree(static) or _disagree(tool)):
        return *estimate[:3], replace(estimate[3], static=static, tool=tool)
    if tool is not None and not tool.disagrees:
        consistent = refit(replace(assembly, loads=None))
    else:
        consistent = of_motors if _disagree(static) or static is None else refit(replace(alone, loads=assembly.loads))
    covers_difference = _disagree(static) or (tool is not None and tool.disagrees and not tool.is_misread)
    step = (estimate[3].x - consistent[3].x) * covers_difference
    covariance = consistent[3].covariance + np.outer(step, step)
    return *consistent[:3], replace(consistent[3], static=static, tool=tool, covariance=covariance)


def _disagree(agreement: StaticAgreement | ToolAgreement | None) -> bool:
    return agreement is not None and agreement.disagrees


def _estimate(
    assembly: Assembly, ends: _Ends, execution: Execution, near: RelinearisedOptimum | None
) -> tuple[RelinearisedOptimum, Uncertainty, Result]:
    starts, n_converged = ends
    optimum = relinearise(assembly, starts[0], assembly.spec.criterion, near)
    fit, end = optimum.fit, optimum.end
    is_compensated = any(map(is_friction_compensated, assembly.responses))
    arguments = fit, optimum.responses, optimum.weights, end.x
    uncertainty = estimate_uncertainty(*arguments, execution, is_compensated=is_compensated)
    dof = fit.problem.dof
    # For a simulation without noise the expected V follows from the weights.
    expected_cost = uncertainty.expected_cost if uncertainty.expected_cost > 1e-12 * dof else dof
    result = Result(
        parameters=fit.parameters.with_means(end.x), x=end.x, covariance=uncertainty.covariance,
        cost=end.cost + float(optimum.factors @ optimum.factors), dof=dof, cost_expected=float(expected_cost),
        cost_dof=uncertainty.cost_dof, status="converged", message="", starts=starts, n_converged_starts=n_converged,
        at_bound=at_bound(fit.parameters, end.x), singular_values=uncertainty.singular_values,
        criterion=fit.frfs[0].criterion, configurations=tuple(frf.configuration for frf in fit.frfs),
        information_fraction=uncertainty.information_fraction, information_band_hz=uncertainty.information_band_hz,
        linear=tuple(frf.kernel.model for frf in fit.frfs if frf.kernel.model.is_delayed),
        averaging_fraction=uncertainty.averaging_fraction, persistent_fraction=uncertainty.persistent_fraction,
        robot=assembly.robot, equations=assembly.model,
        model_error=max(weights.model_error for weights in assembly.weights),
    )  # fmt: skip
    return optimum, uncertainty, result
