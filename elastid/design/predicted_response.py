r"""Predicted frequency response of a planned measurement and its covariance, as functions of a configuration.

.. math:: cov(vec\, G) = \frac{1}{M} (U U^H)^{-T} \otimes C_V + \frac{\rho^2}{M} |G|^2, \qquad
          C_V = \frac{1}{P} [C_y + G (C_u + C_d) G^H] + G C_s G^H, \qquad U = (I + F G_q)^{-1} R

R (n_u, E): torques injected in the E experiments of a realisation; F: sampled joint controller; G_q: from the torque
with zero-order hold to the motor angle; M realisations of P periods. A white signal of variance sigma^2 has the
variance 4 sigma^2 / N at each line of a period of N samples. C_y, C_u: noise of the logged outputs and torques; C_d:
disturbance torque; C_s: scatter by Coulomb friction (`friction_linearisation`), equal in all periods; rho: other
distortion. `frf.estimators` has the covariance of the estimator.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, laplace_variable, mean_of_neighbours, quotient
from elastid.base.errors import StudyError
from elastid.design.optimal import PowerSource
from elastid.excitation.multisine import synthesise
from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.hardware import logged_quantity, output_stds
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.problem.frf_residuals import ElasticFit, elastic_fit
from elastid.fit.problem.weights import Weights, weigh
from elastid.fit.spec import FitSpec
from elastid.frf.distortion import sign_approximation
from elastid.friction.robot_friction import coulomb_torques
from elastid.linear.equilibrium import rigid_posture
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.presliding import RelaxingSpring
from elastid.linear.response.transfer import frequency_response, to_response
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER, Configuration, JointLoop, Motion, zero_order_hold
from elastid.response import Covariance, Response
from elastid.robot import Robot
from elastid.simulation.controller import gains_of, sampled_responses
from elastid.simulation.spec import ControllerSpec


@dataclass(frozen=True, eq=False)
class ExpectedResponse:
    """Expected response, its model, and its weights in the fit."""

    response: Response
    model: LinearModel
    weights: Weights
    parameters: Parameters
    fit: FitSpec

    def information(self, x: FloatArray) -> FloatArray:
        r"""Return H (n_x, n_x) = 2 Re sum_k J_k^H W_k J_k at x (n_x,), without priors; W: weights of the fit."""
        fit = expected_fit([self])
        return fit.evaluate(x).hessian / 2 - np.diag(fit.parameters.prior_slopes**2)


def expected_fit(expected: Sequence[ExpectedResponse]) -> ElasticFit:
    """Return the fit of all expected responses together."""
    responses, models, weights = zip(*((e.response, e.model, e.weights) for e in expected), strict=True)
    return elastic_fit(responses, models, weights, expected[0].parameters, expected[0].fit.criterion)


def friction_linearisation(
    V: ComplexArray, lines: IntArray, period_samples: int, coulomb: FloatArray, carrier_velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    r"""Return damping d (n_u,) and scatter E|s_k|^2 (F, n_u) by Coulomb friction, link side, for K experiments.

    .. math:: \tau_c\, \mathrm{sign}(v_c + v) = d\, v + s, \qquad
              d = \frac{\mathrm{Re} \sum_k V_k^* T_k}{\sum_k |V_k|^2}

    T_k: spectrum of the friction torque.  V (K, F, n_u): spectrum of the motors' velocity by the multisine.  coulomb
    (n_u,): Nm.  carrier_velocity (period_samples, n_u): v_c, rad/s.  d is the best linear approximation, which the fit
    identifies as viscous friction; s depends on the phases, is periodic, and averages over realisations only.
    """
    v = np.stack([synthesise(lines, spectrum, period_samples) for spectrum in V]) + carrier_velocity
    slope, power = sign_approximation(v, V, lines)
    return coulomb * slope, mean_of_neighbours(coulomb**2 * power)  # smoothed, because there are few experiments


# Residual power ratio of the distortion by friction after compensation; it was 0.1 and 1.4 % in two studies.
COMPENSATED_FRICTION = 0.004


@dataclass(frozen=True, eq=False)
class Prospect:
    """Model of a planned measurement, which predicts the response and its information in any configuration.

    plan: of one configuration, in representative realisations.  outputs, quantity: of the estimate.  distortion: std
    of G over |G| in one realisation.  includes_friction: responses have damping and scatter by friction, otherwise
    COMPENSATED_FRICTION times the scatter.  presliding: springs of motors in the model of the fit.
    """

    robot: Robot
    parameters: Parameters
    fit: FitSpec
    model: ModelSpec
    outputs: tuple[str, ...]
    quantity: Motion
    simulated: SimulatedSpec
    distortion: float
    plan: Plan
    realisations: int
    carrier_velocity: FloatArray
    includes_friction: bool
    presliding: tuple[RelaxingSpring, ...] = ()

    @property
    def R(self) -> ComplexArray:
        """Injected torques (M, E, F, n_u)."""
        return np.asarray(self.plan.R[0])

    @property
    def linearisation(self) -> Linearisation:
        """Linearisation of the fit's model."""
        return Linearisation.of_robot(self.robot, self.model, self.parameters.names, self.presliding)

    def expected(self, configuration: Configuration, x: FloatArray) -> ExpectedResponse:
        """Predict the response at parameters x (n_x,) in a configuration; StudyError without an equilibrium."""
        model, G, motion = self._local(configuration, x)
        covariance = self._covariance(G, motion, configuration)
        response = replace(to_response(model, self.parameters.expand(x), self.plan.freq_hz), total=covariance)
        return ExpectedResponse(response, model, weigh(response, self.fit), self.parameters, self.fit)

    def information(self, configuration: Configuration, x: FloatArray) -> FloatArray:
        """Return the information H (n_x, n_x) about x (n_x,)."""
        return self.expected(configuration, x).information(x)

    def source(self, configuration: Configuration, x: FloatArray) -> PowerSource:
        """Return the information as a function of the powers of R, with diagonal weights and the friction under R.

        StudyError without noise.
        """
        M, (_, G, motion) = self.realisations, self._local(configuration, x)
        diagonal = replace(self.fit.weights, covariance="diagonal")
        response = replace(self, fit=replace(self.fit, weights=diagonal)).expected(configuration, x)
        sensitivity, U = self._torques(configuration, motion)
        error = _diagonal(self._error(U, G, motion)) / M
        ((_, J),) = expected_fit([response]).blocks(x)
        is_used = response.weights.is_used
        if not np.all(error > 0):
            raise StudyError(
                "excitation/power",
                "flat: information needs noise that decreases with the injected power. Set "
                "experiment.simulated.noise, or choose another flat",
                "excitation.flat",
            )
        spread = np.abs(np.linalg.inv(sensitivity)) ** 2
        fixed = (response.weights.model_error**2 + self.distortion**2 / M) * np.abs(G) ** 2
        return PowerSource(J * np.where(is_used, response.weights.sigma, 0.0), error, spread, fixed, is_used)

    def _local(self, configuration: Configuration, x: FloatArray) -> tuple[LinearModel, ComplexArray, ComplexArray]:
        """Return the model, G (F, n_y, n_u), and the motor responses (F, n_u, n_u) in `quantity`."""
        theta = self.parameters.expand(x)
        motors = self.robot.motor_locations
        model = self.linearisation.at(configuration, theta[:-1], (*motors, *self.outputs), self.quantity)
        n_u = len(motors)
        G = frequency_response(model, theta, self.plan.freq_hz)
        return model.with_outputs(range(n_u, len(model.outputs))), G[:, n_u:], G[:, :n_u]

    def _covariance(self, G: ComplexArray, motion: ComplexArray, configuration: Configuration) -> Covariance:
        """Return cov(vec G) of the mean over all realisations; motion (F, n_u, n_u): motor responses, in `quantity`."""
        M = self.realisations
        distortion = (self.distortion * np.abs(G)) ** 2 / M
        sensitivity, U = self._torques(configuration, motion)
        inverse_power = (np.swapaxes(np.linalg.inv(self._power(U, sensitivity)), 1, 2) / M).astype(np.complex128)
        error = self._error(U, G, motion)
        noise = _diagonal(error)[:, :, None] * _diagonal(inverse_power)[:, None, :]
        return Covariance(noise + distortion, math.inf, *() if self.distortion > 0 else (inverse_power, error))

    def equivalent_damping(self, configuration: Configuration, x: FloatArray) -> FloatArray:
        """Return the equivalent damping (n_u,) of Coulomb friction, Nms/rad, link side."""
        motion = self._local(configuration, x)[2]
        return self._friction(self._torques(configuration, motion)[1], motion)[0]

    def reversals(self, configuration: Configuration, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return mean distance between reversals (inf without any), mean speed and travel (n_u,), rad, s, link side."""
        motion, rate_hz = self._local(configuration, x)[2], self.plan.rate_hz
        V = self._velocities(self._torques(configuration, motion)[1], motion)
        v = np.stack([synthesise(self.plan.lines, row, self.plan.period_samples) for row in V]) + self.carrier_velocity
        reversals = np.sum(np.signbit(v) != np.signbit(np.roll(v, 1, axis=1)), axis=(0, 1))
        travel = np.ptp(np.cumsum(v, axis=1), axis=1).max(axis=0) / rate_hz
        return quotient(np.abs(v).sum(axis=(0, 1)) / rate_hz, reversals, math.inf), np.abs(v).mean(axis=(0, 1)), travel

    def _velocities(self, U: ComplexArray, motion: ComplexArray) -> ComplexArray:
        """Return the velocities (M E, F, n_u) of motor shafts under U (M, E, F, n_u), rad/s, link side."""
        s = laplace_variable(self.plan.freq_hz[:, None, None])
        V = ((self.robot.mixing @ motion / s ** (MOTION_ORDER[self.quantity] - 1)) @ U[..., None])[..., 0]
        return V.reshape(-1, *V.shape[2:])

    def _power(self, U: ComplexArray, sensitivity: ComplexArray) -> ComplexArray:
        """Return U U^H (F, n_u, n_u) in a realisation, from U (M, E, F, n_u) and S = (I + F G_q)^-1 (F, n_u, n_u).

        With fewer experiments than inputs, neighbouring lines with independent phases together have the power
        S diag(|R|^2) S^H, with the mean |R|^2 of n_u lines.
        """
        M, E, F, n_u = U.shape
        if n_u <= E:
            return np.asarray(np.einsum("mefi,mefj->fij", U, U.conj()) / M)
        squares = np.sum(np.abs(self.R) ** 2, axis=(0, 1)) / M
        mean = squares[np.clip(np.arange(F) - n_u // 2, 0, F - n_u)[:, None] + np.arange(n_u)].mean(axis=1)
        return np.asarray(np.einsum("fik,fk,fjk->fij", sensitivity, mean, sensitivity.conj()), dtype=np.complex128)

    def _torques(self, configuration: Configuration, motion: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return (I + F G_q)^-1 (F, n_u, n_u), and U (M, E, F, n_u): injected torques plus the controller's reaction.

        If references are injected, these are I and the planned torques R.
        """
        freq_hz, rate_hz, controller = self.plan.freq_hz, self.plan.rate_hz, self.simulated.controller
        if self.plan.inject != "torque":
            return np.broadcast_to(np.eye(motion.shape[1], dtype=np.complex128), motion.shape), self.R
        loop = _gains(self.robot, self.model, tuple(configuration.angles.tolist()), controller)
        F, _ = sampled_responses(self.robot.driven_names, loop, controller, freq_hz, rate_hz)
        to_angle = zero_order_hold(freq_hz / rate_hz) / laplace_variable(freq_hz) ** MOTION_ORDER[self.quantity]
        difference = np.eye(len(loop.kp)) + F[:, :, None] * motion * to_angle[:, None, None]
        sensitivity = np.asarray(np.linalg.inv(difference), dtype=np.complex128)
        return sensitivity, (sensitivity @ self.R[..., None])[..., 0]

    def _friction(self, U: ComplexArray, motion: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Return damping d (n_u,) and scatter (F, n_u) by Coulomb friction of the motor shafts."""
        coulomb, lines = coulomb_torques(self.robot), self.plan.lines
        if not coulomb.any():
            return np.zeros(len(coulomb)), np.zeros((len(lines), len(coulomb)))
        V = self._velocities(U, motion)
        d, scatter = friction_linearisation(V, lines, self.plan.period_samples, coulomb, self.carrier_velocity)
        return (d, scatter) if self.includes_friction else (0 * d, COMPENSATED_FRICTION * scatter)

    def _error(self, U: ComplexArray, G: ComplexArray, motion: ComplexArray) -> ComplexArray:
        """Return C_V (F, n_y, n_y) of the mean over the periods, with the scatter by friction."""
        noise, freq_hz, rate_hz = self.simulated.noise, self.plan.freq_hz, self.plan.rate_hz
        zoh_power = np.sinc(freq_hz / rate_hz) ** 2
        power = sum(noise.variances(signal, freq_hz, rate_hz) for signal in ("torque", "disturbance"))
        torque = (zoh_power * power)[:, None, None]
        omega = 2 * np.pi * freq_hz[:, None]
        measured = np.array([MOTION_ORDER[logged_quantity(location)] for location in self.outputs])
        angle = omega ** (2 * (MOTION_ORDER[self.quantity] - measured)) * self._output_variances()
        per_sample = torque * (G @ np.swapaxes(G, 1, 2).conj()) + angle[:, :, None] * np.eye(len(self.outputs))
        scatter = self._friction(U, motion)[1]
        of_shafts = G @ self.robot.mixing.T
        friction_scatter = (of_shafts * scatter[:, None, :]) @ np.swapaxes(of_shafts, 1, 2).conj()
        return np.asarray(per_sample * (4 / (self.plan.period_samples * self.plan.periods)) + friction_scatter)

    def _output_variances(self) -> FloatArray:
        """Return equivalent white variances (F, n_y) of a sample, rad^2 or (m/s^2)^2: sensor noise and quantisation."""
        noise = self.simulated.noise
        color = noise.variances("angle", self.plan.freq_hz, self.plan.rate_hz) - noise.angle_std**2
        is_angle = [logged_quantity(location) == "position" for location in self.outputs]
        variances = np.asarray(output_stds(noise, self.outputs) ** 2 + color[:, None] * np.array(is_angle))
        if not noise.encoder_counts:
            return variances
        steps = np.array([2 * math.pi / (noise.encoder_counts * self.robot.ratio(j.name)) for j in self.robot.driven])
        quantisation = np.linalg.inv(self.robot.mixing) ** 2 @ (steps**2 / 12)
        for i, location in enumerate(self.outputs):
            if location in self.robot.motor_locations:
                variances[:, i] += quantisation[self.robot.motor_locations.index(location)]
        return variances


@lru_cache(maxsize=1024)
def _gains(robot: Robot, formulation: ModelSpec, angles: tuple[float, ...], spec: ControllerSpec) -> JointLoop:
    """Return the gains (n_u,) of the simulated joint controller in a configuration."""
    model = Linearisation.of_robot(robot, formulation).model
    return gains_of(model, rigid_posture(model, Configuration("", np.array(angles))), spec)


def _diagonal(matrices: ComplexArray) -> FloatArray:
    return np.asarray(np.einsum("fii->fi", matrices).real)
