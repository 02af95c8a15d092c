r"""The drivetrain of a robot: motors, gears, springs, dampers and viscous friction as energies, all on the link side.

.. math:: T_m = \tfrac12 \sum_i J_{m,i} (\eta\, \dot q_m)_i^2, \quad V_s = \tfrac12 \delta^T K_a \delta, \quad
          R = \tfrac12 \Big( \dot\delta^T D_a \dot\delta + \sum f \dot q_a^2 + \sum_i f_{m,i} (\eta \dot q_m)_i^2 \Big)

Niglis & Oberg (2015), eqs. (2.8a), (2.8b), with the deflections delta = q_m - q_a of elastic gears and delta = q_na of
joints that are elastic but not driven. This is the only place where gear ratios are applied to the model.
eta (n_u, n_u): turns of the motors per turn of the joints, not diagonal where gears couple axes; motor coordinates are
q_m = eta^-1 q_m^m, motor torques u = eta^T tau_m^m, so that a frequency response of motors is G^a = eta^-1 G^m eta^-T.

Spring s turns the joints by x_s k_s^-1 per torque x_s^T tau: compliances of springs in series, before, between and
after the stages of the gears, add,

.. math:: K_a^{-1} = \sum_s x_s k_s^{-1} x_s^T, \qquad D_a = K_a \Big( \sum_s x_s \frac{d_s}{k_s^2} x_s^T \Big) K_a

the damping to first order in omega d / k, below which a gearbox stays. Where there are no more springs than joints,
K_a = Z^T K Z with Z = X^-1, eta before the gears, 1 after them, exactly linear in each k, as is D_a: eqs. (2.24),
(2.26) to (2.30). Where there are fewer, since some of the coupled gears have no spring, the rigid directions are
constraints, N^T delta = 0 with N^T X = 0, and K_a acts on the deflections that X spans.

A rotor that rides on a body adds the inertial coupling S and the Coriolis terms C_1 and C_2 of the complete model:

.. math:: T = \tfrac12 \sum_i J_i w_i^2, \qquad w_i = a_i \cdot \omega_{carrier,i}(q_l, \dot q_l) + (\eta\, \dot q_m)_i

Each rotor is symmetric about its axis a_i, fixed to its carrier, and turns with q_m relative to it. With Y = dw/dv the
equations of motion get

.. math:: M = Y^T J\, Y, \qquad S = \partial^2 T / \partial \dot q_l\, \partial \dot q_m, \qquad
          c = Y^T J\, \dot w|_{\dot v = 0} + \dot Y^T J w - (\partial w / \partial q)^T J w

Niglis & Oberg (2015), eqs. (2.22), (3.1), (3.4): c is C_1 in the rows of the links, at most linear in q_m', and C_2 in
those of the motors, free of q_m'. S is strictly upper triangular only where motor i rides on link i - 1, which is not
so in eq. (3.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import BASE, Robot, unit_axis
from elastid.robot.gears import Gearbox


@dataclass(frozen=True)
class Drivetrain:
    """K and D (n_q, n_q) of springs, dampers and viscous friction, M (n_q, n_q) of the rotors, as SX of theta.

    M: of rotors without a carrier; those that ride on a body are in `motor_coupling`.
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
    return np.asarray(robot.eta @ input_matrix(robot).T)


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
    for name, z in spring_deflections(robot).items():
        K += theta[name] * _direction(z)
        D += theta[f"d{name[1:]}"] * _direction(z)
    for box in robot.gearboxes:
        if box.is_in_series:
            stiffness, damping = _in_series(box, gear_deflections(robot)[list(box.gears)], theta)
            K, D = K + stiffness, D + damping
    return Drivetrain(M, D, K)


def gear_deflections(robot: Robot) -> FloatArray:
    """delta = q_m - q_a of each driven joint as rows (n_u, n_q); zero rows for rigid gears."""
    rows = input_matrix(robot).T
    rows[range(len(rows)), robot.driven_indices] -= 1.0
    return rows


def spring_deflections(robot: Robot) -> dict[str, FloatArray]:
    """z (n_q,), by name k_..., of springs in elastic gears: they are deflected by z q. None for springs in series."""
    delta = gear_deflections(robot)
    rows: dict[str, FloatArray] = {}
    for box in robot.gearboxes:
        if not box.is_in_series:
            rows |= dict(zip(box.springs, box.deflections @ delta[list(box.gears)], strict=True))
    return rows


def rigid_rows(robot: Robot) -> FloatArray:
    """A (n_c, n_q) of A q = 0, the constraints of rigid gears that are coupled with elastic ones; else no rows."""
    delta = gear_deflections(robot)
    rows = [box.rigid @ delta[list(box.gears)] for box in robot.gearboxes]
    return np.vstack([np.zeros((0, delta.shape[1])), *rows])


def series_torques(robot: Robot, theta: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """x_s^T K_a (1, n_q), by name k_... or km_..., of springs in series: the torque that each bears is this times q."""
    rows: dict[str, ca.SX] = {}
    for box in robot.gearboxes:
        if box.is_in_series:
            torques = ca.DM(box.X).T @ _series_stiffness(box, theta) @ ca.DM(gear_deflections(robot)[list(box.gears)])
            rows |= dict(zip(box.springs, ca.vertsplit(torques), strict=True))
    return rows


def _series_stiffness(box: Gearbox, theta: Mapping[str, ca.SX]) -> ca.SX:
    """K_a (n_g, n_g) of a gearbox, compliances added, on the deflections that its springs allow."""
    U = ca.sparsify(ca.DM(box.range))
    X = U.T @ ca.DM(box.X)
    compliance = sum((1 / theta[name] * X[:, s] @ X[:, s].T for s, name in enumerate(box.springs)), start=ca.SX(0))
    return U @ ca.inv(compliance) @ U.T


def _in_series(box: Gearbox, delta: FloatArray, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """K and D (n_q, n_q) of a gearbox with deflections delta (n_g, n_q), compliances added."""
    X, to_q, K_a = ca.DM(box.X), ca.DM(delta), _series_stiffness(box, theta)
    slowness = [theta[f"d{name[1:]}"] / theta[name] ** 2 for name in box.springs]
    losses = sum((slow * X[:, s] @ X[:, s].T for s, slow in enumerate(slowness)), start=ca.SX(0))
    return to_q.T @ K_a @ to_q, to_q.T @ (K_a @ losses @ K_a) @ to_q


def _direction(y: FloatArray) -> ca.DM:
    """y y^T (n_q, n_q), sparse, of a direction y (n_q,) that has few entries."""
    column = ca.sparsify(ca.DM(y))
    return column @ column.T


@dataclass(frozen=True)
class Rotors:
    """M (n_q, n_q) and Coriolis and centrifugal forces c (n_q,) of all rotors that have a carrier."""

    M: ca.SX
    c: ca.SX


def rotors(robot: Robot, theta: Mapping[str, ca.SX], q: ca.SX, v: ca.SX, angular_velocity: ca.SX) -> Rotors:
    """Of coordinates q and rates v (n_q,); angular_velocity (3 n_bodies, n_q): J v of the bodies in their own axes."""
    n_q, bodies = v.size1(), [body.name for body in robot.bodies]
    rates, inertias = [], []
    for joint, turning in zip(robot.driven, rotor_rates(robot), strict=True):
        motor = joint.motor
        if motor is None or motor.axis is None:
            continue
        Y = ca.SX(ca.sparsify(ca.DM(turning)).T)
        if motor.on != BASE:
            row = 3 * bodies.index(motor.on)
            # A motor on a body turns with it about its axis.
            Y += ca.sparsify(ca.DM(unit_axis(motor.axis))).T @ angular_velocity[row : row + 3, :]
        rates.append(Y)
        inertias.append(theta[f"Jm_{joint.name}"])
    if not rates:
        return Rotors(ca.SX(n_q, n_q), ca.SX(n_q, 1))
    Y, J = ca.sparsify(ca.vertcat(*rates)), ca.vertcat(*inertias)
    return Rotors(Y.T @ ca.diag(J) @ Y, _coriolis(Y, J, q, v))


def _coriolis(Y: ca.SX, J: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
    """c (n_q,), by differentiating the scalar rates w = Y v along the motion and to q, the momenta p = J w held."""
    w, p = Y @ v, ca.SX.sym("p", J.size1())
    momentum = Y.T @ p
    held = ca.jtimes(momentum, q, v) - ca.gradient(ca.dot(p, w), q)
    return Y.T @ (J * ca.jtimes(w, q, v)) + ca.substitute(held, p, J * w)
