"""The sections `model`, of the fit and of the simulated rig, against the robot."""

from __future__ import annotations

from collections.abc import Iterator

from elastid.model.spec import ModelSpec
from elastid.robot import Robot
from elastid.study.messages import Problem
from elastid.study.yaml_source import KeyPath


def check_model(path: KeyPath, spec: ModelSpec, robot: Robot) -> Iterator[Problem]:
    """The formulation suits the robot; independent coordinates are coordinates."""
    if refused := spec.loop_refusal(robot):
        yield Problem((*path, "formulation"), refused)
    coordinates = [f"joint {joint.name}" for joint in robot.joints]
    coordinates += [f"motor {joint.name}" for joint in robot.flexible]
    for i, refused in spec.independent_refusals(coordinates):
        yield Problem((*path, "independent", i), refused)
