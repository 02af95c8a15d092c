r"""The drivetrain of a robot: motors, gears, springs, dampers and viscous friction as energies, all on the link side.

.. math:: T_m = \tfrac12 \sum \eta^2 J_m \dot q_m^2, \quad V_s = \tfrac12 \sum k \delta^2, \quad
          R = \tfrac12 \sum (d \dot\delta^2 + f \dot q_a^2 + \eta^2 f_m \dot q_m^2)

with the deflection delta = q_m - q_a of an elastic gear and delta = q_na of a joint that is elastic but not driven.
This is the only place where a gear ratio eta (motor turns per joint turn) is applied to the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.arrays import FloatArray
from elastid.robot import Robot


@dataclass(frozen=True)
class Drivetrain:
    """K and D (n_q, n_q) of springs, dampers and viscous friction, M (n_q, n_q) of the rotors, as SX of theta."""

    M: ca.SX
    D: ca.SX
    K: ca.SX


def motor_coordinates(robot: Robot) -> dict[str, int]:
    """The coordinate of each driven joint's motor, by joint: its own where the gear is elastic, else the joint's."""
    joints = [joint.name for joint in robot.joints]
    own = {joint.name: len(joints) + i for i, joint in enumerate(robot.flexible)}
    return {joint.name: own.get(joint.name, joints.index(joint.name)) for joint in robot.driven}


def input_matrix(robot: Robot) -> FloatArray:
    """B (n_q, n_u): a link-side motor torque acts on its motor's coordinate alone."""
    rows = list(motor_coordinates(robot).values())
    B = np.zeros((len(robot.joints) + len(robot.flexible), len(rows)))
    B[rows, range(len(rows))] = 1.0
    return B


def drivetrain(robot: Robot, theta: Mapping[str, ca.SX]) -> Drivetrain:
    """The quadratic forms of T_m, R and V_s; theta maps every name of robot.parameters() to its symbol."""
    n_q = len(robot.joints) + len(robot.flexible)
    motor = motor_coordinates(robot)
    M, D, K = ca.SX(n_q, n_q), ca.SX(n_q, n_q), ca.SX(n_q, n_q)
    for i, joint in enumerate(robot.joints):
        rate = _direction(n_q, {i: 1.0})
        D += theta[f"f_{joint.name}"] * rate
        if joint.spring is not None:
            deflection = _direction(n_q, {motor[joint.name]: 1.0, i: -1.0}) if joint.is_flexible else rate
            K += theta[f"k_{joint.name}"] * deflection
            D += theta[f"d_{joint.name}"] * deflection
        if joint.motor is not None:
            motor_rate = joint.motor.ratio**2 * _direction(n_q, {motor[joint.name]: 1.0})
            M += theta[f"Jm_{joint.name}"] * motor_rate
            D += theta[f"fm_{joint.name}"] * motor_rate
    return Drivetrain(M, D, K)


def _direction(n_q: int, entries: Mapping[int, float]) -> ca.DM:
    """y y^T (n_q, n_q), sparse, of a direction y that has few entries."""
    y = ca.DM(n_q, 1)
    for index, value in entries.items():
        y[index] = value
    return y @ y.T
