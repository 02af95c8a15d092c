"""formulate(robot, spec): the equations that a study asks for, whatever the robot is built of."""

from __future__ import annotations

from elastid.model.elastic import ElasticModel
from elastid.model.serial import serial
from elastid.model.spec import ModelSpec
from elastid.robot import Robot

# What suits the robot, without approximation.
EXACT = ModelSpec()


def formulate(robot: Robot, spec: ModelSpec = EXACT) -> ElasticModel:
    """The ElasticModel of a robot in the formulation of `spec`."""
    return serial(robot)
