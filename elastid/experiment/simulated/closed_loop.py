r"""What the robot is expected to do, before it is measured: the closed loop of its nominal model about a configuration.

.. math:: u = [I + F H P]^{-1} r, \qquad q_m = H P u, \qquad F = k_p + k_d (1 - z^{-1}) / T_s

r: injected torque, P: motor torque to motor angle, H: hold of the controller, F: its feedback. Friction's Coulomb part,
which damps, is left out. Link side, SI.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.excitation.spec import Signal
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import Linearisation
from elastid.linear.measurement_chain import torque_elements
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import tuned


@dataclass(frozen=True)
class ClosedLoopResponse:
    """From injected torques (F, n_u, n_u): the motors' torque, and their position, velocity and acceleration."""

    torque: ComplexArray
    position: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray

    def of(self, signals: tuple[Signal, ...]) -> ComplexArray:
        """The responses of several signals (F, n_signals n_u, n_u), one signal's motors after the other's."""
        return np.concatenate([getattr(self, signal) for signal in signals], axis=1)


def closed_loop_response(
    robot: Robot, controller: ControllerSpec, configuration: Configuration, freq_hz: FloatArray, rate_hz: float
) -> ClosedLoopResponse:
    """The responses at freq_hz (F,) with a controller sampled at rate_hz; StudyError where there is no equilibrium."""
    linearisation = _linearisation(robot)
    model = linearisation.model
    linear = linearisation.at(configuration, model.theta, model.inputs, "position")
    linear = replace(linear, chain=torque_elements(robot.chain))  # the controller reads what no filter has seen
    q0 = equilibrium(model, model.theta, configuration).q
    gains = tuned(model, q0, controller.bandwidth_hz, controller.damping_ratio, controller.velocity_integral_time)
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
    return Linearisation.of(formulate(robot))
