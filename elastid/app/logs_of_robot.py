"""The joints of a robot that the torques and motions of logs belong to: by their names, else by their order."""

from __future__ import annotations

import re
from dataclasses import replace

from elastid.base.errors import DataError
from elastid.base.units import TABLE, of_translation
from elastid.recorded.channel_guess import JointGuess, LogGuess
from elastid.robot import Joint, Robot


def in_order_of(robot: Robot, guess: LogGuess) -> LogGuess:
    """The guess with its joints in the order of the robot's driven ones; DataError where they are not as many."""
    names, joints = [joint.name for joint in robot.driven], guess.joints
    if len(joints) != len(names):
        raise DataError(
            f"the logs have torque and motion of {len(joints)} joint{'s' if len(joints) != 1 else ''} "
            f"({', '.join(joint.torque.name for joint in joints)}), and robot {robot.name} drives {len(names)} "
            f"({', '.join(names)}); log all of them, or drive in the robot's file those that were logged"
        )
    named = [[joint for joint in joints if _is_of(name, joint)] for name in names]
    by_name = all(len(found) == 1 for found in named) and len({found[0].torque.name for found in named}) == len(names)
    ordered = [found[0] for found in named] if by_name else joints
    why = "name" if by_name else "place in the robot's file"
    return replace(guess, joints=tuple(_at(*pair, why) for pair in zip(robot.driven, ordered, strict=True)))


def _is_of(name: str, joint: JointGuess) -> bool:
    """True if the channel of its torque has the name of a joint in it, as a word."""
    return re.search(rf"(?<![A-Za-z0-9]){re.escape(name)}(?![A-Za-z0-9])", joint.torque.name, re.IGNORECASE) is not None


def _at(joint: Joint, guess: JointGuess, why: str) -> JointGuess:
    """The guess at a joint of the robot, in units of a translation where that slides."""
    torque, motion = (
        replace(each, why=f"{each.why}; of {joint.name} by its {why}") for each in (guess.torque, guess.motion)
    )
    if joint.slides and torque.quantity == "torque":
        torque = replace(torque, quantity="force", unit="N")
    if joint.slides and TABLE[motion.unit][0].startswith("rad"):
        motion = replace(motion, unit=of_translation(TABLE[motion.unit][0]))
    return replace(guess, torque=torque, motion=motion)
