"""Channels of a log against what a study says of them: unit, quantity, sign, side and order.

By their names, by what a joint can travel, by kinematics of the motions of one joint, and by the sign of its power.
Only what cannot be otherwise is doubted: relations of signals that agree to a few per cent, off by a known factor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.units import TABLE, of_translation, units_of
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec, Places
from elastid.recorded.channel_guess import Doubt, doubts_by_names, guess_by_name
from elastid.recorded.evidence import (
    MIN_CORRELATION,
    motion_relations,
    torque_relation,
    travel,
)
from elastid.recorded.link_side import link_side_factor, to_joints, value_refusals
from elastid.robot import Joint, Robot


@dataclass(frozen=True)
class DoubtLimits:
    """Limits of doubts about channels.  150 clean logs raise none (scripts/studies/results.csv)."""

    max_stated_correlation: float = 0.5  # of one motion with another as the quantity that is stated
    # |log| of a gain that is as stated, and of its distance from a known factor.
    max_gain: float = 0.3
    max_factor: float = 0.1
    max_play: float = 1.0  # |log| of a gain of two positions of a joint, whose spring may lie between them
    max_turns: float = 4.0  # that no joint behind a gear makes
    min_samples: int = 200


LIMITS = DoubtLimits()
_UNUSUAL = ("arcmin", "arcsec", "mrad", "rev")  # that no log has, unless it says so


@dataclass(frozen=True)
class JointSignals:
    """Torque and motions of one joint in SI, link side, as a study reads them; places of channels in its list."""

    joint: Joint
    ratio: float
    rate_hz: float
    torque: int | None
    motions: tuple[int, ...]
    channels: Sequence[ChannelSpec]
    signals: FloatArray

    def order(self, i: int) -> int:
        """The derivative of the position that a motion is, as stated."""
        return MOTIONS.index(self.channels[i].quantity)

    def is_against(self, i: int) -> bool:
        """True if the torque of the joint and a motion of it have opposite signs."""
        if self.torque is None:
            return False
        u, y, turns = self.signals[:, self.torque], self.signals[:, i], not self.joint.slides
        return torque_relation(u, y, self.order(i), self.rate_hz, turns).is_against_motion

    def factors(self, i: int) -> list[tuple[float, str]]:
        """Factors by which the signal is too large where its unit or side is another one, with the keys to give."""
        channel, unit = self.channels[i], QUANTITY_UNIT[self.channels[i].quantity]
        dimension = of_translation(unit) if self.joint.slides and channel.side == "link" else unit
        stated = TABLE[channel.unit or dimension][1]
        is_named = channel.unit in TABLE and channel.unit == guess_by_name(channel.channel, channel.column).unit
        others = () if is_named else (unit for unit in units_of(dimension) if unit not in _UNUSUAL)
        units = [(stated / TABLE[unit][1], f"unit: {unit}") for unit in others if TABLE[unit][1] != stated]
        # A motor turns further than its joint, with less torque.
        ratio = abs(self.ratio) ** (1 if (channel.side == "link") == channel.is_motion else -1)
        side = "side: motor" if channel.side == "link" else "side: link"
        return [(ratio, side), *units] if abs(np.log(ratio)) > LIMITS.max_gain else units


def channel_doubts(
    channels: Sequence[ChannelSpec], values: FloatArray, rate_hz: float, robot: Places
) -> Iterator[Doubt]:
    """Doubts about channels of one rate from the values (n, c) of a log, as they stand in the file."""
    constant = dict(value_refusals(channels, list(values.T)))
    yield from (Doubt(i, "channel", f"{channels[i].name_in_file} {text}") for i, text in constant.items())
    by_names = list(doubts_by_names(channels))
    yield from by_names
    if by_names or constant or len(values) < LIMITS.min_samples or not isinstance(robot, Robot):
        return
    joints = _joints(channels, values, rate_hz, robot)
    too_far = [doubt for joint in joints for doubt in _travels(joint)]
    yield from too_far or _rate([doubt for joint in joints for doubt in _motions(joint)], rate_hz)


def _joints(
    channels: Sequence[ChannelSpec], values: FloatArray, rate_hz: float, robot: Robot
) -> tuple[JointSignals, ...]:
    known, rows = [np.isfinite(x) for x in values.T], np.arange(len(values))
    whole = [np.interp(rows, rows[k], x[k]) for x, k in zip(values.T, known, strict=True)]
    si = [x * link_side_factor(c, robot) for x, c in zip(whole, channels, strict=True)]
    signals = np.stack(si, axis=1) @ to_joints(channels, robot).T
    result = []
    for joint in robot.driven:
        places = (f"motor {joint.name}", f"joint {joint.name}")
        ours = [i for i, c in enumerate(channels) if c.at in places]
        torque = next((i for i in ours if channels[i].role == "u"), None)
        motions = tuple(i for i in ours if channels[i].role == "y")
        result.append(JointSignals(joint, robot.ratio(joint.name), rate_hz, torque, motions, channels, signals))
    return tuple(result)


def _travels(joint: JointSignals) -> Iterator[Doubt]:
    """Positions that no joint has: far beyond its limits, or so many turns behind a gear."""
    limits = joint.joint.limits.angle
    for i in [i for i in joint.motions if joint.order(i) == 0]:
        moved, most = travel(joint.signals[:, i]), limits[1] - limits[0]
        if not np.isfinite(most):
            most = np.inf if joint.joint.slides or abs(joint.ratio) < LIMITS.max_turns else 2 * np.pi * LIMITS.max_turns
        if moved > 1.2 * most:
            fitting = [text for factor, text in joint.factors(i) if factor > 1 and moved / factor < most]
            text = (
                f"joint {joint.joint.name} would travel {moved:.4g} {joint.joint.unit}, more than the {most:.4g} that "
                f"it can; its sensor seems to have {' or '.join(fitting) or 'another unit'}"
            )
            yield Doubt(i, "side" if fitting == ["side: motor"] else "unit", text)


def _motions(joint: JointSignals) -> Iterator[Doubt]:
    """Motions of one joint that contradict each other in quantity, sign or unit; else its torque and its motion."""
    found = False
    for a, b in combinations(sorted(joint.motions, key=joint.order), 2):
        relations = {r.order: r for r in motion_relations(joint.signals[:, a], joint.signals[:, b], joint.rate_hz)}
        stated = relations[joint.order(b) - joint.order(a)]
        best = max(relations.values(), key=lambda relation: abs(relation.correlation))
        first, second = (f"{joint.channels[i].quantity} {joint.channels[i].name_in_file}" for i in (a, b))
        found, gain = True, abs(stated.gain)
        if abs(stated.correlation) < LIMITS.max_stated_correlation and abs(best.correlation) > MIN_CORRELATION:
            order = joint.order(a) + best.order
            i, k = (b, order) if 0 <= order < len(MOTIONS) else (a, joint.order(b) - best.order)
            text = (
                f"{second} is proportional to the derivative of order {best.order} of {first} (correlation "
                f"{best.correlation:.3f}); {joint.channels[i].name_in_file} seems to be quantity: {MOTIONS[k % 3]}"
            )
            yield Doubt(i, "quantity", text)
        elif abs(stated.correlation) < MIN_CORRELATION:  # a weak doubt
            found = False
        elif abs(np.log(gain)) > LIMITS.max_gain:
            text = f"{second} is {gain:.4g} times what {first} makes it"
            yield from _of_gain(joint, a, b, gain, stated.order, text)
        elif stated.gain < 0:
            i = next((i for i in (a, b) if joint.is_against(i)), b)
            text = f"{first} and {second} of joint {joint.joint.name} have opposite signs (correlation "
            yield Doubt(i, "sign", f"{text}{stated.correlation:.3f}); give one of them sign: -1")
        elif joint.is_against(a):
            yield _against(joint, joint.torque, a)
    if not found and joint.motions and joint.is_against(joint.motions[0]):
        yield _against(joint, joint.motions[0], joint.motions[0])


def _against(joint: JointSignals, i: int | None, motion: int) -> Doubt:
    torque = joint.channels[joint.torque or 0].name_in_file
    text = f"torque {torque} and motion {joint.channels[motion].name_in_file} of joint {joint.joint.name} have opposite"
    return Doubt(i, "sign", f"{text} signs: inertia or friction would be negative; give one of them sign: -1")


def _of_gain(joint: JointSignals, a: int, b: int, gain: float, order: int, text: str) -> Iterator[Doubt]:
    """Another unit or side of one of two motions; another gear, or another rate."""
    factors = [(x**sense, i, keys) for i, sense in ((b, 1), (a, -1)) for x, keys in joint.factors(i)]
    fitting = [(i, keys) for x, i, keys in factors if abs(np.log(gain / x)) <= LIMITS.max_factor]
    for i, keys in sorted(fitting, key=lambda each: not each[1].startswith("side"))[:1]:
        yield Doubt(i, keys.partition(":")[0], f"{text}: {keys} would make both agree")
    if not fitting and order == 0 and abs(np.log(gain)) > LIMITS.max_play:
        what = f"motor.ratio of joint {joint.joint.name} in the robot's file ({joint.ratio:g})"
        yield Doubt(b, "scale", f"{text}: check {what}, and unit and scale of both")
    elif not fitting and order > 0:
        yield Doubt(None, f"{gain ** (1 / order):.6g}", text)


def _rate(doubts: Sequence[Doubt], rate_hz: float) -> Iterator[Doubt]:
    """The doubts; those about no channel as one about the rate where all of them ask for one rate."""
    gains = [float(doubt.key) for doubt in doubts if doubt.channel is None]
    yield from (doubt for doubt in doubts if doubt.channel is not None)
    if gains and max(gains) < 1.05 * min(gains):
        text = next(doubt.text for doubt in doubts if doubt.channel is None)
        yield Doubt(None, "rate_hz", f"{text}: the log's rate seems to be {gains[0] * rate_hz:.4g} Hz")
