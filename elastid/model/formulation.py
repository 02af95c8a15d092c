"""formulate(robot, spec): the equations of motion in the formulation that a study chooses, serial ones among them."""

from __future__ import annotations

from collections.abc import Collection

from elastid.base.errors import StudyError
from elastid.model.elastic import ElasticModel
from elastid.model.open_chain import elastic_model, open_chain
from elastid.model.parallel_linkage.constrained import constrained
from elastid.model.parallel_linkage.minimal import minimal
from elastid.model.spec import ModelSpec
from elastid.robot import Robot


def serial(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel of a tree of bodies: coordinates of all joints, then of the motors of flexible joints.

    geometry: names of robot.geometry that are parameters, too.
    """
    return elastic_model(robot, open_chain(robot, geometry))


# The formulation that suits the robot, without approximation.
EXACT = ModelSpec()


def formulate(robot: Robot, spec: ModelSpec = EXACT, geometry: Collection[str] = ()) -> ElasticModel:
    """The ElasticModel of a robot in the formulation of `spec`; StudyError where the two do not fit.

    geometry: names of robot.geometry that are parameters of the model beside robot.parameters(); others do not count.
    """
    formulation = spec.formulation or ("constrained" if robot.loops else "serial")
    if refused := spec.loop_refusal(robot):
        raise StudyError(f"model.formulation: {refused}")
    if formulation == "serial":
        return serial(robot, geometry)
    return constrained(robot, geometry) if formulation == "constrained" else minimal(robot, spec, geometry)
