r"""Derivatives of a response to numbers that need no model of their own: the `columns` of hypotheses.

.. math:: \text{delay of an output or input}: \; -j \omega G \text{ in its row or column}, \qquad
          \text{rate}: \; \frac{dG}{d\epsilon} = \omega \frac{\partial G}{\partial \omega} - 2 G

.. math:: \text{ratio of motor } i: \quad \dot S G + G \dot S^T
          + 2 \Big( J_m \frac{\partial G}{\partial J_m} + f_m \frac{\partial G}{\partial f_m} + \ldots \Big),
          \qquad \dot S = E^{-1} e_i e_i^T E

since torque and angle were referred to the link side by the wrong ratio.  A rotor that rides on a body turns by n q'
plus that body's turn w q': to its terms of first order in n the factor 2 is one too many (`_of_carried_rotor`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.diagnosis.sensitivities import RATE, HeldResponse
from elastid.linear.linear_model import DELAY
from elastid.linear.response.transfer import frequency_response
from elastid.robot import Body, Robot, gain_name

# Of the smallest torque that a gear carries to the largest, above which no stiffness is seen to rise with it.
LOAD_RATIO = 0.97
# Part of a rotor's inertia, below which nothing rides on a body; and the step over which its derivative is taken.
RIDING = 1e-4


def rate_column(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivative to a sampling rate 1 + e of the stated one."""
    return {RATE: response.slopes[RATE] - 2 * response.G}


def channel_delays(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the delay of each output and input in s; a single one is the delay of all."""
    s, model, columns = 2j * np.pi * response.freq_hz[:, None, None], response.model, dict[str, ComplexArray]()
    for role, places, axis in (("y", model.outputs, 1), ("u", model.inputs, 2)):
        for i, place in enumerate(places if len(places) > 1 else ()):
            mask = np.zeros((1, len(model.outputs), len(model.inputs)))
            mask[(slice(None),) * axis + (i,)] = 1.0
            columns[gain_name(role, place).replace("gain", "delay", 1)] = -s * mask * response.G
    return columns


def gear_ratios(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the logarithm of each gear ratio."""
    robot, model, G, slopes = response.robot, response.model, response.G, response.slopes
    values = dict(zip(model.parameters, response.theta.tolist(), strict=True))
    inverse, columns = np.linalg.inv(robot.mixing), {}
    for i, joint in enumerate(robot.driven):
        turn = np.outer(inverse[:, i], robot.mixing[i])
        left, right = (_between(turn, robot, places) for places in (model.outputs, model.inputs))
        scaled = [f"{letters}_{joint.name}" for letters in ("Jm", "fm", "km", "dm")]
        moved = sum((2 * values[name] * slopes[name] for name in scaled if name in slopes), np.zeros_like(G))
        moved += _of_carried_rotor(response, i)
        columns[f"ratio_{joint.name}"] = left @ G + G @ right.T + moved
    return columns


def _of_carried_rotor(response: HeldResponse, i: int) -> ComplexArray | float:
    r"""dG (F, n_y, n_u) by what dM / d ln n of the rotor of driven joint i is beyond 2 J_m dM / dJ_m.

    .. math:: M = p p^T, \quad p = \sqrt{J_m} (n e + w), \qquad dM / d \ln n = \sqrt{J_m}\, n\, (e p^T + p e^T)

    e (n,): turn of the motor by the coordinates.  0 where it does not ride on a body (w = 0), or is no input.
    """
    robot, model, name = response.robot, response.model, f"Jm_{response.robot.driven[i].name}"
    slope = model.slopes[name].M if name in model.slopes else None
    if slope is None or set(robot.motor_locations) - set(model.inputs):
        return 0.0
    e = model.B[:, [model.inputs.index(place) for place in robot.motor_locations]] @ robot.mixing[i]
    own = response.value(name) * slope
    along = float(e @ own @ e)
    if not along > 0:
        return 0.0
    p = own @ e / math.sqrt(along)
    turn = np.outer(e, p) * float(e @ p) / float(e @ e)
    beyond = turn + turn.T - 2 * own
    if np.abs(beyond).max() < RIDING * np.abs(own).max():
        return 0.0
    G = [frequency_response(replace(model, M=model.M + h * beyond), response.theta, response.freq_hz)
         for h in (RIDING, -RIDING)]  # fmt: skip
    return np.asarray((G[0] - G[1]) / (2 * RIDING))


def posture_angles(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the angle of each axis in this configuration alone, rad."""
    name = response.model.configuration.name
    return {f"angle_{j.name}@{name}": response.slopes[f"angle_{j.name}"] for j in response.robot.driven}


def of_one_posture(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to what differs in this configuration alone.

    delay@c1 of all its channels, s; torques@c1: ln of the torques that are read per torque; spring_1@c1: ln k_1;
    m_fore@c1 ...: the numbers of the last body, which carries a load.  None of a single configuration.
    """
    name, robot, last = response.model.configuration.name, response.robot, response.robot.bodies[-1]
    if len(response.loads) < 2:
        return {}
    columns = {f"{DELAY}@{name}": -2j * np.pi * response.freq_hz[:, None, None] * response.G}
    columns[f"torques@{name}"] = -response.G
    for joint in robot.driven:
        if (spring := f"k_{joint.name}") in response.slopes:
            columns[f"spring_{joint.name}@{name}"] = response.value(spring) * response.slopes[spring]
    carried = {number: response.slopes[number] for number in inertial(last) if number in response.slopes}
    return columns | {f"{number}@{name}": column for number, column in carried.items()}


def inertial(body: Body) -> list[str]:
    """Names of the mass, the centre of mass and the inertia of a body."""
    entries = (f"I_{body.name}{suffix}" for suffix in body.inertia_entries)
    return [f"m_{body.name}", *(f"c_{body.name}_{axis}" for axis in "xyz"), *entries]


def stiffening(response: HeldResponse) -> dict[str, ComplexArray]:
    r"""Derivatives to the rise of each gear's stiffness with the torque tau that it carries.

    .. math:: k\, (1 + e\, \tau^2 / \tau_{max}^2)
    """
    columns = {}
    for joint in (each.name for each in response.robot.driven):
        loads = {name: abs(torques[joint]) for name, torques in response.loads.items()}
        most, spring = max(loads.values(), default=0.0), f"k_{joint}"
        if most > 0 and min(loads.values()) < LOAD_RATIO * most and spring in response.slopes:
            own = loads[response.model.configuration.name]
            columns[f"load_{joint}"] = (own / most) ** 2 * response.value(spring) * response.slopes[spring]
    return columns


def gear_couplings(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the turns of motor i, link side, per turn of joint j, where the file couples them by no gear."""
    robot, model, G, s = response.robot, response.model, response.G, 2j * np.pi * response.freq_hz[:, None, None]
    driven, inverse, columns = robot.driven, np.linalg.inv(robot.mixing), dict[str, ComplexArray]()
    places = model.outputs
    if model.inputs != places or model.quantity != "acceleration" or not set(places) <= set(robot.motor_locations):
        return {}
    rotors = [(response.value(f"Jm_{j.name}"), response.value(f"fm_{j.name}")) for j in driven]
    squared = [abs(j.motor.ratio) ** 2 if j.motor is not None else 0.0 for j in driven]
    for i, j in permutations(range(len(driven)), 2):
        turn = inverse[:, [i]] * np.eye(len(driven))[j]
        rows, columns_of = (_between(turn, robot, p) for p in (places, places))
        rotor = squared[i] * (rotors[i][0] + rotors[i][1] / s)
        pair = np.outer(robot.mixing[i], np.eye(len(driven))[j])
        moved = _between(pair + pair.T, robot, places)
        columns[f"coupling_{driven[i].name}_{driven[j].name}"] = rows @ G + G @ columns_of.T - rotor * (G @ moved @ G)
    return columns


def _between(turn: FloatArray, robot: Robot, places: tuple[str, ...]) -> FloatArray:
    """The entries of a matrix over motors (n_u, n_u) between places, zero for other places."""
    index = [robot.motor_locations.index(place) if place in robot.motor_locations else -1 for place in places]
    return np.array([[turn[i, j] if min(i, j) >= 0 else 0.0 for j in index] for i in index])
