r"""Rotors that ride on bodies: the complete model's inertial coupling S and its Coriolis terms C_1 and C_2.

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

from elastid.model.drivetrain import rotor_rates
from elastid.robot import BASE, Robot, unit_axis


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
