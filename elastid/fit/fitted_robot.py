"""FittedRobot: a robot with fitted numbers, linearised where it was measured: predictions, modes, exports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, values_by_name
from elastid.base.errors import index_of
from elastid.fit.parameter_selection import group_labels, tolerances_of
from elastid.fit.problem.frf_residuals import linear_model
from elastid.fit.result import Result
from elastid.linear.fitted_model import FittedModel
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.motion_bias import estimate_motion_bias
from elastid.linear.response.transfer import frequency_response
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.parameters import DELAY, Parameter
from elastid.response import Response
from elastid.robot import BodyTolerances, Robot, Tolerances
from elastid.robot.tolerances import Exact


@dataclass(frozen=True, eq=False)
class FittedRobot:
    """The equations of a fitted robot, and measured response and fitted model of each configuration, in one order.

    models: functions of all fitted parameters, geometry included; inputs and outputs in the order of the response.
    modelled: `responses`, if already computed.  name: of an export.  presliding (F, n_y, n_u): change of each response
    by the presliding friction of its motors; empty without friction.
    """

    result: Result
    model: ElasticModel
    measured: tuple[Response, ...]
    models: tuple[FittedModel, ...]
    modelled: tuple[Response, ...] | None = None
    name: str = ""
    presliding: tuple[ComplexArray, ...] = ()

    @classmethod
    def of(cls, result: Result, robot: Robot, measured: Sequence[Response], spec: ModelSpec = EXACT) -> "FittedRobot":
        """Linearise the fitted model in each configuration of `measured`, which need not have been fitted.

        robot, spec: as they were fitted.  Fitted coordinates of the geometry are parameters of the equations.
        Raises StudyError where a configuration has no equilibrium with the fitted numbers, and where the robot lacks an
        input or output of a response.
        """
        linearisation, models = Linearisation.of_robot(robot, spec, result.parameters.names), []
        springs = {friction.spring: (friction.stiffness, friction.rate) for friction in result.presliding}
        with_springs, changes = replace(linearisation, presliding=tuple(springs)), []
        numbers = [number for s, a in springs.values() for number in (abs(s), abs(s) / a)]
        for G in measured:
            theta = _theta(result, linearisation.model, G.configuration.name)
            linear = linear_model(linearisation, G, theta)
            models.append(FittedModel.of(linear, result.parameters, result.x, result.covariance))
            if springs:
                theta_of_both = np.insert(theta, len(theta) - 1, numbers)
                of_both = frequency_response(linear_model(with_springs, G, theta_of_both), theta_of_both, G.freq_hz)
                changes.append(of_both - frequency_response(linear, theta, G.freq_hz))
        return cls(result, linearisation.model, tuple(measured), tuple(models), presliding=tuple(changes))

    @property
    def robot(self) -> Robot:
        """The robot of the equations."""
        return self.model.robot

    @property
    def linear(self) -> tuple[LinearModel, ...]:
        """The linear models."""
        return tuple(model.linear for model in self.models)

    @property
    def theta(self) -> FloatArray:
        """theta (n_theta,) of the first configuration, equal for all configurations of a model with one group."""
        return self.theta_of(self.measured[0].configuration.name)

    def theta_of(self, configuration: str) -> FloatArray:
        """Return the fitted values (n_theta,) in a configuration, SI: parameters of the equations, then the delay."""
        return _theta(self.result, self.model, configuration)

    def at(self, configuration: str) -> FittedModel:
        """Return the model of a configuration; UnknownNameError where it was not measured."""
        return self.models[index_of(configuration, [G.configuration.name for G in self.measured], "configuration")]

    @cached_property
    def responses(self) -> tuple[Response, ...]:
        """The model's frequency response for each measured one: its lines, inputs, outputs, and its motion."""
        return self.responses_by({}) if self.modelled is None else self.modelled

    def responses_by(self, effects: Mapping[str, ComplexArray]) -> tuple[Response, ...]:
        """Return `responses`; effects: motion-induced bias (F, n_y, n_u) by configuration, if known."""
        responses = []
        for i, (model, G) in enumerate(zip(self.models, self.measured, strict=True)):
            modelled = replace(model.response(G.freq_hz, sampled=True), has_rate=G.has_rate)
            effect = effects.get(name := G.configuration.name)
            if effect is None:
                effect = estimate_motion_bias(self.model, model.linear, self.theta_of(name), G)
            changes = (*(() if effect is None else (effect,)), *self.presliding[i : i + 1])
            responses.append(replace(modelled, G=sum(changes, modelled.G)) if changes else modelled)
        return tuple(responses)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of a group: without other groups' and without parameters that this group replaces."""
        return parameters_of(self.result, self.measured[0].configuration.name)


def models_by_group(
    result: Result, robot: Robot, measured: Sequence[Response], spec: ModelSpec = EXACT, name: str = ""
) -> dict[str, FittedRobot]:
    """Return a model for each group of configurations with its own parameters, by label; one, "", without groups.

    The robot of each group has the fitted values; fitted geometry is fixed in its equations.
    Arguments and errors as `FittedRobot.of`.
    """
    models = {}
    for label, (fitted, members) in robots_by_group(result, robot, [G.configuration.name for G in measured]).items():
        of_all = FittedRobot.of(result, fitted, [G for G in measured if G.configuration.name in members], spec)
        models[label] = replace(of_all, model=formulate(fitted, spec), name=f"{name}, {label}" if label else name)
    return models


def parameters_of(result: Result, configuration: str) -> tuple[Parameter, ...]:
    """Return the parameters of a configuration, without other groups' parameters and replaced ones."""
    local = result.parameters.configuration_of_stand_in(configuration)
    local_names = [p.stands_for for p in result.parameters if local in p.only]
    return tuple(p for p in result.parameters if local in p.only or not (p.only or p.name in local_names))


def robots_by_group(
    result: Result, robot: Robot, configurations: Sequence[str]
) -> dict[str, tuple[Robot, tuple[str, ...]]]:
    """Return the robot with the fitted numbers of each group of configurations, by its label, and their names."""
    groups = group_labels(result.parameters, list(configurations)).items()
    return {label: (estimated_robot(result, robot, members[0]), tuple(members)) for label, members in groups}


def estimated_robot(result: Result, robot: Robot | None = None, configuration: str = "") -> Robot:
    """Return the robot with the fitted values of a configuration, by default with the values common to all.

    robot: by default the one that was fitted.
    """
    numbers = result.parameters.numbers(result.x, configuration)
    numbers.pop(DELAY, None)
    return (robot or result.nominal_robot).with_parameters(numbers)


def _theta(result: Result, model: ElasticModel, configuration: str) -> FloatArray:
    numbers = result.parameters.numbers(result.x, configuration)
    return np.array([numbers[name] for name in (*model.parameters, DELAY)])


def remaining_tolerances(result: Result, robot: Robot) -> Tolerances | Exact | None:
    """Return the posterior tolerances of the robot after a fit, by body.

    The largest posterior std of a kind counts for the whole body. Unchanged if the robot model has no tolerances.
    """
    if not isinstance(robot.tolerances, Tolerances) or not result.has_tolerances:
        return robot.tolerances
    deviation = values_by_name(result.parameters.free_names, result.std_of_x)
    owners = {*(body.name for body in robot.all_bodies), *(loop.name for loop in robot.loops)}
    posterior: dict[str, dict[str, float]] = {}
    for tolerance in tolerances_of(robot):
        if tolerance.owner in owners and (tolerance.factor or tolerance.name) in deviation:
            std = deviation[tolerance.factor or tolerance.name]
            if tolerance.kind == "length" and result.parameters[tolerance.name].log:
                std *= result.values[tolerance.name]
            stds = posterior.setdefault(tolerance.owner, {})
            stds[tolerance.kind] = max(stds.get(tolerance.kind, 0.0), std)
    return replace(robot.tolerances, bodies=tuple(BodyTolerances(owner, **stds) for owner, stds in posterior.items()))
