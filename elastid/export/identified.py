"""Identified: what is exported, a robot with its identified numbers and what it does in every configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import FloatArray
from elastid.fit.elastic import matched
from elastid.fit.result import FitResult
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.statespace import StateSpace, state_space
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
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

    spec: the formulation of the equations.
    Raises StudyError where a configuration has no equilibrium with the fitted numbers.
    """
    fitted = robot.with_parameters({name: value for name, value in result.values.items() if name != DELAY})
    model = formulate(fitted, spec)
    # The fitted geometry is in the robot: its numbers are none of the model's parameters any more.
    linearisation, theta = (
        Linearisation.of(model),
        np.array([result.values[name] for name in (*model.parameters, DELAY)]),
    )
    linear = (matched(linearisation.at(G.configuration, theta[:-1], G.outputs, G.quantity), G) for G in measured)
    return Identified(name, fitted, model, result, theta, tuple(measured), tuple(linear))
