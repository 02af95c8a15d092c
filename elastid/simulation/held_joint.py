"""One joint of a robot alone, the others held: its motor and its link on the spring between them."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.formulation import formulate
from elastid.robot import Robot
from elastid.simulation.elastic_joint import ElasticJoint


def held_joint(robot: Robot, joint: str, angles: FloatArray) -> ElasticJoint | None:
    """Inertias of motor and link, link side, with the spring of the gear; None where it has no such form.

    angles (n_u,): posture in which the other joints are held, their springs and those of undriven joints stiff.
    Without the form: a stiff joint, one in a loop, of coupled gears, or with a spring that is not linear.
    """
    names = [each.name for each in robot.joints]
    index = names.index(joint)
    spec = robot.joints[index]
    if spec.motor is None or not spec.is_flexible or index in robot.joints_in_loops:
        return None
    driven = robot.driven_indices.index(index)
    coupled = np.abs(robot.mixing[driven]) + np.abs(robot.mixing[:, driven])
    if np.count_nonzero(coupled) > 1 or not (spec.spring is None or spec.spring.is_linear):
        return None
    springs = [(spec.spring, 1.0), (spec.motor.spring, robot.ratio(joint) ** 2)]
    compliance = sum(1 / (scale * spring.stiffness) for spring, scale in springs if spring is not None)
    # Of two springs in series the softer one damps.
    damping = min(scale * spring.damping for spring, scale in springs if spring is not None)
    model = formulate(robot)
    q = np.zeros(model.n_q)
    q[[model.index(f"joint {each.name}") for each in robot.driven]] = angles
    q[[model.index(f"motor {each.name}") for each in robot.flexible]] = angles[_flexible(robot)]
    inertia = np.diag(np.asarray(model.mass(q, model.theta)))
    return ElasticJoint(
        float(inertia[model.index(f"motor {joint}")]), float(inertia[model.index(f"joint {joint}")]), 1 / compliance,
        damping,
    )  # fmt: skip


def _flexible(robot: Robot) -> list[int]:
    """The flexible joints among the driven ones."""
    return [i for i, each in enumerate(robot.driven) if each in robot.flexible]
