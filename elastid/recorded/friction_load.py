"""The load that joints carry in a log: the model's holding torques, never the torque that is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Body, Robot


def load_torques(robot: Robot, posture: Configuration, payload: float) -> Mapping[str, float]:
    """|torque| (Nm, N) that holds each driven joint at rest in the posture; payload: kg at the last frame."""
    loaded = with_payload(robot, payload)
    model = formulate(loaded)
    held = equilibrium(model, np.asarray(model.theta), posture).u
    return {joint.name: abs(float(torque)) for joint, torque in zip(loaded.driven, held, strict=True)}


def with_payload(robot: Robot, payload: float) -> Robot:
    """The robot with a point mass in kg at its last frame, beside its own payload; the same where there is none."""
    if not payload or not robot.frames:
        return robot
    seat = robot.frames[-1]
    return replace(robot, bodies=(*robot.bodies, Body("friction load", seat.body, seat.placement, mass=payload)))
