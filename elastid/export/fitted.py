"""Identified: what is exported, a robot with its identified numbers and what it does in every configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.problem.elastic import at_measured_places
from elastid.fit.result import FitResult
from elastid.fit.setup.groups import labels
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.statespace import StateSpace, state_space
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameter
from elastid.response import FrequencyResponse
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class Identified:
    """A fitted robot: its equations, and measured response and linear model of each configuration, in one order.

    robot: with the fitted numbers.  theta (n_theta,): model.parameters, then the delay, SI.
    """

    name: str
    robot: Robot
    model: ElasticModel
    result: FitResult
    theta: FloatArray
    measured: tuple[FrequencyResponse, ...]
    linear: tuple[LinearModel, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the fit that count here: not what other robots have of their own, nor what this one's stand for."""
        here = self.measured[0].configuration.name
        own = [p.stands_for for p in self.result.parameters if here in p.only]
        return tuple(p for p in self.result.parameters if here in p.only or not (p.only or p.name in own))

    @property
    def state_spaces(self) -> tuple[StateSpace, ...]:
        """The linear models as control engineers write them."""
        return tuple(state_space(model, self.theta) for model in self.linear)


def identified(
    name: str,
    robot: Robot,
    result: FitResult,
    measured: Sequence[FrequencyResponse],
    spec: ModelSpec = EXACT,
) -> Identified:
    """What a fit has found, linearised where it was measured, inputs and outputs in the order of the responses.

    measured: of one robot: all have the numbers of the first one's configuration.  spec: the formulation.
    Raises StudyError where a configuration has no equilibrium with the fitted numbers.
    """
    theta_of = dict(zip(result.parameters.names, result.theta_of(measured[0].configuration.name).tolist(), strict=True))
    fitted = robot.with_parameters({name: value for name, value in theta_of.items() if name != DELAY})
    model = formulate(fitted, spec)
    # The fitted geometry is in the robot: its numbers are none of the model's parameters any more.
    theta = np.array([theta_of[name] for name in (*model.parameters, DELAY)])
    linearisation = Linearisation.of(model)
    linear = (
        at_measured_places(linearisation.at(G.configuration, theta[:-1], G.outputs, G.quantity), G) for G in measured
    )
    return Identified(name, fitted, model, result, theta, tuple(measured), tuple(linear))


def by_robot(
    name: str,
    robot: Robot,
    result: FitResult,
    measured: Sequence[FrequencyResponse],
    spec: ModelSpec = EXACT,
) -> dict[str, Identified]:
    """A model for each group of configurations that has parameters of its own, by its label; one, "", without groups.

    Arguments as `identified`.
    """
    found = {}
    for label, members in labels(result.parameters, [G.configuration.name for G in measured]).items():
        its = [G for G in measured if G.configuration.name in members]
        found[label] = identified(f"{name}, {label}" if label else name, robot, result, its, spec)
    return found
