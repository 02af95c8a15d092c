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

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import BASE, Robot, unit_axis
from elastid.robot.gears import Gearbox


def input_matrix(robot: Robot) -> FloatArray:
    """B (n_q, n_u): a link-side motor torque acts on its motor's coordinate alone, the joint's where the gear is rigid.

    eta B^T (n_u, n_q): how fast each rotor turns in its housing per rate of the coordinates, motor side.
    """
    n_l = len(robot.joints)
    B = np.zeros((n_l + len(robot.flexible), len(robot.driven)))
    for i, (joint, place) in enumerate(zip(robot.driven, robot.driven_indices, strict=True)):
        B[n_l + robot.flexible.index(joint) if joint in robot.flexible else place, i] = 1.0
    return B


def drivetrain(robot: Robot, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX, ca.SX]:
    """M, D, K (n_q, n_q), the quadratic forms of T_m, R and V_s, with rotors that have no carrier.

    theta maps every name of robot.parameters() to its symbol.
    """
    n_q = len(robot.joints) + len(robot.flexible)
    inertia: list[tuple[str, FloatArray]] = []
    damping: list[tuple[str, FloatArray]] = []
    stiffness: list[tuple[str, FloatArray]] = []
    for joint, rate in zip(robot.joints, np.eye(n_q), strict=False):
        damping.append((f"f_{joint.name}", rate))
        if joint.spring is not None and not joint.is_flexible:
            stiffness.append((f"k_{joint.name}", rate))
            damping.append((f"d_{joint.name}", rate))
    for joint, turning in zip(robot.driven, robot.eta @ input_matrix(robot).T, strict=True):
        damping.append((f"fm_{joint.name}", turning))
        if joint.motor is not None and not joint.motor.on:
            inertia.append((f"Jm_{joint.name}", turning))
    for name, z in spring_deflections(robot).items():
        stiffness.append((name, z))
        damping.append((f"d{name[1:]}", z))
    M, D, K = (
        sum((theta[name] * (y @ y.T) for name, y in sparse), start=ca.SX(n_q, n_q))
        for sparse in ([(name, ca.sparsify(ca.DM(y))) for name, y in terms] for terms in (inertia, damping, stiffness))
    )
    delta = gear_deflections(robot)
    for box in robot.gearboxes:
        if box.is_in_series:
            X, to_q, K_a = ca.DM(box.X), ca.DM(delta[list(box.gears)]), series_stiffness(box, theta)
            slowness = [theta[f"d{name[1:]}"] / theta[name] ** 2 for name in box.springs]
            losses = sum((slow * X[:, s] @ X[:, s].T for s, slow in enumerate(slowness)), start=ca.SX(0))
            K, D = K + to_q.T @ K_a @ to_q, D + to_q.T @ (K_a @ losses @ K_a) @ to_q
    return M, D, K


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


def series_stiffness(box: Gearbox, theta: Mapping[str, ca.SX]) -> ca.SX:
    """K_a (n_g, n_g) of a gearbox, compliances added, on the deflections that its springs allow."""
    U = ca.sparsify(ca.DM(box.range))
    X = U.T @ ca.DM(box.X)
    compliance = sum((1 / theta[name] * X[:, s] @ X[:, s].T for s, name in enumerate(box.springs)), start=ca.SX(0))
    return U @ ca.inv(compliance) @ U.T


def rotors(
    robot: Robot, theta: Mapping[str, ca.SX], q: ca.SX, v: ca.SX, angular_velocity: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """M (n_q, n_q) and Coriolis and centrifugal forces c (n_q,) of all rotors that have a carrier.

    q, v (n_q,): coordinates and rates.  angular_velocity (3 n_bodies, n_q): J v of the bodies in their own axes.
    """
    n_q, bodies = v.size1(), [body.name for body in robot.bodies]
    rates, inertias = [], []
    for joint, turning in zip(robot.driven, robot.eta @ input_matrix(robot).T, strict=True):
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
        return ca.SX(n_q, n_q), ca.SX(n_q, 1)
    Y, J = ca.sparsify(ca.vertcat(*rates)), ca.vertcat(*inertias)
    return Y.T @ ca.diag(J) @ Y, _coriolis(Y, J, q, v)


def _coriolis(Y: ca.SX, J: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
    """c (n_q,), by differentiating the scalar rates w = Y v along the motion and to q, the momenta p = J w held."""
    w, p = Y @ v, ca.SX.sym("p", J.size1())
    momentum = Y.T @ p
    held = ca.jtimes(momentum, q, v) - ca.gradient(ca.dot(p, w), q)
    return Y.T @ (J * ca.jtimes(w, q, v)) + ca.substitute(held, p, J * w)
