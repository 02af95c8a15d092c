"""Channels of a log against what a study says of them: unit, quantity, sign, side and order, by kinematics and Newton.

Only what cannot be otherwise is doubted: relations of signals that agree to a few per cent, off by a known factor.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.units import TABLE, of_translation, units_of
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec, Places
from elastid.recorded.channel_names import Doubt, doubts_by_names
from elastid.recorded.evidence import (
    MotionRelation,
    TorqueRelation,
    motion_relations,
    nearest_factor,
    torque_relation,
    travel,
)
from elastid.recorded.link_side import link_side_factor, to_joints
from elastid.robot import Joint, Robot


@dataclass(frozen=True)
class DoubtLimits:
    """Limits of doubts about channels.  150 clean logs raise none (scripts/studies/results.csv)."""

    # Correlation of two motions that are one, and of one with the other as another quantity than stated.
    min_correlation: float = 0.98
    max_stated_correlation: float = 0.5
    # |log| of a gain that is as stated, and of its distance from a known factor.
    max_gain: float = 0.3
    max_factor: float = 0.1
    max_play: float = 1.0  # |log| of a gain of two positions of a joint, whose spring may lie between them
    # Share of the torque that a motion explains, that one which is not its own explains, and the gain by another.
    min_explained: float = 0.75
    max_stated: float = 0.5
    min_explained_gain: float = 0.3
    min_quantity_gain: float = 0.15
    # Inertia of a joint over that of its motor, link side, and |log| of its distance from it with another unit.
    max_inertia_ratio: float = 12.0
    max_inertia_factor: float = 1.0
    # Share of the torque that must be explained where a part of it decides, and what a part is at least.
    min_well_explained: float = 0.9
    min_part: float = 0.05
    # Parts of the torque by the inertia and by the damping of a motion that is one derivative further than stated.
    max_inertial: float = 0.03
    min_viscous: float = 0.9
    max_turns: float = 4.0  # that no joint behind a gear makes
    min_samples: int = 200


LIMITS = DoubtLimits()


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

    def relation(
        self, i: int, order: int | None = None, torque: int | None = None, turns: bool = True
    ) -> TorqueRelation:
        """The torque of the joint, or another one, by a motion, as the stated derivative or another one."""
        u = self.torque if torque is None else torque
        assert u is not None, "only joints with a torque are asked"
        k, turns = self.order(i) if order is None else order, turns and not self.joint.slides
        return torque_relation(self.signals[:, u], self.signals[:, i], k, self.rate_hz, turns)

    @property
    def motor_inertia(self) -> float:
        """That of the motor on the link side, which the joint's inertia exceeds."""
        return 0.0 if self.joint.motor is None else self.joint.motor.inertia * self.ratio**2

    def is_plausible(self, relation: TorqueRelation) -> bool:
        """True if inertia and friction are positive, and the inertia is not far from the motor's."""
        is_positive = relation.inertial > LIMITS.max_inertial and relation.dissipated > -LIMITS.max_inertial
        return is_positive and self.is_inertia(relation.inertia)

    def is_inertia(self, inertia: float) -> bool:
        """True if an inertia is not far from the motor's."""
        return self.motor_inertia / 3 < inertia < LIMITS.max_inertia_ratio * self.motor_inertia

    def unit_changes(self, i: int, quantity: str) -> dict[float, str]:
        """Factors of the inertia by the units of another quantity over that by the stated unit, each with its key."""
        stated, dimension = self.unit_size(i), self._dimension(quantity, self.channels[i])
        return {stated / TABLE[unit][1]: f", unit: {unit}" for unit in units_of(dimension)}

    def side_of_torque(self, motion: int) -> str:
        """The end of a doubt about the side of a motion at the motor, whose torque is on the same side as a rule."""
        if self.torque is None or self.channels[self.torque].side == "motor" or motion != self.driving:
            return ""
        return f"; as a rule the torque {self.channels[self.torque].name_in_file} has side: motor then, too"

    @cached_property
    def driving(self) -> int | None:
        """The motion at the motor, which its torque acts on; else that of the joint."""
        at_motor = [i for i in self.motions if self.channels[i].at.startswith("motor ")]
        return next(iter((*sorted(at_motor, key=self.order), *self.motions)), None)

    def unit_size(self, i: int) -> float:
        """The size in SI of the unit that is stated of a signal."""
        channel = self.channels[i]
        return TABLE[channel.unit or self._dimension(channel.quantity, channel)][1]

    def _dimension(self, quantity: str, channel: ChannelSpec) -> str:
        unit = QUANTITY_UNIT[quantity]
        return of_translation(unit) if self.joint.slides and channel.side == "link" else unit

    def factors(self, i: int) -> list[tuple[float, str]]:
        """Factors by which the signal is too large where its unit or side is another one, with the keys to give."""
        channel, stated = self.channels[i], self.unit_size(i)
        dimension = self._dimension(channel.quantity, channel)
        units = [(stated / TABLE[unit][1], f"unit: {unit}") for unit in units_of(dimension) if TABLE[unit][1] != stated]
        # A motor turns further than its joint, with less torque.
        ratio = abs(self.ratio) ** (1 if (channel.side == "link") == channel.is_motion else -1)
        side = "side: motor" if channel.side == "link" else "side: link"
        return [*units, (ratio, side)] if abs(np.log(ratio)) > LIMITS.max_gain else units


def channel_doubts(
    channels: Sequence[ChannelSpec], values: FloatArray, rate_hz: float, robot: Places
) -> Iterator[Doubt]:
    """Doubts about channels of one rate from the values (n, c) of a log, as they stand in the file."""
    constant = [i for i, x in enumerate(values.T) if not np.isfinite(x).any() or np.nanmax(x) == np.nanmin(x)]
    yield from _constants(constant, channels, values)
    yield from doubts_by_names(channels)
    if constant or len(values) < LIMITS.min_samples or not isinstance(robot, Robot):
        return
    joints = _joints(channels, values, rate_hz, robot)
    if too_far := [doubt for joint in joints for doubt in _travels(joint)]:
        yield from too_far
        return
    if of_motions := [doubt for joint in joints for doubt in _motions(joint, joints)]:
        yield from _rate(of_motions, rate_hz)
        return
    if of_order := list(_order(joints)):
        yield from of_order
        return
    for joint in joints:
        if joint.torque is not None and joint.driving is not None:
            yield from _torque(joint, joint.torque, joint.driving)


def _constants(constant: Sequence[int], channels: Sequence[ChannelSpec], values: FloatArray) -> Iterator[Doubt]:
    moving = {channels[i].role for i in set(range(len(channels))) - set(constant)}
    for i in constant:
        # An input may rest while others act; a temperature and a reference may be constant.
        if channels[i].role == "y" or (channels[i].role == "u" and "u" not in moving):
            known = values[np.isfinite(values[:, i]), i]
            state = f"is constant at {known[0]:g}" if known.size else "holds no finite number"
            yield Doubt(i, "channel", f"{channels[i].name_in_file} {state}; check its name and its sensor")


def _joints(
    channels: Sequence[ChannelSpec], values: FloatArray, rate_hz: float, robot: Robot
) -> tuple[JointSignals, ...]:
    known = [np.isfinite(x) for x in values.T]
    rows = np.arange(len(values))
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
    for i in joint.motions:
        if joint.order(i) != 0:
            continue
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


def _motions(joint: JointSignals, joints: Sequence[JointSignals]) -> Iterator[Doubt]:
    """Motions of one joint that contradict each other: quantity, sign, unit; or that follow another joint."""
    for a, b in combinations(sorted(joint.motions, key=joint.order), 2):
        relations = {r.order: r for r in motion_relations(joint.signals[:, a], joint.signals[:, b], joint.rate_hz)}
        stated = relations[joint.order(b) - joint.order(a)]
        best = max(relations.values(), key=lambda r: abs(r.correlation))
        if abs(best.correlation) > LIMITS.min_correlation:
            yield from _of_pair(joint, a, b, stated, best)
        elif abs(stated.correlation) < LIMITS.max_stated_correlation:
            yield from _of_another(joint, a, b, joints)


def _of_another(joint: JointSignals, a: int, b: int, joints: Sequence[JointSignals]) -> Iterator[Doubt]:
    """The one of two motions without a common course that the torque does not explain, if it is another joint's."""
    explained = [0.0 if joint.torque is None else joint.relation(i).explained for i in (a, b)]
    i = a if explained[0] < explained[1] else b
    for other in joints:
        for z in other.motions if other is not joint else ():
            x, y = sorted((i, z), key=joint.order)
            relations = motion_relations(joint.signals[:, x], joint.signals[:, y], joint.rate_hz)
            stated = next(r for r in relations if r.order == joint.order(y) - joint.order(x))
            is_one = stated.correlation > LIMITS.min_correlation and abs(np.log(stated.gain)) < LIMITS.max_gain
            if is_one:
                text = (
                    f"{joint.channels[i].name_in_file} moves as {joint.channels[z].name_in_file} of joint "
                    f"{other.joint.name} does (correlation {stated.correlation:.3f}); check the order of the channels"
                )
                yield Doubt(i, "at", text)
                return


def _of_pair(joint: JointSignals, a: int, b: int, stated: MotionRelation, best: MotionRelation) -> Iterator[Doubt]:
    gain = abs(stated.gain)
    first, second = (f"{joint.channels[i].quantity} {joint.channels[i].name_in_file}" for i in (a, b))
    if abs(stated.correlation) < LIMITS.max_stated_correlation and abs(best.correlation) > LIMITS.min_correlation:
        i, quantity = _misnamed(joint, a, b, best.order)
        text = (
            f"{second} is proportional to the derivative of order {best.order} of {first} (correlation "
            f"{best.correlation:.3f}); {joint.channels[i].name_in_file} seems to be quantity: {quantity}"
        )
        yield Doubt(i, "quantity", text)
    elif abs(stated.correlation) < LIMITS.min_correlation:  # a weak doubt
        return
    elif abs(np.log(gain)) > LIMITS.max_gain:
        factors = [(f, i, t) for i, sense in ((a, -1), (b, 1)) for f, t in ((x**sense, t) for x, t in joint.factors(i))]
        # Either may be at fault; the torque doubts one of them.
        odd = [i for i in (a, b) if joint.torque is not None and not joint.is_plausible(joint.relation(i))]
        for some in ([each for each in factors if each[1] in odd], factors):
            near = nearest_factor(gain, [(f, f"{i} {t}") for f, i, t in some], LIMITS.max_factor)
            if near:
                break
        text = f"{second} is {gain:.4g} times what {first} makes it"
        if near:
            number, _, keys = near.partition(" ")
            too = joint.side_of_torque(int(number)) if keys == "side: motor" else ""
            yield Doubt(int(number), keys.partition(":")[0], f"{text}: {keys} would make both agree{too}")
        elif stated.order == 0 and abs(np.log(gain)) > LIMITS.max_play:
            what = f"motor.ratio of joint {joint.joint.name} in the robot's file ({joint.ratio:g})"
            yield Doubt(b, "scale", f"{text}: check {what}, and unit and scale of both")
        elif stated.order > 0:
            yield Doubt(None, f"{gain ** (1 / stated.order):.6g}", text)
    elif stated.gain < 0:
        has_torque = joint.torque is not None
        i = next((i for i in (a, b) if has_torque and joint.relation(i).is_against_motion), b)
        text = f"{first} and {second} of joint {joint.joint.name} have opposite signs (correlation "
        yield Doubt(i, "sign", f"{text}{stated.correlation:.3f}); give one of them sign: -1")


def _misnamed(joint: JointSignals, a: int, b: int, order: int) -> tuple[int, str]:
    """The one of two motions whose quantity is another than stated, and that quantity."""
    as_a, as_b = joint.order(a) + order, joint.order(b) - order
    choices = [(i, k) for i, k in ((b, as_a), (a, as_b)) if 0 <= k < len(MOTIONS)]
    if joint.torque is not None:
        # With the right quantities the torque has an inertia.
        choices.sort(key=lambda choice: -joint.relation(*choice).inertial)
    i, k = choices[0] if choices else (b, joint.order(b))
    return i, MOTIONS[k]


def _rate(doubts: Sequence[Doubt], rate_hz: float) -> Iterator[Doubt]:
    """The doubts; those about no channel as one about the rate where all of them ask for one rate."""
    gains = [float(doubt.key) for doubt in doubts if doubt.channel is None]
    yield from (doubt for doubt in doubts if doubt.channel is not None)
    if gains and max(gains) < 1.05 * min(gains):
        text = next(doubt.text for doubt in doubts if doubt.channel is None)
        yield Doubt(None, "rate_hz", f"{text}: the log's rate seems to be {gains[0] * rate_hz:.4g} Hz")


def _order(joints: Sequence[JointSignals]) -> Iterator[Doubt]:
    """Torques that are explained by the motion of another joint, and encoders of links that follow another motor."""
    driven = [joint for joint in joints if joint.torque is not None and joint.driving is not None]
    explained = np.array(
        [[motion.relation(motion.driving or 0, torque=each.torque).explained for motion in driven] for each in driven]
    )
    for i, j in enumerate(explained.argmax(axis=1) if driven else ()):
        own, other = float(explained[i, i]), float(explained[i, j])
        # A joint at rest bears what the motion of another one, which explains its own torque, puts on it.
        is_taken = float(explained[j, j]) > other - LIMITS.min_explained_gain
        needed = max(LIMITS.min_explained, own + LIMITS.min_explained_gain)
        if i != j and not is_taken and own < LIMITS.max_stated and other > needed:
            channel, name = driven[i].torque, driven[j].joint.name
            assert channel is not None, "joints without torque are left out"
            of_motions = [joint.channels[joint.driving or 0].channel for joint in driven]
            of_torques = [joint.channels[joint.torque or 0].channel for joint in driven]
            place = driven[i].driving if _is_numbered(of_torques) and not _is_numbered(of_motions) else channel
            text = (
                f"{driven[i].channels[channel].name_in_file} is explained by the motion of joint {name} "
                f"({100 * other:.0f} %) rather than of joint {driven[i].joint.name} ({100 * own:.0f} %); check the "
                "order of the channels"
            )
            yield Doubt(place, "at", text)


def _is_numbered(names: Sequence[str]) -> bool:
    """True if the numbers in names rise."""
    numbers = [[int(number) for number in re.findall(r"\d+", name)] for name in names]
    return all(numbers) and numbers == sorted(numbers)


def _torque(joint: JointSignals, u: int, y: int) -> Iterator[Doubt]:
    """Sign, quantity and unit of the one motion, or of motions that agree, by the torque."""
    stated = joint.relation(y)
    torque, motion = (joint.channels[i].name_in_file for i in (u, y))
    is_against = stated.explained > LIMITS.min_explained and stated.is_against_motion
    needed = stated.explained - LIMITS.max_inertial if is_against else stated.explained + LIMITS.min_quantity_gain
    others = {k: joint.relation(y, k) for k in range(len(MOTIONS)) if k != joint.order(y)}
    k, best = max(others.items(), key=lambda item: (joint.is_plausible(item[1]), item[1].explained))
    # A negative inertia, or power that comes out of friction, gives way to what explains as much without it.
    is_impossible = min(stated.inertial, stated.dissipated) < -LIMITS.min_part
    if is_impossible and best.explained > LIMITS.min_well_explained:
        needed = stated.explained - LIMITS.max_inertial
    if joint.is_plausible(best) and best.explained > max(LIMITS.min_explained, needed):
        text = (
            f"as {MOTIONS[k]} {motion} explains {100 * best.explained:.0f} % of the torque {torque} by a positive "
            f"inertia, as {joint.channels[y].quantity} {100 * stated.explained:.0f} % by one of {stated.inertia:.3g}; "
            f"it seems to be quantity: {MOTIONS[k]}"
        )
        yield Doubt(y, "quantity", text)
    elif is_against:
        text = (
            f"torque {torque} and motion {motion} of joint {joint.joint.name} have opposite signs: inertia or friction "
            "would be negative; give one of them sign: -1"
        )
        yield Doubt(u if len(joint.motions) > 1 else y, "sign", text)
    else:
        yield from _inertia(joint, u, y, stated)


def _inertia(joint: JointSignals, u: int, y: int, stated: TorqueRelation) -> Iterator[Doubt]:
    """A unit that is left out, where the inertia is so far below the motor's; a damping that is an inertia."""
    least, channel = joint.motor_inertia, joint.channels[y]
    torque = f"the torque {joint.channels[u].name_in_file}"
    plain = joint.relation(y, turns=False)  # angles that are too large make gravity of inertia
    least_part = LIMITS.min_part if plain.explained > LIMITS.min_well_explained else LIMITS.min_explained
    if plain.inertial > least_part and 0 < plain.inertia < least / LIMITS.max_inertia_ratio:
        text = f"{torque} shows an inertia of {plain.inertia:.3g} at {channel.name_in_file}, the motor alone has "
        if joint.side_of_torque(y) and channel.side == "motor" and joint.is_inertia(plain.inertia * abs(joint.ratio)):
            yield Doubt(u, "side", f"{text}{least:.3g} (link side); side: motor would make both agree")
            return
        # The unit that is stated in particular is doubted first.
        for i, sense in sorted(((y, 1), (u, -1)), key=lambda each: each[0] == y or joint.unit_size(u) == 1):
            factors = [(factor**sense, key) for factor, key in joint.factors(i)]
            near = nearest_factor(least / plain.inertia, factors, LIMITS.max_inertia_factor)
            if near:
                yield Doubt(i, near.partition(":")[0], f"{text}{least:.3g} (link side); {near} would make both agree")
                break
    is_all = stated.viscous > LIMITS.min_viscous and abs(stated.inertial) < LIMITS.max_inertial
    if is_all and joint.order(y) < 2:
        quantity = MOTIONS[joint.order(y) + 1]
        units = {1.0: ""} if plain.inertial > -LIMITS.min_part else joint.unit_changes(y, quantity)
        fitting = [text for factor, text in units.items() if joint.is_inertia(stated.damping * factor)]
        if fitting:
            text = f"{torque} is proportional to the derivative of {channel.name_in_file}, by the inertia of the motor"
            yield Doubt(y, "quantity", f"{text}; it seems to be quantity: {quantity}{fitting[0]}")
