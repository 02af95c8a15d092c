r"""The rigid robot alone: torques of a motion and of an external force, as CasADi functions of link coordinates.

.. math:: \tau = M(q)\, a + c(q, v) + g(q), \qquad \tau_{ext} = J(q)^T w

Niglis & Oberg (2015), eqs. (2.6), (2.7), (2.11). Springs, dampers, friction and rotors are left out; an elastic joint
is a joint like any other here.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca
import numpy as np

from elastid.base.errors import StudyError
from elastid.model.frame_tree import tree, turns
from elastid.model.multibody import BodyInertia, bias, inertias
from elastid.model.velocities import frame_velocities, rates
from elastid.robot import Robot


def inverse_dynamics(robot: Robot) -> ca.Function:
    """tau(q, v, a, theta) (n_l,) that the joints bear, by Newton-Euler; theta in the order of robot.parameters().

    Nm of a rotation, N of a translation, in the order of robot.joints.
    """
    n, names = len(robot.joints), list(robot.parameters())
    q, v, a = (ca.SX.sym(name, n) for name in "qva")
    theta = ca.SX.sym("theta", len(names))
    layout = tree(robot)
    carried = inertias(robot, layout, dict(zip(names, ca.vertsplit(theta), strict=True)))
    tau = bias(layout, carried, turns(layout, q), v, np.array(robot.gravity), a)
    return ca.Function("inverse_dynamics", [q, v, a, theta], [tau], ["q", "v", "a", "theta"], ["tau"])


def regressor(robot: Robot) -> ca.Function:
    r"""Y(q, v, a) (n_l, 10 n_l) of the inverse dynamics, which are linear in the numbers of the bodies.

    .. math:: \tau = Y(q, v, a)\, \pi, \qquad
              \pi = (m, m c_x, m c_y, m c_z, I_{xx}, I_{yy}, I_{zz}, I_{xy}, I_{xz}, I_{yz})

    for each joint's frame in turn, I about its origin (Atkeson, An and Hollerbach, Int. J. Robotics Research 5(3),
    1986). Some columns are zero or depend on others: only combinations of the numbers can be identified.
    """
    n = len(robot.joints)
    q, v, a = (ca.SX.sym(name, n) for name in "qva")
    pi = ca.SX.sym("pi", 10, n)
    carried = []
    for m, hx, hy, hz, xx, yy, zz, xy, xz, yz in (ca.vertsplit(column) for column in ca.horzsplit(pi)):
        tensor = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
        carried.append(BodyInertia(m, ca.vertcat(hx, hy, hz), tensor))
    layout = tree(robot)
    tau = bias(layout, tuple(carried), turns(layout, q), v, np.array(robot.gravity), a)
    return ca.Function("regressor", [q, v, a], [ca.jacobian(tau, ca.vec(pi))], ["q", "v", "a"], ["Y"])


def external_torque(robot: Robot, frame: str, axes: Literal["base", "frame"] = "base") -> ca.Function:
    """tau(q, w) (n_l,): generalised forces of a wrench w (6,) = [force in N, moment in Nm] at a named frame's origin.

    axes: in which w is given.  In the equations it stands on the right, beside B u, zero for the motors' coordinates.
    StudyError where the robot has no such frame.
    """
    names = [each.name for each in robot.frames]
    if frame not in names:
        raise StudyError(f"robot {robot.name} has no frame {frame}; there are {', '.join(names) or 'none'}")
    q, w = ca.SX.sym("q", len(robot.joints)), ca.SX.sym("w", 6)
    layout = tree(robot)
    turned = turns(layout, q)
    row = 6 * names.index(frame)
    J = frame_velocities(layout, rates(layout, turned))[row : row + 6, :]
    seat = layout.named[names.index(frame)]

    def own(vector: ca.SX) -> ca.SX:
        """A vector of the base in the frame's axes."""
        chain, i = [], seat.frame
        while i >= 0:
            chain.append(i)
            i = layout.frames[i].parent
        for i in reversed(chain):
            vector = turned[i].back(ca.DM(layout.frames[i].R.T) @ vector)
        return ca.DM(seat.R.T) @ vector

    wrench = w if axes == "frame" else ca.vertcat(own(w[:3]), own(w[3:]))
    return ca.Function("external_torque", [q, w], [J.T @ wrench], ["q", "w"], ["tau"])
