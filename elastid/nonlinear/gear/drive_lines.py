r"""The linear model of a configuration on all lines of its periods: how forces in the drivetrain move the robot.

.. math:: Z(s)\, q = B u - \sum_i f_i P_i \Phi_i, \qquad Z = s^2 M + s D + K, \qquad H = Z^{-1}

P_i: the motor's coordinate, the link's, or the deflection of the gear, as rows in the model's coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.problem.elastic import kernel_of, linear_model
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import DELAY, TORQUE_LAG, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import factor
from elastid.model.drivetrain import input_matrix, spring_deflections
from elastid.nonlinear.gear.effects import Place
from elastid.nonlinear.gear.period_lines import PeriodLines
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER
from elastid.response import Response


@dataclass(frozen=True, eq=False)
class DriveLines:
    """H (F, n, n), C (n_u, n) of the motors' angles, G (F, n_u, n_u) of the logged ones with images of held torque.

    command (F, n_u): the torque that acts over the one that was logged.  sensor (F, n_u): logged angle over the true
    one.  images (F, n_u, n_u): what G has beyond sensor C H B command.  places: rows (n_j, n) of motors, gears and
    links, of all driven joints.  k, d, torque (n_j,): of their springs, and what these bear at rest; of a gear without
    a spring of its own 1, 0 and 0, which deflects by nothing.  chain (P, n_x): d theta / d x of the parameters
    `kernel.wanted`.
    """

    model: LinearModel
    kernel: Kernel
    theta: FloatArray
    H: ComplexArray
    C: FloatArray
    B: FloatArray
    G: ComplexArray
    images: ComplexArray
    command: ComplexArray
    sensor: ComplexArray
    places: dict[Place, FloatArray]
    k: FloatArray
    d: FloatArray
    torque: FloatArray
    chain: FloatArray

    def directions(self, place: Place, joint: int) -> FloatArray:
        """Row (n,) of a place at a joint."""
        return np.asarray(self.places[place][joint])


def elastic_joints(linearisation: Linearisation) -> tuple[str, ...]:
    """Names of the driven joints with a spring of their own in the gear."""
    springs = spring_deflections(linearisation.model.robot)
    return tuple(joint.name for joint in linearisation.model.robot.driven if f"k_{joint.name}" in springs)


def drive_lines(
    lines: PeriodLines,
    linearisation: Linearisation,
    response: Response,
    parameters: Parameters,
    x: FloatArray,
) -> DriveLines:
    """The model at x (n_x,); response: as fitted, of the same configuration, whose inputs have all their motors."""
    robot, name = linearisation.model.robot, lines.configuration.name
    theta = parameters.expand(x, name)
    motors = [response.outputs.index(place) for place in response.inputs]
    model = linear_model(linearisation, response, theta)
    kernel = kernel_of(model.with_outputs(motors), parameters, lines.freq_hz)
    M, D, K = model.matrices(theta)
    s = lines.s[:, None, None]
    H = np.asarray(np.linalg.inv(s**2 * M + s * D + K), np.complex128)
    C = model.with_outputs(motors).C
    of_outputs, of_inputs = kernel.model.channel_gains(theta)
    order = MOTION_ORDER[model.quantity]

    elements = (element for element in kernel.model.chain if element.name != TORQUE_LAG)
    lags = (element.response(lines.s, kernel.model.number(theta, element.name)) for element in elements)
    lag = np.prod([np.ones(len(lines.s), complex), *lags], axis=0)  # of the sensors
    sensor = lag[:, None] * of_outputs
    command = (factor(kernel.model, theta, lines.s) / lines.s**order / lag)[:, None] * of_inputs
    G = kernel.response(theta) / s**order
    images = G - sensor[:, :, None] * (C @ H @ model.B) * command[:, None, :]
    springs, driven = spring_deflections(robot), [joint.name for joint in robot.driven]
    of_model = model.Z if model.Z is not None else np.eye(model.n)
    n_q = of_model.shape[0]
    rows: dict[Place, FloatArray] = {
        "motor": robot.mixing @ input_matrix(robot).T,
        "gear": np.array([springs.get(f"k_{joint}", np.zeros(n_q)) for joint in driven]),
        "link": np.eye(n_q)[list(robot.driven_indices)],
    }
    numbers = dict(zip(model.parameters, theta, strict=True))
    k = np.array([numbers[f"k_{joint}"] if f"k_{joint}" in springs else 1.0 for joint in driven])
    d = np.array([numbers[f"d_{joint}"] if f"k_{joint}" in springs else 0.0 for joint in driven])
    rest = equilibrium(linearisation.model, theta[: -1 if DELAY in model.parameters else None], lines.configuration)
    places = {place: row @ of_model for place, row in rows.items()}
    chain = parameters.jacobian(x, name)[kernel.places]
    torque = k * (rows["gear"] @ rest.q)
    return DriveLines(model, kernel, theta, H, C, model.B, G, images, command, sensor, places, k, d, torque, chain)
