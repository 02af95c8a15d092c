"""One elastic joint alone, cut out of a robot whose other joints are held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.formulation import formulate
from elastid.robot import Robot


@dataclass(frozen=True)
class ElasticJoint:
    """Inertias of motor and link, stiffness and damping of the spring between them, all on one side, SI."""

    motor_inertia: float
    link_inertia: float
    stiffness: float
    damping: float


def held_joint(robot: Robot, joint: str, angles: FloatArray) -> ElasticJoint | None:
    """Inertias of motor and link, link side, with the spring of the gear; None where it has no such form.

    angles (n_u,): posture in which the other joints are held, their springs and those of undriven joints stiff.
    Without the form: a stiff joint, one in a loop, of coupled gears, or with a spring that is not linear.
    """
    names = [part.name for part in robot.joints]
    index = names.index(joint)
    spec = robot.joints[index]
    if spec.motor is None or not spec.is_flexible or index in robot.joints_in_loops:
        return None
    place = robot.driven_indices.index(index)
    coupled = np.abs(robot.mixing[place]) + np.abs(robot.mixing[:, place])
    if np.count_nonzero(coupled) > 1 or not (spec.spring is None or spec.spring.is_linear):
        return None
    springs = [(spec.spring, 1.0), (spec.motor.spring, robot.ratio(joint) ** 2)]
    compliance = sum(1 / (scale * spring.stiffness) for spring, scale in springs if spring is not None)
    # Of two springs in series the softer one damps.
    damping = min(scale * spring.damping for spring, scale in springs if spring is not None)
    model = formulate(robot)
    q = np.zeros(model.n_q)
    q[[model.index(f"joint {driven.name}") for driven in robot.driven]] = angles
    for driven, angle in zip(robot.driven, angles, strict=True):
        if driven in robot.flexible:
            q[model.index(f"motor {driven.name}")] = angle
    inertia = np.diag(np.asarray(model.mass(q, model.theta)))
    motor, link = (float(inertia[model.index(f"{part} {joint}")]) for part in ("motor", "joint"))
    return ElasticJoint(motor, link, 1 / compliance, damping)
