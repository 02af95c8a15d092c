"""The robot's file with the numbers that a study has identified, for the next study or another reader."""

from __future__ import annotations

from elastid.friction_fit.result import FrictionResult
from elastid.robot.friction_numbers import with_laws
from elastid.study import Study
from elastid.study.robot_text import robot_text


def robot_of_friction(study: Study, result: FrictionResult) -> str:
    """The study's robot with the law of friction of each joint, with the ranges in which it was measured."""
    laws = {
        joint.joint: (joint.friction, joint.viscous)
        for joint in result.joints
        if joint.friction is not None and joint.viscous is not None
    }
    comments = (
        f"Robot {study.as_robot().name} with the friction that study {study.name} has identified at the motors of "
        f"joints {', '.join(laws) or 'none'}.",
        "Numbers of friction are on the side of the motor; `measured` are the ranges outside which they are unknown.",
    )
    return robot_text(with_laws(study.as_robot(), laws), comments)
