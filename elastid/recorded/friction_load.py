"""The load that joints carry in a log: the model's holding torques, never the torque that is fitted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.robot.loaded import with_point_mass


def load_torques(robot: Robot, posture: Configuration, payload: float) -> Mapping[str, float]:
    """|torque| (Nm, N) that holds each driven joint at rest in the posture; payload: kg at the last frame."""
    loaded = with_point_mass(robot, payload)
    model = formulate(loaded)
    held = equilibrium(model, np.asarray(model.theta), posture).u
    return {joint.name: abs(float(torque)) for joint, torque in zip(loaded.driven, held, strict=True)}
