r"""The drivetrain of a robot: motors, gears, springs, dampers and viscous friction as energies, all on the link side.

.. math:: T_m = \tfrac12 \sum_i J_{m,i} (\eta\, \dot q_m)_i^2, \quad V_s = \tfrac12 \delta^T K_a \delta, \quad
          R = \tfrac12 \Big( \dot\delta^T D_a \dot\delta + \sum f \dot q_a^2 + \sum_i f_{m,i} (\eta \dot q_m)_i^2 \Big)

with the deflections delta = q_m - q_a of elastic gears and delta = q_na of joints that are elastic but not driven. This
is the only place where gear ratios are applied to the model. eta (n_u, n_u): turns of the motors per turn of the
joints, not diagonal where gears couple axes; motor coordinates are q_m = eta^-1 q_m^m, motor torques u = eta^T tau_m^m,
so that a frequency response of motors is G^a = eta^-1 G^m eta^-T.

Spring s turns the joints by x_s k_s^-1 per torque x_s^T tau: compliances of springs in series, before, between and
after the stages of the gears, add,

.. math:: K_a^{-1} = \sum_s x_s k_s^{-1} x_s^T, \qquad D_a = K_a \Big( \sum_s x_s \frac{d_s}{k_s^2} x_s^T \Big) K_a

the damping to first order in omega d / k, below which a gearbox stays. Where there are no more springs than joints,
K_a = Z^T K Z with Z = X^-1 (eq. 2.28: Z = eta before the gears, 1 after them), exactly linear in each k, and D_a alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.sparse.csgraph import connected_components

from elastid.arrays import FloatArray
from elastid.robot import Robot
from elastid.robot.gears import spring_directions


@dataclass(frozen=True)
class Drivetrain:
    """K and D (n_q, n_q) of springs, dampers and viscous friction, M (n_q, n_q) of the rotors, as SX of theta.

    M: of rotors without a carrier; one that rides on a body stands in `rotors`.
    """

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


def rotor_rates(robot: Robot) -> FloatArray:
    """eta B^T (n_u, n_q): how fast each rotor turns in its housing per rate of the coordinates, motor side."""
    rates: FloatArray = robot.eta @ input_matrix(robot).T
    return rates


def drivetrain(robot: Robot, theta: Mapping[str, ca.SX]) -> Drivetrain:
    """The quadratic forms of T_m, R and V_s; theta maps every name of robot.parameters() to its symbol."""
    n_q = len(robot.joints) + len(robot.flexible)
    M, D, K = ca.SX(n_q, n_q), ca.SX(n_q, n_q), ca.SX(n_q, n_q)
    for i, joint in enumerate(robot.joints):
        rate = _direction(np.eye(n_q)[i])
        D += theta[f"f_{joint.name}"] * rate
        if joint.spring is not None and not joint.is_flexible:
            K += theta[f"k_{joint.name}"] * rate
            D += theta[f"d_{joint.name}"] * rate
    for joint, turning in zip(robot.driven, rotor_rates(robot), strict=True):
        D += theta[f"fm_{joint.name}"] * _direction(turning)
        if joint.motor is not None and not joint.motor.on:
            M += theta[f"Jm_{joint.name}"] * _direction(turning)
    for gearbox in gearboxes(robot):
        stiffness, damping = gearbox.in_series(theta)
        K += stiffness
        D += damping
    return Drivetrain(M, D, K)


@dataclass(frozen=True)
class Gearbox:
    """Elastic gears that give way together.

    springs (n_s,): names k_... of their springs.  X (n_g, n_s): how far each gear gives per rad of a spring.
    deflections (n_g, n_q): delta = q_m - q_a of each gear.
    """

    springs: tuple[str, ...]
    X: FloatArray
    deflections: FloatArray

    def in_series(self, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
        """K and D (n_q, n_q), as the module says."""
        n_q = self.deflections.shape[1]
        K, D = ca.SX(n_q, n_q), ca.SX(n_q, n_q)
        k, d = ([theta[letter + name[1:]] for name in self.springs] for letter in "kd")
        if len(k) == len(self.X):
            for stiffness, damping, z in zip(k, d, np.linalg.inv(self.X) @ self.deflections, strict=True):
                K, D = K + stiffness * _direction(z), D + damping * _direction(z)
            return K, D
        X, to_q = ca.DM(self.X), ca.DM(self.deflections)
        K_a = ca.inv(sum((1 / k_s * X[:, s] @ X[:, s].T for s, k_s in enumerate(k)), start=ca.SX(0)))
        losses = sum(
            (d_s / k_s**2 * X[:, s] @ X[:, s].T for s, (k_s, d_s) in enumerate(zip(k, d, strict=True))), ca.SX(0)
        )
        return to_q.T @ K_a @ to_q, to_q.T @ (K_a @ losses @ K_a) @ to_q


def gearboxes(robot: Robot) -> Iterator[Gearbox]:
    """The elastic gears of a robot, those that a spring turns together in one gearbox."""
    directions = spring_directions(robot.driven, robot.gears)
    springs, X = np.array([*directions]), np.array([*directions.values()]).reshape(-1, len(robot.driven)).T
    deflections = input_matrix(robot).T
    deflections[range(len(X)), [robot.joints.index(joint) for joint in robot.driven]] -= 1.0
    _, member = connected_components(X @ X.T != 0, directed=False)
    for box in np.unique(member[X.any(axis=1)]):
        gears = member == box
        within = X[gears].any(axis=0)
        yield Gearbox(tuple(springs[within].tolist()), X[np.ix_(gears, within)], deflections[gears])


def _direction(y: FloatArray) -> ca.DM:
    """y y^T (n_q, n_q), sparse, of a direction y (n_q,) that has few entries."""
    column = ca.sparsify(ca.DM(y))
    return column @ column.T
