r"""serial(robot): the equations of a robot that is a tree, so that its coordinates are independent.

.. math:: \begin{bmatrix} M(q_l) & \\ & M_m \end{bmatrix} \ddot q + f(q, \dot q) = B u, \qquad q = [q_l;\, q_m]

Niglis & Oberg (2015), eq. 2.10; the extended flexible joint (2.12) is a further joint with a spring. Conventions of
sign and side: `elastic`.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from elastid.model.drivetrain import drivetrain, input_matrix
from elastid.model.elastic import ElasticModel
from elastid.model.multibody import angular_velocities, bias, composites, inertias, mass_matrix, tree, turns
from elastid.robot import Robot


def serial(robot: Robot) -> ElasticModel:
    """The ElasticModel of a tree of bodies: coordinates of all joints, then of the motors of flexible joints."""
    table = robot.parameters()
    coordinates = (
        *(f"joint {joint.name}" for joint in robot.joints),
        *(f"motor {joint.name}" for joint in robot.flexible),
    )
    n_q, n_l = len(coordinates), len(robot.joints)
    q, v, theta = ca.SX.sym("q", n_q), ca.SX.sym("v", n_q), ca.SX.sym("theta", len(table))
    lambda_ = ca.SX.sym("lambda", 0)
    named = dict(zip(table, ca.vertsplit(theta), strict=True))

    gravity = np.array(robot.gravity)
    layout = tree(robot)
    turned = turns(layout, q[:n_l])
    carried = inertias(robot, layout, named)
    composite = composites(layout, carried, turned)
    drive = drivetrain(robot, named)
    M = ca.diagcat(mass_matrix(layout, composite, turned), ca.SX(n_q - n_l, n_q - n_l)) + drive.M
    f = ca.vertcat(bias(layout, carried, turned, v[:n_l], gravity), ca.SX(n_q - n_l, 1)) + drive.K @ q + drive.D @ v
    V = q.T @ drive.K @ q / 2 - ca.dot(composite[-1].h, ca.DM(gravity))
    J = ca.horzcat(angular_velocities(layout, turned), ca.SX(3 * len(robot.bodies), n_q - n_l))
    return ElasticModel(
        robot=robot,
        coordinates=coordinates,
        inputs=robot.motor_locations,
        parameters=tuple(table),
        theta=np.array([value for value, _ in table.values()]),
        B=input_matrix(robot),
        mass=_function("mass", {"q": q, "theta": theta}, {"M": M}),
        force=_function("force", {"q": q, "v": v, "theta": theta}, {"f": f}),
        constraint=_function("constraint", {"q": q, "theta": theta}, {"phi": ca.SX(0, 1)}),
        damping=_function("damping", {"q": q, "theta": theta}, {"D": drive.D}),
        stiffness=_function("stiffness", {"q": q, "lambda_": lambda_, "theta": theta}, {"K": ca.hessian(V, q)[0]}),
        potential_gradient=_function("potential_gradient", {"q": q, "theta": theta}, {"g": ca.gradient(V, q)}),
        angular_velocity=_function("angular_velocity", {"q": q}, {"J": J}),
    )


def _function(name: str, arguments: dict[str, ca.SX], value: dict[str, ca.SX]) -> ca.Function:
    return ca.Function(name, [*arguments.values()], [*value.values()], [*arguments], [*value])
