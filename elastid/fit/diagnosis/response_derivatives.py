r"""Derivatives of the response with respect to fixed parameters outside the equations of motion: delays and ratios.

.. math:: \text{delay of an output or input}: \; -j \omega G \text{ in its row or column}

.. math:: \text{ratio of motor } i: \quad \dot S G + G \dot S^T
          + 2 \Big( J_m \frac{\partial G}{\partial J_m} + f_m \frac{\partial G}{\partial f_m} + \ldots \Big),
          \qquad \dot S = E^{-1} e_i e_i^T E

because a wrong ratio wrongly converts the motor's torque and angle to the link side.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable, values_by_name
from elastid.fit.diagnosis.extended_model import ModelResponse
from elastid.parameters import DELAY
from elastid.robot import Body, Robot, channel_name

MAX_LOAD_RATIO = 0.97  # of smallest to largest torque of a gear, for a stiffness that depends on torque

MIN_LOAD_RATIO = 0.01  # torques below this fraction of the largest one are increased to it


def channel_delays(response: ModelResponse) -> dict[str, ComplexArray]:
    """Return the derivatives with respect to the delay (s) of each output and input, or to a single one of all."""
    s, model, columns = laplace_variable(response.freq_hz[:, None, None]), response.model, dict[str, ComplexArray]()
    for role, locations, axis in (("y", model.outputs, 1), (model.input_role, model.driven, 2)):
        for i, location in enumerate(locations if len(locations) > 1 else ()):
            mask = np.zeros((1, len(model.outputs), len(model.inputs)))
            mask[(slice(None),) * axis + (i,)] = 1.0
            columns[channel_name("delay", role, location)] = (s if role == "u" else -s) * mask * response.G
    return columns if model.controller is None else columns | {channel_name("delay", "r"): -s * response.G}


def gear_ratios(response: ModelResponse) -> dict[str, ComplexArray]:
    """Return the derivatives with respect to the logarithm of each gear ratio."""
    robot, model, G, slopes = response.robot, response.model, response.G, response.slopes
    values = values_by_name(model.parameters, response.theta)
    inverse, columns = np.linalg.inv(robot.mixing), {}
    for i, joint in enumerate(robot.driven):
        turn = np.outer(inverse[:, i], robot.mixing[i])
        of_outputs, of_inputs = (_between(turn, robot, locations) for locations in (model.outputs, model.inputs))
        names = [f"{letters}_{joint.name}" for letters in ("Jm", "fm", "km", "dm")]
        by_scale = sum((2 * values[name] * slopes[name] for name in names if name in slopes), np.zeros_like(G))
        columns[f"ratio_{joint.name}"] = of_outputs @ G + G @ of_inputs.T + by_scale
    return columns


def posture_angles(response: ModelResponse) -> dict[str, ComplexArray]:
    """Return the derivatives with respect to the angle of each axis in this configuration alone, rad."""
    name = response.model.configuration.name
    zeros = {joint.name: f"zero_{joint.name}" for joint in response.robot.driven}
    return {f"angle_{joint}@{name}": response.slopes[zero] for joint, zero in zeros.items() if zero in response.slopes}


def one_posture_values(response: ModelResponse) -> dict[str, ComplexArray]:
    """Return derivatives with respect to values of this configuration only; none if it is the only one.

    delay@c1: delay of all positions, s.  torques@c1: logarithm of a common gain of the torques.  spring_1@c1: ln k_1.
    m_fore@c1, ...: mass, centre and inertia of the last body, which carries the payload.
    """
    name, robot, last = response.model.configuration.name, response.robot, response.robot.bodies[-1]
    if len(response.loads) < 2:
        return {}
    columns = {f"{DELAY}@{name}": -2j * np.pi * response.freq_hz[:, None, None] * response.G}
    columns[f"torques@{name}"] = -response.G
    for joint in robot.driven:
        if (spring := f"k_{joint.name}") in response.slopes:
            columns[f"spring_{joint.name}@{name}"] = response.value(spring) * response.slopes[spring]
    slopes = {number: response.slopes[number] for number in inertial_names(last) if number in response.slopes}
    return columns | {f"{number}@{name}": column for number, column in slopes.items()}


def inertial_names(body: Body) -> list[str]:
    """Return the names of the mass, the centre of mass and the inertia of a body."""
    entries = (f"I_{body.name}{suffix}" for suffix in body.inertia_entries)
    return [f"m_{body.name}", *(f"c_{body.name}_{axis}" for axis in "xyz"), *entries]


def stiffening(response: ModelResponse) -> dict[str, ComplexArray]:
    r"""Return the derivatives with respect to the change of each gear's stiffness with its torque tau.

    load_2: of a hardening gear.  play_2: of a gear with backlash, whose tangent stiffness is low near zero torque.

    .. math:: k\, (1 + e\, \tau^2 / \tau_{max}^2), \qquad k\, (1 - e\, \tau_{min}^4 / \tau^4)
    """
    columns = {}
    for joint in response.robot.driven_names:
        loads = {name: abs(torques[joint]) for name, torques in response.loads.items()}
        max_load, spring = max(loads.values(), default=0.0), f"k_{joint}"
        if max_load > 0 and min(loads.values()) < MAX_LOAD_RATIO * max_load and spring in response.slopes:
            load = loads[response.model.configuration.name]
            min_load = max(min(loads.values()), MIN_LOAD_RATIO * max_load)
            slope = response.value(spring) * response.slopes[spring]
            columns[f"load_{joint}"] = (load / max_load) ** 2 * slope
            columns[f"play_{joint}"] = -((min_load / max(load, min_load)) ** 4) * slope
    return columns


def gear_couplings(response: ModelResponse) -> dict[str, ComplexArray]:
    """Return the derivatives with respect to missing gear couplings, rotations of motor i per rotation of joint j."""
    robot, model, G, s = response.robot, response.model, response.G, laplace_variable(response.freq_hz[:, None, None])
    driven, inverse, columns = robot.driven, np.linalg.inv(robot.mixing), dict[str, ComplexArray]()
    outputs = model.outputs
    if model.inputs != outputs or model.quantity != "acceleration" or not set(outputs) <= set(robot.motor_locations):
        return {}
    rotors = [(response.value(f"Jm_{j.name}"), response.value(f"fm_{j.name}")) for j in driven]
    ratios_squared = [abs(j.motor.ratio) ** 2 if j.motor is not None else 0.0 for j in driven]
    for i, j in permutations(range(len(driven)), 2):
        turn = inverse[:, [i]] * np.eye(len(driven))[j]
        rows, columns_of = (_between(turn, robot, p) for p in (outputs, outputs))
        rotor = ratios_squared[i] * (rotors[i][0] + rotors[i][1] / s)
        pair = np.outer(robot.mixing[i], np.eye(len(driven))[j])
        pairs = _between(pair + pair.T, robot, outputs)
        columns[f"coupling_{driven[i].name}_{driven[j].name}"] = rows @ G + G @ columns_of.T - rotor * (G @ pairs @ G)
    return columns


def _between(turn: FloatArray, robot: Robot, locations: tuple[str, ...]) -> FloatArray:
    """Return the entries of a matrix over motors (n_u, n_u) for rows and columns at locations; 0 if not at a motor."""
    index = [robot.motor_locations.index(place) if place in robot.motor_locations else -1 for place in locations]
    return np.array([[turn[i, j] if min(i, j) >= 0 else 0.0 for j in index] for i in index])
