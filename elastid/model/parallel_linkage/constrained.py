r"""constrained(robot): all coordinates of the open chain, the loops closed by constraints with multipliers.

.. math:: M(q)\, \ddot q + f(q, \dot q) + \Phi^T \lambda = B u, \qquad \varphi(q) = 0

Niglis & Oberg (2015), eq. (2.33). The elongation of an elastic rod is a coordinate of its own; where the rod weighs
nothing it has no inertia, and M is singular: only on the null space of Phi is it regular.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import casadi as ca

from elastid.model.elastic import ElasticModel
from elastid.model.open_chain import by_name, elastic_model, open_chain
from elastid.model.parallel_linkage.loop_closure import closures, stretching, with_rod_inertia
from elastid.robot import Robot


def constrained(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel with one row for each rod and those of each pin and point; redundant rows are kept.

    geometry: names of robot.geometry that are parameters, too.
    """
    of = open_chain(robot, geometry)
    found = closures(robot, of.q[: len(robot.joints)], by_name(of))
    of = with_rod_inertia(robot, of, found)
    of, rows = stretching(of, found)
    return elastic_model(robot, replace(of, phi=ca.vertcat(of.phi, *rows)))
