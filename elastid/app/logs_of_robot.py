"""Logs of a robot or a structure: the joints that they belong to, and the states in which they were measured."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.base.units import TABLE, of_translation
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.frf.hits import Pulses
from elastid.recorded.channel_guess import JointGuess, LogGuess
from elastid.recorded.files.formats import opened_log, values_of
from elastid.recorded.pieces import SAME_EXCITATION
from elastid.recorded.repair.clock import delay
from elastid.robot import Joint, Robot


def in_order_of(robot: Robot, guess: LogGuess) -> LogGuess:
    """The guess with its joints in the order of the robot's driven ones; DataError where they are not as many."""
    names, joints = [joint.name for joint in robot.driven], guess.joints
    if len(joints) != len(names):
        raise DataError(
            "records/channels",
            f"the logs have torque and motion of {len(joints)} joint{'s' if len(joints) != 1 else ''} "
            f"({', '.join(joint.torque.name for joint in joints)}), and robot {robot.name} drives {len(names)} "
            f"({', '.join(names)}); log all of them, or drive in the robot's file those that were logged",
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


MAX_SAMPLES = 1 << 18  # that are read of each
ONE_STATE = "all logs are of one state of the structure"
_SAME = math.sqrt(1 - SAME_EXCITATION.max_unexplained_share)  # correlation of the drives of two logs of one excitation
_MIN_TURN = 0.05  # rad, between the joints of two logs that are of two states
_MIN_FORCE = 0.1  # of the largest of a hammer's lines, on which responses are compared
_MAX_UNLIKE = 0.05  # of responses of one point: hits that differ by a tenth in each response have half a hundredth


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
    """The state of the structure in each log, and why: by the angles of its joints, and by the responses to hits."""
    drives = [ChannelSpec("u", "any", j.torque.name, j.torque.column) for j in guess.joints]
    motions = [*(j.motion for j in guess.joints), *guess.further]
    ys = [ChannelSpec("y", "any", m.name, m.column, quantity="position") for m in motions]
    turn = np.array([TABLE[m.unit][1] if TABLE[m.unit][0] == "rad" else 0.0 for m in motions])
    seen, states, why = list[tuple[FloatArray, ComplexArray | None]](), list[int](), ONE_STATE
    for path in logs:
        with opened_log(path, form) as log:
            x = np.nan_to_num(values_of(log, [*drives, *ys], 0, MAX_SAMPLES))
        u, y = x[:, 0], x[:, len(drives) :]
        angle, G = y.mean(axis=0) * turn, None
        if len(drives) == 1 and Pulses.of(u) is not None:
            F = np.fft.rfft(u - np.median(u), MAX_SAMPLES)
            F[np.abs(F) < _MIN_FORCE * np.abs(F).max()] = np.inf
            G = np.fft.rfft(y - np.median(y, axis=0), MAX_SAMPLES, axis=0) / F[:, None]
        reach = max(_MIN_TURN, 5 * float((y.std(axis=0) * turn).max(initial=0.0)))
        state = len(seen)
        for k, (other, H) in enumerate(seen):
            is_there = np.abs(angle - other).max(initial=0.0) < reach
            if is_there and (G is None or H is None or _unlike(G, H) < _MAX_UNLIKE):
                state = k
                break
            why = "hits at other points, by their responses" if is_there else "the joints stand at other angles"
        seen += [(angle, G)] if state == len(seen) else []
        states.append(state)
    return states, why if len(seen) > 1 else ONE_STATE


def _unlike(G: ComplexArray, H: ComplexArray) -> float:
    """Power of the difference of two responses (F, n) over the sum of theirs, on the lines that both have."""
    both = (G != 0).any(axis=1) & (H != 0).any(axis=1)
    G, H = G[both], H[both]
    return float(np.sum(np.abs(G - H) ** 2) / max(np.sum(np.abs(G) ** 2 + np.abs(H) ** 2), 1e-300))


def angles_of(path: Path, form: TextFormatSpec, guess: LogGuess) -> FloatArray:
    """Mean positions (n_u,) of the joints in the first file of a log, in SI; 0 of those without one there."""
    motions = [joint.motion for joint in guess.joints]
    known = [i for i, motion in enumerate(motions) if motion.quantity == "position" and motion.file == 1]
    ys = [ChannelSpec("y", "any", motions[i].name, motions[i].column, quantity="position") for i in known]
    angles = np.zeros(len(motions))
    with opened_log(path, form) as log:
        means = np.nanmean(values_of(log, ys, 0, MAX_SAMPLES), axis=0) if ys else []
    for i, mean in zip(known, means, strict=True):
        angles[i] = motions[i].sign * motions[i].scale * TABLE[motions[i].unit][1] * mean
    return angles
