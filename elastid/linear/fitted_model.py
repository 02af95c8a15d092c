"""FittedModel: the linear model of one configuration with fitted numbers, and what follows from them with its std."""

from __future__ import annotations

from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.display import Display, as_html, as_text, degrees
from elastid.base.numbers import number
from elastid.linear.linear_model import LinearModel
from elastid.linear.modes import Modes, modes
from elastid.linear.propagation import UncertainModes, response_deviation, uncertain_modes
from elastid.linear.response.transfer import to_response
from elastid.linear.statespace import StateSpace, state_space
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse


@frozen_value
class FittedModel:
    """A linear model at the estimate x (n_x,) of its parameters, of covariance (n_x, n_x)."""

    linear: LinearModel
    parameters: ParameterSet
    x: FloatArray
    covariance: FloatArray

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """The modes with their standard deviations."""
        found, linear = self.uncertain_modes(), self.linear
        columns = (found.freq_hz, found.freq_std, 100 * found.zeta, 100 * found.zeta_std)
        rows = [
            tuple(number(value, kept) for value, kept in zip(row, (5, 2, 4, 2), strict=True))
            for row in np.transpose(columns).tolist()
        ]
        return Display(
            f"FittedModel of {linear.configuration.name} ({degrees(linear.configuration.angles.tolist())}): "
            f"{linear.quantity} of {', '.join(linear.outputs)} by {', '.join(linear.inputs)}",
            ("natural frequency in Hz", "std", "damping ratio in %", "std"),
            rows,
        )

    @property
    def theta(self) -> FloatArray:
        """The fitted numbers (n_theta,) in this configuration, SI, in the order of the linear model."""
        return self.parameters.expand(self.x, self.linear.configuration.name)

    def response(self, freq_hz: FloatArray) -> FrequencyResponse:
        """The frequency response at freq_hz (F,), or at one, between the inputs and outputs that were measured."""
        return to_response(self.linear, self.theta, freq_hz)

    def response_std(self, freq_hz: FloatArray) -> FloatArray:
        """Standard deviation (F, n_y, n_u) of `response` by that of the parameters, to first order."""
        return response_deviation(self.linear, freq_hz, self.parameters, self.x, self.covariance)[1]

    def modes(self) -> Modes:
        """Natural frequencies, damping ratios and shapes with the motors free."""
        return modes(self.linear, self.theta)

    def uncertain_modes(self) -> UncertainModes:
        """Frequencies and damping ratios of `modes` with their standard deviations."""
        return uncertain_modes(self.linear, self.parameters, self.x, self.covariance)

    def state_space(self) -> StateSpace:
        """A, B, C, D and the delay of the torque; StudyError as `linear.statespace.state_space`."""
        return state_space(self.linear, self.theta)

    def to_control(self, pade: int | None = None) -> Any:
        """The same as `control.StateSpace`; as `StateSpace.to_control`."""
        return self.state_space().to_control(pade)
