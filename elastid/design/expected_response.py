r"""The expected response of a plan, as the fit will receive it, and damping and scatter by Coulomb friction.

.. math:: \tau_c\, \mathrm{sign}(v_c + v) = d\, v + s, \qquad
          d = \frac{\mathrm{Re} \sum_k V_k^* T_k}{\sum_k |V_k|^2}

T_k are the lines of the friction torque, V_k those of the motor's velocity under the multisine, v_c the velocity of the
carrier. d is the best linear approximation, which the fit finds as viscous friction; s depends on the phases, repeats
in every period and averages over realisations only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import digamma

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.excitation.multisine import synthesise
from elastid.fit.problem.elastic import ElasticFit, at_measured_places, elastic_fit
from elastid.fit.problem.weights import Weights
from elastid.fit.spec import FitSpec
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.model.spec import ModelSpec
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class ExpectedResponse:
    """The expected response, its model, and the weights that the fit will give to it."""

    response: FrequencyResponse
    model: LinearModel
    weights: Weights
    parameters: ParameterSet
    fit: FitSpec

    @property
    def problem(self) -> ElasticFit:
        """The fit of this response alone."""
        return expected_fit([self])

    def information(self, x: FloatArray) -> FloatArray:
        r"""H (n_x, n_x) = 2 Re sum_k J_k^H W_k J_k at x (n_x,), without priors, W as the fit weighs."""
        fit = self.problem
        return np.asarray(fit.evaluate(x).hessian / 2 - np.diag(fit.prior_slopes**2))


def expected_fit(expected: Sequence[ExpectedResponse]) -> ElasticFit:
    """The fit of all expected responses together."""
    first = expected[0]
    return elastic_fit(
        [part.response for part in expected],
        [part.model for part in expected],
        [part.weights for part in expected],
        first.parameters,
        first.fit.criterion,
    )


def linear_model(
    robot: Robot, formulation: ModelSpec, parameters: ParameterSet, response: FrequencyResponse, x: FloatArray
) -> LinearModel:
    """The model of a measured response about parameters x (n_x,), its inputs and outputs in its order."""
    theta = parameters.expand(x)
    model = Linearisation.of_robot(robot, formulation, parameters.names).at(
        response.configuration, theta[:-1], response.outputs, response.quantity
    )
    return at_measured_places(model, response)


def variance_like(
    responses: Sequence[FrequencyResponse], freq_hz: FloatArray, outputs: tuple[str, ...], inputs: tuple[str, ...]
) -> FloatArray:
    """Variance (F, n_y, n_u) of G: geometric mean over earlier responses, between their lines.

    StudyError where they have other inputs or outputs, or no variance.
    """
    logs = []
    for response in responses:
        known = response.uncertainty
        if response.inputs != inputs or response.outputs != outputs or known is None:
            raise StudyError(
                f"design.noise.frf: configuration {response.configuration.name} was measured from "
                f"{', '.join(response.inputs)} to {', '.join(response.outputs)}"
                f"{' without a variance' if known is None else ''}; needed are {', '.join(inputs)} to "
                f"{', '.join(outputs)} with one"
            )
        # The logarithm of a variance from few degrees of freedom lies too low: E ln(v~/v) = psi(dof) - ln dof.
        shortfall = np.log(known.dof) - digamma(known.dof) if np.isfinite(known.dof) else 0.0
        log = np.log(np.maximum(known.variance, 1e-300)).reshape(response.n_lines, -1) + shortfall
        logs.append([np.interp(freq_hz, response.freq_hz, column) for column in log.T])
    return np.asarray(np.exp(np.mean(logs, axis=0)).T.reshape(len(freq_hz), len(outputs), len(inputs)))


def friction_level(
    V: ComplexArray, lines: IntArray, period_samples: int, coulomb: FloatArray, carrier_velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """d (n_u,) and E|s_k|^2 (F, n_u) of velocities V (K, F, n_u) in K experiments, link side.

    coulomb (n_u,): Nm.  carrier_velocity (period_samples, n_u): rad/s, of every motor.
    """
    v = np.stack([synthesise(lines, spectrum, period_samples) for spectrum in V]) + carrier_velocity
    T = np.fft.rfft(coulomb * np.sign(v), axis=1)[:, lines] * (2 / period_samples)
    d = np.sum(V.conj() * T, axis=(0, 1)).real / np.sum(np.abs(V) ** 2, axis=(0, 1))
    power = np.mean(np.abs(T - d * V) ** 2, axis=0)
    window = np.ones(min(9, len(lines)))  # it comes from few experiments: averaged over nine lines
    weight = np.convolve(np.ones(len(lines)), window, "same")
    smooth = np.stack([np.convolve(column, window, "same") / weight for column in power.T], axis=1)
    return d, smooth
