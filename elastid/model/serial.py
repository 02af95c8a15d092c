r"""serial(robot): the equations of a robot that is a tree, so that its coordinates are independent.

.. math:: M(q)\, \ddot q + f(q, \dot q) = B u

Niglis & Oberg (2015), eq. (2.10); the extended flexible joint of eq. (2.12) is a further joint with a spring.
"""

from __future__ import annotations

from collections.abc import Collection

from elastid.model.elastic import ElasticModel
from elastid.model.open_chain import elastic_model, open_chain
from elastid.robot import Robot


def serial(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel of a tree of bodies: coordinates of all joints, then of the motors of flexible joints.

    geometry: names of robot.geometry that are parameters, too.
    """
    return elastic_model(robot, open_chain(robot, geometry))
