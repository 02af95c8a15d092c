r"""minimal(robot): independent coordinates y, the loops eliminated; exact, or one of the usual approximations.

.. math:: q = \gamma(y): \quad \varphi(\gamma(y)) = 0, \qquad \dot q = Z \dot y, \quad
          Z = \begin{bmatrix} I \\ -\Phi_d^{-1} \Phi_i \end{bmatrix}, \qquad Z^T [M(q) \ddot q + f(q, \dot q) - B u] = 0

Niglis & Oberg (2015), eq. (2.34). Elastic rods are cut: they are force elements, and a loop that they close needs no
constraint. Other loops are eliminated by the implicit function theorem, exactly, in the linear model and in the
simulation; the dependent coordinates stay in q and are solved for, not integrated.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import casadi as ca

from elastid.base.errors import StudyError
from elastid.model.elastic import ElasticModel
from elastid.model.open_chain import by_name, elastic_model, open_chain
from elastid.model.parallel_linkage.approximations import STIFF, elastic_joints_within, series_stiffness, unbent
from elastid.model.parallel_linkage.loop_closure import closures, cut, elastic, with_rod_inertia
from elastid.model.spec import ModelSpec
from elastid.robot import Robot


def minimal(robot: Robot, spec: ModelSpec, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel with the independent coordinates of `spec`; StudyError for names that are no coordinates.

    geometry: names of robot.geometry that are parameters, too.
    """
    of = open_chain(robot, geometry)
    if spec.variant == "constant_stiffness":
        _refuse_moving_start(robot, of.parameters)
    n_l = len(robot.joints)
    within = elastic_joints_within(robot)
    seen = unbent(robot, of.q[:n_l]) if spec.variant == "bending_outside" else of.q[:n_l]
    found = closures(robot, seen, by_name(of))
    of = with_rod_inertia(robot, of, found, lumped=spec.variant == "lumped_rod")
    if spec.variant in STIFF:
        rows = [*(closure.rows for closure in found), *(of.q[i] for i in within)]
        if spec.variant != "rigid_loop":
            of = series_stiffness(robot, of, found, constant=spec.variant == "constant_stiffness")
    else:
        of = cut(of, found)
        stretched = elastic(found)
        rows = [closure.rows for closure in found if closure not in stretched]
    for _, refused in spec.independent_refusals(of.coordinates):
        raise StudyError(f"model.independent: {refused}")
    return elastic_model(robot, replace(of, phi=ca.vertcat(of.phi, *rows)), spec.independent)


def _refuse_moving_start(robot: Robot, parameters: Collection[str]) -> None:
    """The stiffness of that variant is the one at the start posture, which depends on the geometry."""
    moving = [name for name in robot.geometry if name in parameters]
    if moving:
        raise StudyError(
            f"model.variant: constant_stiffness holds the posture of the robot's own geometry, so that {moving[0]} "
            "cannot be identified with it; choose series_stiffness or exact"
        )
