"""Assignment of joints in logs to the driven joints of a robot, with units and sides of the gears."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.units import dimension_and_size, translation_unit
from elastid.experiment.specs.channels import QUANTITY_UNIT, ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.channel_guess import JointGuess, LogGuess
from elastid.logs.channel_names import ChannelGuess, ChannelKey, guess_by_name
from elastid.logs.clocks import MAX_SAMPLES
from elastid.logs.files.formats import open_log
from elastid.logs.units_and_sides import without_placeholders
from elastid.robot import Joint, Robot

MIN_TURN = 0.05  # rad, least difference of joint angles between logs of different configurations
# Minimum, maximum, mean and standard deviation (n, 4) of a position in n logs, in units of the file, by channel.
Positions: TypeAlias = Mapping[ChannelKey, FloatArray]


def assign_joints(robot: Robot, guess: LogGuess, positions: Positions) -> LogGuess:
    """Sort the joints of a guess in the order of the driven joints of the robot (`order_of_names`).

    If the names state no units or sides of the gears, use the first interpretation within all limits of the robot.
    """
    names, joints = robot.driven_names, guess.joints
    order, why = order_of_names(names, [joint.torque for joint in joints])
    motions = [replace(joints[i].motion, why=joints[i].motion.why + why) for i in order]
    pairs = zip(robot.driven, order, motions, strict=True)
    ordered = tuple(replace(joints[i], motion=at_joint(joint, motion)) for joint, i, motion in pairs)
    interpretations = [_interpret(robot, ordered, unit, on_motor) for on_motor in (False, True) for unit in ("", "deg")]
    is_in_limits = partial(_is_in_limits, positions)
    within_limits = [joints for joints in interpretations if all(map(is_in_limits, robot.driven, joints))]
    return replace(guess, joints=(within_limits or interpretations)[0])


def order_of_names(joints: Sequence[str], channels: Sequence[ChannelGuess]) -> tuple[list[int], str]:
    """Return the channel index of each joint: by words and numbers in the names, else by number, else in log order.

    Also return a text that states the order if the names do not confirm it.  Raises DataError if the words do not
    match, or if without words the numbers of channels and joints differ.
    """
    patterns = [rf"(?<![a-z0-9]){re.escape(name.lower())}(?![a-z0-9])" for name in joints]
    by_name = [[i for i, guess in enumerate(channels) if re.search(word, guess.name.lower())] for word in patterns]
    labels, joint_labels = _labels(channels), _labels([guess_by_name(name, None) for name in joints])
    by_label = [[i for i, label in enumerate(labels) if label == joint_label] for joint_label in joint_labels]
    for order in (by_name, by_label):
        if all(len(match) == 1 for match in order) and len({i for (i,) in order}) == len(joints):
            return [i for (i,) in order], ""
    has_letters = [any(not word.isdigit() for label in side for word in label) for side in (labels, joint_labels)]
    numbers = [[int(word) for word in label if word.isdigit()] for label in labels]
    is_ambiguous = all(numbers) and len({*map(tuple, numbers)}) < len(numbers)
    if all(has_letters) or is_ambiguous or len(channels) != len(joints):
        columns = ", ".join(guess.name for guess in channels)
        text = f"{columns} do not identify joints {', '.join(joints)}. Log all joints, in columns with their names"
        raise DataError("records/channels", text)
    indices = sorted(range(len(channels)), key=numbers.__getitem__) if all(numbers) else [*range(len(channels))]
    return indices, f"; joint by the order of the {'numbers' if all(numbers) else 'log'}" * any(has_letters)


def _labels(guesses: Sequence[ChannelGuess]) -> list[list[str]]:
    """Return the sorted words and then the numbers of each name, without common words and common leading numbers."""
    labels = [replace(guess, by_words=True).joint_label.lower().split() for guess in guesses]
    common, numbers = set.intersection(*map(set, labels)), [[*filter(str.isdigit, label)] for label in labels]
    differ = (i for i, column in enumerate(zip(*numbers, strict=False)) if len(set(column)) > 1)
    n_common = next(differ, min(map(len, numbers)))
    texts = (sorted(word for word in label if not (word.isdigit() or word in common)) for label in labels)
    return [[*text, *row[n_common:]] for text, row in zip(texts, numbers, strict=True)]


def at_joint(joint: Joint, motion: ChannelGuess) -> ChannelGuess:
    """Return a motion channel with the unit of its joint, a unit of length if the joint slides."""
    unit, why = motion.unit, motion.why
    if joint.slides and dimension_and_size(unit)[0].startswith("rad"):
        unit = translation_unit(dimension_and_size(unit)[0])
        why = f"{why.removesuffix('; rad is assumed')}; {unit}, since the joint slides"
    elif not joint.slides and "assumed" in why:
        unit = QUANTITY_UNIT[motion.quantity]
    return replace(motion, unit=unit, why=why)


def _interpret(robot: Robot, joints: Sequence[JointGuess], unit: str, on_motor: bool) -> tuple[JointGuess, ...]:
    """Interpret all joints with one unit for positions without a unit, and all signals on one side of the gears.

    Torques are motor-side if a torque, taken as link-side, is too small for the inertia of its rotor.
    """
    result, is_motor_side = [], on_motor
    for joint, guess in zip(robot.driven, joints, strict=True):
        motion, ratio = guess.motion, 1.0 if joint.slides else robot.ratio(joint.name)
        if unit and motion.quantity == "position" and not joint.slides and "assumed" in motion.why:
            or_motor = "" if on_motor or ratio == 1 else " or rad with side: motor"
            motion = replace(motion, unit=unit, why=f"deg{or_motor}: link-side rad exceed the limits of the robot")
        if on_motor and ratio != 1:
            motion = replace(motion, ratio=ratio, why=f"{motion.why}; motor-side: link-side values exceed the limits")
        is_motor_side |= guess.relation.is_before_gear(joint, ratio, motion.to_si / guess.motion.to_si)
        torque = replace(guess.torque, ratio=ratio, why=guess.torque.why + "; before the gear" * (ratio != 1))
        result.append((guess.torque, replace(guess, torque=torque, motion=motion)))
    return tuple(g if is_motor_side or g.torque.quantity == "current" else replace(g, torque=t) for t, g in result)


def _is_in_limits(positions: Positions, joint: Joint, guess: JointGuess) -> bool:
    """Return True if the motion is within the limits of its joint, with a tolerance of `MIN_TURN`."""
    extent = guess.motion.to_si * positions.get(guess.motion.key, np.zeros((1, 4)))[:, :2]
    low, high = joint.limits.angle
    return bool(np.min(extent) > low - MIN_TURN and np.max(extent) < high + MIN_TURN)


def positions_of(logs: Sequence[Sequence[Path]], form: TextFormatSpec, motions: Sequence[ChannelGuess]) -> Positions:
    """Return `Positions` of each position signal in n measurements."""
    positions = [motion for motion in motions if motion.quantity == "position"]
    moments = np.zeros((len(logs), 4, len(positions)))
    for i, paths in enumerate(logs):
        for number, path in enumerate(paths, start=1):
            indices = [k for k, motion in enumerate(positions) if motion.file == number]
            ys = [ChannelSpec("y", "any", positions[k].name, positions[k].column, quantity="position") for k in indices]
            if ys:
                with open_log(path, form) as log:
                    x = without_placeholders(log.values(ys, slice(0, MAX_SAMPLES)))
                moments[i][:, indices] = [moment(x, axis=0) for moment in (np.nanmin, np.nanmax, np.nanmean, np.nanstd)]
    return {motion.key: moments[:, :, i] for i, motion in enumerate(positions)}
