"""Logs of a robot or a structure: the joints that they belong to, and the states in which they were measured."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.units import TABLE, of_translation
from elastid.experiment.specs.channels import QUANTITY_UNIT, ChannelSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.channel_guess import ChannelGuess, JointGuess, LogGuess
from elastid.recorded.files.formats import opened_log, values_of
from elastid.recorded.repair.time_stamps import delay
from elastid.robot import Joint, Robot

MAX_SAMPLES = 1 << 18  # that are read of each
_SAME = math.sqrt(0.9)  # correlation of the drives of two logs of one excitation
_MIN_TURN = 0.05  # rad, between the joints of two logs that are of two states
_YASKAWA = "slurbt"  # names of the axes of its robots, in order


def in_order_of(robot: Robot, guess: LogGuess, values: Mapping[tuple[str, int | None], FloatArray]) -> LogGuess:
    """The guess with its joints in the order of the robot's driven ones; DataError where they are not as many.

    values: signals (n,) of the log by name and column.
    """
    names, joints = [joint.name for joint in robot.driven], guess.joints
    if len(joints) != len(names):
        raise DataError(
            "records/channels",
            f"the logs have torque and motion of {len(joints)} joint{'s' if len(joints) != 1 else ''} "
            f"({', '.join(joint.torque.name for joint in joints)}), and robot {robot.name} drives {len(names)} "
            f"({', '.join(names)}); log all of them, or drive in the robot's file those that were logged",
        )
    by_name = {name: joint for name in names for joint in joints if _is_of(name, joint)}
    labels = [joint.torque.parts[1].lower() for joint in joints]
    is_number = all(re.fullmatch(r"[\d ]+", label) for label in labels)
    order = {label: [*map(int, label.split())] if is_number else [_YASKAWA.find(label)] for label in labels}
    if len({joint.torque.key for joint in by_name.values()}) == len(names):
        ordered, why = [by_name[name] for name in names], "name"
    elif len(order) == len(names) and [-1] not in order.values():
        ordered, why = [joints[i] for i in sorted(range(len(names)), key=lambda i: order[labels[i]])], "number"
    else:
        ordered, why = list(joints), "place in the robot's file"
    at = [_at(*pair, why, values) for pair in zip(robot.driven, ordered, strict=True)]
    if any(joint.motion.unit == "deg" for joint in at):  # one unit for all
        is_open = [joint.motion.unit == "rad" and "assumed" in joint.motion.why for joint in at]
        at = [replace(j, motion=replace(j.motion, unit="deg")) if o else j for j, o in zip(at, is_open, strict=True)]
    return replace(guess, joints=tuple(at))


def _is_of(name: str, joint: JointGuess) -> bool:
    """True if the channel of its torque has the name of a joint in it, as a word."""
    return re.search(rf"(?<![A-Za-z0-9]){re.escape(name)}(?![A-Za-z0-9])", joint.torque.name, re.IGNORECASE) is not None


def _at(joint: Joint, guess: JointGuess, why: str, values: Mapping[tuple[str, int | None], FloatArray]) -> JointGuess:
    """The guess at a joint of the robot, in units of a translation where that slides, in deg where rad leave limits."""
    torque, motion = (
        replace(each, why=f"{each.why}; of {joint.name} by its {why}") for each in (guess.torque, guess.motion)
    )
    if joint.slides and torque.quantity == "torque":
        torque = replace(torque, quantity="force", unit="N")
    if joint.slides and TABLE[motion.unit][0].startswith("rad"):
        motion = replace(motion, unit=of_translation(TABLE[motion.unit][0]))
    elif not joint.slides and "assumed" in motion.why:
        motion = replace(motion, unit=QUANTITY_UNIT[motion.quantity])
    if not joint.slides and motion.quantity == "position" and "assumed" in motion.why:
        x, (low, high) = values[motion.key], joint.limits.angle
        if np.min(x) < low - _MIN_TURN or np.max(x) > high + _MIN_TURN:
            motion = replace(motion, unit="deg", why=f"deg, since rad leave the limits of {joint.name}")
    return replace(guess, torque=torque, motion=motion)


def realisations_of(
    logs: Sequence[Path], form: TextFormatSpec, joints: Sequence[JointGuess], period: str
) -> tuple[int, ...]:
    """The realisation of each log, by what its drives repeat: the same number for further periods of one excitation."""
    stated = re.match(r" *period_samples: (\d+) ", period)
    if stated is None:
        return tuple(range(len(logs)))
    N, known, result = int(stated[1]), list[FloatArray](), list[int]()
    drives = [ChannelSpec("u", "any", joint.torque.name, joint.torque.column) for joint in joints]
    for path in logs:
        with opened_log(path, form) as log:
            u = values_of(log, drives, 0, MAX_SAMPLES)
        if len(u) < N or not np.isfinite(u).all():
            return tuple(range(len(logs)))
        one = (u[len(u) % N :].reshape(-1, N, len(drives))).mean(axis=0)
        alike = [_is_one_excitation(other, one) for other in known]
        result.append(alike.index(True) if True in alike else len(known))
        if True not in alike:
            known.append(one)
    return tuple(result)


def _is_one_excitation(first: FloatArray, second: FloatArray) -> bool:
    """True if all drives of two periods (N, d) are alike after one delay; an odd multisine is its opposite, later."""
    lag = max((delay(a, b, len(a)) for a, b in zip(first.T, second.T, strict=True)), key=lambda pair: pair[1])[0]
    X, Y = (np.fft.rfft(x, axis=0)[1:] for x in (first, second))
    turned = Y * np.exp(2j * np.pi * np.arange(1, len(Y) + 1) * lag / len(first))[:, None]
    power = np.sum(np.abs(X) ** 2, axis=0) * np.sum(np.abs(Y) ** 2, axis=0)
    return bool(np.all(np.sum((X.conj() * turned).real, axis=0) >= _SAME * np.sqrt(power)))


def states_of(logs: Sequence[Path], form: TextFormatSpec, guess: LogGuess) -> tuple[list[int], str]:
    """The state of the structure in each log, by the angles of its joints, and why."""
    motions = [*(j.motion for j in guess.joints), *guess.further]
    seen, states = list[FloatArray](), list[int]()
    for path in logs:
        mean, scatter = angles_of(path, form, motions)
        there = [k for k, other in enumerate(seen) if np.all(np.abs(mean - other) < max(_MIN_TURN, 5 * scatter))]
        states.append(there[0] if there else len(seen))
        seen += [] if there else [mean]
    return states, "the joints stand at other angles" if len(seen) > 1 else "all logs are of one state of the structure"


def angles_of(path: Path, form: TextFormatSpec, motions: Sequence[ChannelGuess]) -> tuple[FloatArray, float]:
    """Mean positions (n,) in a log, in SI, 0 of motions without one; their largest std."""
    known = [i for i, motion in enumerate(motions) if motion.quantity == "position"]
    ys = [ChannelSpec("y", "any", motions[i].name, motions[i].column, quantity="position") for i in known]
    mean, scatter = np.zeros(len(motions)), 0.0
    with opened_log(path, form) as log:
        signals = values_of(log, ys, 0, MAX_SAMPLES).T if ys else np.zeros((0, 1))
    for i, x in zip(known, signals, strict=True):
        si = motions[i].sign * motions[i].scale * TABLE[motions[i].unit][1] * x
        mean[i], scatter = np.nanmean(si), max(scatter, float(np.nanstd(si)))
    return mean, scatter
