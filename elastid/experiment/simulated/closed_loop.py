r"""Predictions for a plan: closed-loop response and feed-forward torque of the nominal robot about a configuration.

.. math:: u = [I + F H P]^{-1} r, \qquad q_m = H P u, \qquad F = k_p + k_d (1 - z^{-1}) / T_s

r: injected torque, P: motor torque to motor angle, H: hold of the controller, F: its feedback. Damping by Coulomb
friction is left out. Link side, SI.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from elastid.base.arrays import FloatArray, frozen
from elastid.experiment.plan.movement import Movement
from elastid.experiment.plan.references import FeedForward
from elastid.experiment.plan.torque_spectra import ClosedLoopResponse, PredictClosedLoop
from elastid.experiment.simulated.plant import model_of
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import Linearisation
from elastid.linear.measurement_chain import torque_elements
from elastid.linear.response.transfer import frequency_response
from elastid.model.elastic import ElasticModel
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward, tune


def closed_loop_of(robot: Robot, controller: ControllerSpec, rate_hz: float) -> PredictClosedLoop:
    """The closed-loop response of the nominal robot under a controller sampled at rate_hz, as `make_plan` takes it.

    It raises StudyError where a configuration has no equilibrium.
    """
    return partial(_closed_loop_response, robot, controller, rate_hz)


def _closed_loop_response(
    robot: Robot, controller: ControllerSpec, rate_hz: float, configuration: Configuration, freq_hz: FloatArray
) -> ClosedLoopResponse:
    linearisation = _linearisation(robot)
    model = linearisation.model
    linear = linearisation.at(configuration, model.theta, model.inputs, "position")
    linear = replace(linear, chain=torque_elements(robot.chain), gains=())  # the controller reads motions as they are
    q0 = equilibrium(model, model.theta, configuration).q
    gains = tune(model, q0, controller.bandwidth_hz, controller.damping_ratio, controller.velocity_integral_time)
    s = 2j * np.pi * freq_hz[:, None, None]
    z_inverse = np.exp(-s / rate_hz)
    hold = np.exp(-s / (2 * rate_hz)) * np.sinc(freq_hz / rate_hz)[:, None, None]
    P = hold * frequency_response(linear, linear.theta_ref, freq_hz)
    F = np.diag(gains.kp) + (1 - z_inverse) * rate_hz * np.diag(gains.kd)
    F = (1 + gains.ki / rate_hz * z_inverse / (1 - z_inverse)) * F
    torque = np.linalg.inv(np.eye(model.n_u) + F @ P)
    position = P @ torque
    return ClosedLoopResponse(torque, position, s * position, s**2 * position)


@lru_cache(maxsize=4)
def _linearisation(robot: Robot) -> Linearisation:
    return Linearisation.of(model_of(robot))


def feed_forward_of(model: ElasticModel) -> FeedForward:
    """The feed-forward torque of a rigid robot, as `reference` takes it."""

    def torque(configuration: Configuration, path: Movement) -> FloatArray:
        q0 = equilibrium(model, model.theta, configuration).q
        signals = np.stack([path.position, path.velocity, path.acceleration])
        return _feed_forward(model, tuple(q0.tolist()), signals.shape, signals.tobytes())

    return torque


@lru_cache(maxsize=4)
def _feed_forward(model: ElasticModel, q0: tuple[float, ...], shape: tuple[int, ...], path: bytes) -> FloatArray:
    """The torque (n, n_u) along a path (3, n, n_u), kept since all runs of a configuration follow the same one."""
    return frozen(feed_forward(model, np.array(q0), *np.frombuffer(path).reshape(shape)))
