"""The robot's file with the numbers that a study has identified, for the next study or another reader."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from elastid.frf.friction.result import FrictionTakenOut
from elastid.report.friction_rows import friction_rows
from elastid.robot import Friction, Robot
from elastid.robot.friction_numbers import law_of, through_gear, with_laws
from elastid.study import Study
from elastid.study.robot_text import robot_text

if TYPE_CHECKING:
    from elastid.friction_fit.result import FrictionResult

MOTOR_SIDE = "Numbers of friction are on the side of the motor"


def robot_of_friction(study: Study, result: FrictionResult) -> str:
    """The study's robot with the law of friction of each joint and the ranges in which it was measured.

    What a study did not measure before sliding (bristles, elements) stays as the robot's file has it.
    """
    robot = study.as_robot()
    laws = {
        joint.joint: (_with_presliding(robot, joint.joint, joint.friction, joint.viscous), joint.viscous)
        for joint in result.joints
        if joint.friction is not None and joint.viscous is not None
    }
    comments = (
        f"Robot {robot.name} with the friction that study {study.name} has identified at the motors of joints "
        f"{', '.join(laws) or 'none'}.",
        f"{MOTOR_SIDE}; `measured` are the ranges outside which they are unknown.",
        "On the side of the link, with standard deviation and 95 % interval:",
        *(
            f"  {each.name} = {each.value:.9g} {each.unit}, std {each.std:.3g}, {each.low:.6g} to {each.high:.6g}"
            for each in result.numbers
        ),
    )
    return robot_text(with_laws(robot, laws), comments)


def robot_of_fit(name: str, robot: Robot, friction: FrictionTakenOut | None, known: tuple[str, ...]) -> str:
    """A fitted robot: its elastic numbers, motors, viscous friction, and F_c of motors that it was taken out of.

    known: lines on the intervals of its numbers.
    """
    laws: dict[str, tuple[Friction, float]] = {}
    motors = {f"motor {joint.name}": joint for joint in robot.driven}
    for row in () if friction is None else friction_rows(friction):
        joint = motors[row.place]
        if row.level is not None and row.level > 0 and joint.motor is not None:
            laws[joint.name] = (
                _with_level(robot, joint.name, row.level),
                joint.motor.viscous * joint.motor.ratio**2,
            )
    comments = [f"Robot {robot.name} with the numbers that study {name} has identified."]
    if laws:
        comments.append(f"{MOTOR_SIDE}; Coulomb friction of joints {', '.join(laws)} was found in the records.")
    return robot_text(with_laws(robot, laws), (*comments, *known))


def _with_presliding(robot: Robot, joint: str, law: Friction, viscous: float) -> Friction:
    """The law with the bristles or elements of the robot's file where it has none of its own and both agree."""
    known, ratio = law_of(robot, joint), robot.ratio(joint)
    if known is None or law.lugre is not None or law.maxwell_slip is not None:
        return law
    kept = replace(law, lugre=known.lugre, maxwell_slip=known.maxwell_slip)
    try:
        through_gear(kept, ratio, to_motor=True).check_passive(viscous / ratio**2)
    except ValueError:
        return law
    return kept


def _with_level(robot: Robot, joint: str, level: float) -> Friction:
    """The law of the robot's file with another Coulomb level, link side; the level alone where both contradict."""
    known = law_of(robot, joint)
    try:
        return Friction(level) if known is None else replace(known, coulomb=level)
    except ValueError:
        return Friction(level)
