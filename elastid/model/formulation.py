r"""formulate(robot, spec): the equations of motion as a serial tree, constrained, or minimal.

Serial, Niglis & Oberg (2015), eq. (2.10): the coordinates of a tree are independent; the extended flexible joint of eq.
(2.12) is a further joint with a spring. Constrained, eq. (2.33): all coordinates of the open chain, with multipliers.

.. math:: M(q)\, \ddot q + f(q, \dot q) + \Phi^T \lambda = B u, \qquad \varphi(q) = 0

The elongation of an elastic rod is a coordinate of its own; where the rod weighs nothing it has no inertia, and M is
singular: only on the null space of Phi is it regular. Minimal, eq. (2.34): independent coordinates y.

.. math:: q = \gamma(y): \quad \varphi(\gamma(y)) = 0, \qquad \dot q = Z \dot y, \quad
          Z = \begin{bmatrix} I \\ -\Phi_d^{-1} \Phi_i \end{bmatrix}, \qquad Z^T [M(q) \ddot q + f(q, \dot q) - B u] = 0

Elastic rods are cut: they are force elements, and a loop that they close needs no constraint. Other loops are
eliminated by the implicit function theorem, exactly, in the linear model and in the simulation; the dependent
coordinates stay in q and are solved for, not integrated.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import casadi as ca

from elastid.base.errors import StudyError
from elastid.model.approximations import STIFF, elastic_joints_within, series_stiffness, unbent
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import closures, cut, elastic, stretching, with_rod_inertia
from elastid.model.open_chain import by_name, elastic_model, open_chain
from elastid.model.spec import ModelSpec
from elastid.robot import Robot


def serial(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel of a tree of bodies: coordinates of all joints, then of the motors of flexible joints.

    geometry: names of robot.geometry that are parameters, too.
    """
    return elastic_model(robot, open_chain(robot, geometry))


def constrained(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel with one row for each rod and those of each pin and point; redundant rows are kept."""
    tree = open_chain(robot, geometry)
    loops = closures(robot, tree.q[: len(robot.joints)], by_name(tree))
    equations, rows = stretching(with_rod_inertia(robot, tree, loops), loops)
    return elastic_model(robot, replace(equations, phi=ca.vertcat(equations.phi, *rows)))


def minimal(robot: Robot, spec: ModelSpec, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel with the independent coordinates of `spec`; StudyError where a variant does not fit."""
    equations = open_chain(robot, geometry)
    moving = [name for name in robot.geometry if name in equations.parameters]
    if spec.variant == "constant_stiffness" and moving:
        raise StudyError(
            f"model.variant: constant_stiffness holds the posture of the robot's own geometry, so that {moving[0]} "
            "cannot be identified with it; choose series_stiffness or exact"
        )
    q = equations.q[: len(robot.joints)]
    loops = closures(robot, unbent(robot, q) if spec.variant == "bending_outside" else q, by_name(equations))
    stretched = elastic(loops)
    equations = with_rod_inertia(robot, equations, loops, lumped=spec.variant == "lumped_rod")
    if spec.variant in STIFF:
        rows = [*(closure.rows for closure in loops), *(equations.q[i] for i in elastic_joints_within(robot))]
        if spec.variant != "rigid_loop":
            equations = series_stiffness(robot, equations, stretched, constant=spec.variant == "constant_stiffness")
    else:
        equations = cut(equations, stretched)
        rows = [closure.rows for closure in loops if closure not in stretched]
    return elastic_model(robot, replace(equations, phi=ca.vertcat(equations.phi, *rows)), spec.independent)


# The formulation that suits the robot, without approximation.
EXACT = ModelSpec()


def formulate(robot: Robot, spec: ModelSpec = EXACT, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel of a robot in the formulation of `spec`; StudyError where the two do not fit.

    geometry: names of robot.geometry that are parameters of the model besides robot.parameters(); others do not count.
    """
    formulation = spec.formulation or ("constrained" if robot.loops else "serial")
    for (key, *_), refused in spec.refusals(robot):
        raise StudyError(f"model.{key}: {refused}")
    if formulation == "minimal":
        return minimal(robot, spec, geometry)
    return (serial if formulation == "serial" else constrained)(robot, geometry)
