r"""FRF problem: responses, weights and model of a fit, linearised at any x, and its relinearised optimum.

If a linearisation is valid only near its point, the search linearises at every x:

.. math:: x \to \theta \to q_0(\theta) \to M, D, K\,(q_0, \theta) \to G, \qquad dG / dx \text{ along the whole chain}

The tangent stiffness of a nonlinear spring changes by factors between a start and the true value. A model that is
affine about the nominal parameters would lead all starts to the same local minimum. The same applies to masses that are
identified together with their centres, because M contains m c^2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError, Note, StudyError, notes_of
from elastid.base.execution import SERIAL, Execution
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals, linear_model, map_chunks
from elastid.fit.problem.inertia_barrier import free_inertias
from elastid.fit.problem.least_squares import (
    Evaluation,
    LeastSquares,
    LocalOptimum,
    ResidualKind,
    difference,
    distance,
    is_far_from_noise,
)
from elastid.fit.problem.systematic_errors import (
    contrasts_of,
    find_factors,
    next_factors,
    unit_bias,
    with_modelled_bias,
)
from elastid.fit.problem.weights import Weights, weigh, with_model_error
from elastid.fit.solve.solvers import FINE, solve
from elastid.fit.spec import TYPICAL_MODEL_ERROR, FitSpec
from elastid.linear.equilibrium import equilibrium, spring_notes
from elastid.linear.linear_model import LinearModel, is_load
from elastid.linear.linearise import Linearisation
from elastid.linear.motion_bias import estimate_motion_bias
from elastid.linear.presliding import RelaxingSpring
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration
from elastid.response import STEP_IMAGES, SYSTEMATIC_ERRORS, Response
from elastid.robot import Robot

if TYPE_CHECKING:
    from elastid.fit.problem.static_loads import PlacedTest, StaticLoads  # of studies with load tests

OUTLIER_STDS = 2.0  # of real and imaginary part, above which an element is an outlier: 5 % of data without outliers
RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))  # of two components of unit variance
# Far above the noise, rounds end if V falls by less than this fraction, and a solve ends at this distance to the
# stationary point, in standard deviations by the residuals.
MIN_PROGRESS, NEAR_ENOUGH = 1e-3, 5e-3
DISTORTED = 4.0  # ratio of total to noise variance, above which a response contains significant distortion
IMAGE_ERROR = 0.05  # of |G|, by images of a sampled reference, with controller gains known to 10 to 30 %
HALVINGS = 8  # of the step from the start to parameters without an equilibrium


@dataclass(frozen=True, eq=False)
class Assembly:
    """Measured responses with their weights, and the differentiated model, shared by all linearisations.

    model: formulation of the equations.  loads: static load tests of the fit.  home: execution of the chunks; this
    process if the model is linearised again at every step.
    """

    responses: tuple[Response, ...]
    weights: tuple[Weights, ...]
    linearisation: Linearisation
    parameters: Parameters
    spec: FitSpec
    model: ModelSpec = EXACT
    loads: "StaticLoads | None" = None
    home: Execution = SERIAL

    @classmethod
    def of(
        cls, responses: Sequence[Response], robot: Robot, spec: FitSpec, parameters: Parameters,
        model: ModelSpec = EXACT, loads: "Sequence[PlacedTest]" = (), weights: Sequence[Weights] | None = None,
        home: Execution = SERIAL, presliding: tuple[RelaxingSpring, ...] = (),
    ) -> "Assembly":  # fmt: skip
        """Build the model, and compute the weights of the responses unless they are given."""
        weights = tuple(weights or (weigh(response, spec) for response in responses))
        linearisation = Linearisation.of_robot(robot, model, parameters.names, presliding)
        static = None
        if loads:
            from elastid.fit.problem.static_loads import StaticLoads

            static = StaticLoads.of(loads, robot, model, parameters)
        assembly = cls(tuple(responses), weights, linearisation, parameters, spec, model, static)
        if linearisation.is_affine_in(assembly._dependent):
            return assembly if linearisation.follows else replace(assembly, home=home)
        following = replace(Linearisation.of(linearisation.model, follows=True), presliding=presliding)
        return replace(assembly, linearisation=following)

    def select_responses(self, of_tool: bool) -> "Assembly":
        """Return the assembly with the tool responses or the motor responses alone, and without load tests."""
        pairs = zip(self.responses, self.weights, strict=True)
        selection = [(G, weights) for G, weights in pairs if any(map(is_load, G.inputs)) == of_tool]
        responses, weights = zip(*selection, strict=True) if selection else ((), ())
        return replace(self, responses=responses, weights=weights, loads=None)

    def with_model_error(self, model_error: float | None) -> "Assembly":
        """Return the assembly with the weights of a relative model error."""
        spec = with_model_error(self.spec, model_error)
        weights = map_chunks(partial(weigh, spec=spec), self.responses, self.home)
        return replace(self, spec=spec, weights=tuple(weights))

    @property
    def robot(self) -> Robot:
        """The robot of the equations."""
        return self.linearisation.model.robot

    @property
    def _dependent(self) -> set[str]:
        return {name for G in self.responses for name in self.parameters.dependent_names(G.configuration.name)}

    def at(self, x: FloatArray, criterion: ResidualKind | None = None) -> ElasticFit:
        """Return the fit with every configuration linearised at x (n_x,).  criterion: by default the study's."""
        residuals = partial(_frf_residuals, self.linearisation, self.parameters, x, criterion or self.spec.criterion)
        pairs = list(zip(self.responses, self.weights, strict=True))
        inertias = free_inertias(self.parameters, self.robot)
        frfs = tuple(map_chunks(residuals, pairs, self.home))
        return ElasticFit(self.parameters, frfs, inertias, self.loads, self.home)

    def as_linearised(self, fit: ElasticFit, other: "Assembly") -> ElasticFit:
        """Return the fit with the linear models of `fit`, a fit of another assembly of the same configurations."""
        groups = list(zip(self.responses, other.responses, self.weights, fit.frfs, strict=True))
        return replace(fit, frfs=tuple(map_chunks(_reweighted_frf, groups, self.home)))

    @cached_property
    def is_local(self) -> bool:
        """True if a linearisation is valid only near its point: nonlinear springs, or masses and places both free."""
        return self.linearisation.follows or not self.linearisation.is_affine_in(self._dependent)

    def search_problem(self, fit: ElasticFit) -> LeastSquares:
        """Return the least-squares problem of the search; if `is_local`, it is linearised again at every x."""
        return replace(fit.problem, evaluate=partial(self._relinearised, fit)) if self.is_local else fit.problem

    def _relinearised(self, first: ElasticFit, x: FloatArray) -> Evaluation:
        """Return V, its gradient and 2 J^T J, linearised at x, with the weights of the first fit.

        V is infinite if the robot has no equilibrium.
        """
        models = (_model(self.linearisation, self.parameters, x, response) for response in self.responses)
        try:
            return replace(first, frfs=tuple(map(FrfResiduals.linearised, first.frfs, models))).rough(x)
        except StudyError:
            return Evaluation(math.inf, np.zeros(len(x)), np.eye(len(x)))

    def without_motion_bias(self, x: FloatArray) -> "Assembly":
        """Return the assembly without the motion-induced bias of the responses at x (n_x,)."""
        relinearise_one = partial(_without_motion_bias, self.linearisation, self.parameters, x)
        return replace(self, responses=tuple(map_chunks(relinearise_one, self.responses, self.home)))

    def spring_notes(self, x: FloatArray) -> tuple[Note, ...]:
        """Return notes on springs that no single stiffness describes at the equilibrium of x (n_x,)."""
        model = self.linearisation.model
        groups: dict[tuple[float, ...], dict[str, Configuration]] = {}  # configurations of the same numbers
        for configuration in (response.configuration for response in self.responses):
            name = configuration.name
            groups.setdefault(tuple(self.parameters.expand(x, name)[:-1]), {})[name] = configuration
        notes: list[Note] = []
        for numbers, configurations in groups.items():
            theta = np.array(numbers[: len(model.parameters)])
            notes += spring_notes(model, theta, (equilibrium(model, theta, c) for c in configurations.values()))
        return tuple(notes)

    def reweighted(self, x: FloatArray) -> "Assembly":
        """Return the assembly with the weights of the robust loss at x (n_x,)."""
        if self.spec.weights.loss == "square":
            return self
        factors = robust_factors(self.at(x), self.weights, x)
        weights = (replace(w, factor=w.factor * factor) for w, factor in zip(self.weights, factors, strict=True))
        return replace(self, weights=tuple(weights))

    def with_modelled_bias(self, fit: ElasticFit, x: FloatArray) -> "Assembly":
        """Return the assembly with systematic errors evaluated with the modelled instead of the measured responses."""
        modelled = (frf.kernel.response(frf.theta(fit.parameters, x)) for frf in fit.frfs)
        return replace(self, responses=tuple(map(with_modelled_bias, self.responses, modelled)))

    def unbiased(self, c: FloatArray) -> "Assembly":
        """Return the assembly without the systematic errors of its responses, for their factors c (n_b,)."""
        if not c.any():
            return self
        factors = find_factors(self.responses)
        corrected = (
            replace(G, G=G.G - np.tensordot(c @ contrasts_of(G, factors), unit_bias(G), axes=1)) for G in self.responses
        )
        return replace(self, responses=tuple(corrected))


def _model(linearisation: Linearisation, parameters: Parameters, x: FloatArray, response: Response) -> LinearModel:
    name = response.configuration.name
    return linear_model(linearisation, response, parameters.expand(x, name), parameters.dependent_names(name))


def _frf_residuals(
    linearisation: Linearisation, parameters: Parameters, x: FloatArray, criterion: ResidualKind,
    pair: tuple[Response, Weights],
) -> FrfResiduals:  # fmt: skip
    return FrfResiduals.of(pair[0], _model(linearisation, parameters, x, pair[0]), pair[1], parameters, criterion)


def _reweighted_frf(group: tuple[Response, Response, Weights, FrfResiduals]) -> FrfResiduals:
    """Return the residuals of a response, with model and aliases of ZOH torques of a reference response."""
    response, reference, weights, frf = group
    return FrfResiduals.weighted(frf.columns, reference.G - frf.measured, response, weights, frf.criterion)


def _without_motion_bias(
    linearisation: Linearisation, parameters: Parameters, x: FloatArray, response: Response
) -> Response:
    if response.motion is None:
        return response
    theta, n = parameters.expand(x, response.configuration.name), len(linearisation.model.parameters)
    linearisation, theta = replace(linearisation, presliding=()), np.append(theta[:n], theta[-1])
    effect = estimate_motion_bias(linearisation.model, linear_model(linearisation, response, theta), theta, response)
    return response if effect is None else replace(response, G=response.G - effect)


@dataclass(frozen=True, eq=False)
class RelinearisedOptimum:
    """Optimum of a fit, with the fit linearised there; notes if the linearisation did not converge.

    fit: to the responses without the estimated systematic errors.  factors (n_b,): of these errors.  responses: without
    motion-induced bias; their systematic errors are evaluated with the model at the optimum.
    """

    end: LocalOptimum
    fit: ElasticFit
    responses: tuple[Response, ...]
    weights: tuple[Weights, ...]
    notes: tuple[Note, ...] = ()
    factors: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def x(self) -> FloatArray:
        """x (n_x,) at the optimum."""
        return self.end.x


class NoEquilibriumError(FitError):
    """The best start ended at parameters without an equilibrium, for example because of misinterpreted channels."""

    def __init__(self, error: StudyError) -> None:
        super().__init__(
            "robot/no-equilibrium",
            f"the best start ended where the robot cannot stand: {error}; check signs, units and places of the "
            "channels",
        )


def is_friction_compensated(response: Response) -> bool:
    """Return True if friction was compensated, so that the coefficients have systematic errors."""
    return response.bias is not None and len(response.bias) - response.image_errors > SYSTEMATIC_ERRORS


def is_distorted_by_friction(response: Response) -> bool:
    """Return True if distortion is significant and friction was not compensated."""
    noise, total = response.noise, response.total
    if noise is None or total is None or is_friction_compensated(response):
        return False
    is_valid = (noise.variance > 0) & np.isfinite(total.variance)
    return bool(is_valid.any()) and float(np.median(total.variance[is_valid] / noise.variance[is_valid])) > DISTORTED


def model_error_of_residuals(assembly: Assembly, optimum: RelinearisedOptimum) -> float:
    """Return the smallest model error for which V at an optimum is within its degrees of freedom.

    At most `TYPICAL_MODEL_ERROR`, or `IMAGE_ERROR` if images of a sampled reference were subtracted.
    """
    x, dof, criterion = optimum.x, optimum.fit.problem.dof, assembly.spec.criterion
    notes = {(note.code, note.severity) for note in notes_of(assembly.responses)}
    max_error = IMAGE_ERROR if (STEP_IMAGES, "information") in notes else TYPICAL_MODEL_ERROR
    corrected = replace(assembly, responses=optimum.responses).unbiased(optimum.factors).with_model_error(max_error)

    def exceeds(model_error: float) -> bool:  # also if a covariance is singular with this model error: V is infinite
        return corrected.with_model_error(model_error).at(x, criterion).evaluate(x).cost > dof

    low, high = max_error / 100, max_error
    if exceeds(high):
        return high
    while high > 1.1 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if exceeds(middle) else (low, middle)
    return high


def relinearise(
    assembly: Assembly, start: LocalOptimum, criterion: ResidualKind, near: RelinearisedOptimum | None = None
) -> RelinearisedOptimum:
    """Linearise at the optimum, with its systematic errors and robust loss, and solve again until x converges.

    near: optimum of the same responses, whose motion-induced bias and factors are the start.
    Rounds end when x changes by less than 10 FINE standard deviations, at most 10 rounds, 30 with a robust loss. Each
    round gains one or two decimals; with low noise and a wrong robot model the first one changes x by 1e5.
    """
    is_square = assembly.spec.weights.loss == "square"
    rounds = 10 if is_square else 30
    end, c, without_bias = start, np.zeros(len(find_factors(assembly.responses))), assembly
    if near is not None:
        pairs = zip(assembly.responses, near.responses, strict=True)
        c, without_bias = near.factors, replace(assembly, responses=tuple(replace(G, G=other.G) for G, other in pairs))
    change, is_settled, history = math.inf, False, list[tuple[FloatArray, FloatArray]]()
    for i in range(rounds):
        try:
            # The bias is computed again only if x changed by 3 standard deviations; most change it by less.
            if (i == 1 and near is None) or (i == 1 + (near is None) and change > 3):
                without_bias, history = assembly.without_motion_bias(end.x), []
            current = without_bias.reweighted(end.x)
            fit = current.at(end.x, criterion)
        except StudyError as error:
            return _nearest_equilibrium(assembly, end, criterion, error)
        if len(c):
            with_bias = current.with_modelled_bias(fit, end.x)
            next_c = next_factors(with_bias.unbiased(c).as_linearised(fit, current), with_bias.responses, end.x, c)
            history = [*history[-1:], (c, next_c)]
            c = anderson_step(*history) if i > 1 and len(history) == 2 else next_c
            current, fit = with_bias, with_bias.unbiased(c).as_linearised(fit, current)
        tolerance = NEAR_ENOUGH if is_far_from_noise(end.cost, fit.problem.dof) else FINE
        precise = replace(fit.problem, evaluate=fit.evaluate)
        previous, end = end, solve(precise, end.x, tolerance, method=assembly.spec.solver)
        change = distance(end.x - previous.x, fit.evaluate(end.x), fit.problem.dof)
        has_stalled = is_square and i > 0 and previous.cost - end.cost < MIN_PROGRESS * end.cost
        has_bias = i > 0 or near is not None or all(response.motion is None for response in assembly.responses)
        is_settled = has_bias and (change < 10 * FINE or (has_stalled and is_far_from_noise(end.cost, fit.problem.dof)))
        if is_settled:
            break
    if not is_settled or is_far_from_noise(end.cost, fit.problem.dof):
        try:
            assembly.at(end.x, criterion)
        except StudyError as error:
            return _nearest_equilibrium(assembly, end, criterion, error)
    text = (
        f"the linearisation did not converge: round {rounds} of {rounds} changed the estimate by {change:.2g} standard "
        "deviations. Check the configurations and the gravity of the robot model, or set fit.weights.loss: square"
    )
    notes = () if is_settled else (Note("fit/posture-mismatch", text),)
    return RelinearisedOptimum(end, fit, current.responses, current.weights, notes, c)


def anderson_step(first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]) -> FloatArray:
    r"""Return the next c of an iteration c -> F(c) by Anderson's method of depth 1, from two pairs c, F(c).

    .. math:: c_{k+1} = F(c_k) - \gamma\, (F(c_k) - F(c_{k-1})), \quad
              \gamma = \frac{f_k^T (f_k - f_{k-1})}{\|f_k - f_{k-1}\|^2}, \quad f = F(c) - c

    Poorly identifiable parameters make F contract slowly. (Walker and Ni, SIAM J. Numer. Anal. 49, 2011.)
    """
    f, change = second[1] - second[0], second[1] - second[0] - first[1] + first[0]
    return second[1] - (f @ change) / max(float(change @ change), 1e-300) * (second[1] - first[1])


def _nearest_equilibrium(
    assembly: Assembly, end: LocalOptimum, criterion: ResidualKind, error: StudyError
) -> RelinearisedOptimum:
    """Halve the step from the start until the robot has an equilibrium; returns an optimum that is not converged.

    From there the diagnosis finds the cause, for example wrong postures that make the springs too soft. For a robot
    model with tolerances NoEquilibriumError is raised, and the fit is repeated with fixed values.
    """
    error_of_last, start, x = NoEquilibriumError(error), assembly.parameters.x, end.x
    if any(p.is_nuisance for p in assembly.parameters):
        raise error_of_last
    for _ in range(HALVINGS):
        x = (x + start) / 2
        try:
            fit = assembly.at(x, criterion)
        except StudyError:
            continue
        end = replace(end, x=x, cost=fit.evaluate(x).cost, converged=False, message=str(error_of_last))
        return RelinearisedOptimum(end, fit, assembly.responses, assembly.weights)
    raise error_of_last


def robust_factors(fit: ElasticFit, weights: Sequence[Weights], x: FloatArray) -> tuple[FloatArray, ...]:
    """Return weights (F, n_y, n_u) of the robust loss in each configuration at x (n_x,), 1 for a discarded element."""
    distances = []
    for frf, weight in zip(fit.frfs, weights, strict=True):
        e = difference(frf.criterion, frf.measured, frf.kernel.response(frf.theta(fit.parameters, x)))
        is_used = frf.gain > 0
        gain = np.divide(frf.gain, np.sqrt(weight.factor), out=np.zeros_like(frf.gain), where=is_used)
        distances.append(np.where(is_used, gain * np.abs(np.where(is_used, e, 0.0)), 0.0))
    moduli = np.concatenate([z[frf.gain > 0] for z, frf in zip(distances, fit.frfs, strict=True)])
    limit = OUTLIER_STDS * max(1.0, float(np.median(moduli)) / RAYLEIGH_MEDIAN)
    return tuple(np.minimum(1.0, limit / np.maximum(z, 1e-300)) for z in distances)
