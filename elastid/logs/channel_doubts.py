"""Channels of a study that contradict their names, or each other as the motions and the torque of one joint.

Only certain contradictions are reported: a relation that holds to a few per cent, but with a known wrong factor.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.units import dimension_and_size, table_unit, translation_unit, units_of
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec, Places
from elastid.logs.channel_names import DRIVES, guess_by_name
from elastid.logs.headings import in_brackets
from elastid.logs.motion_relations import (
    MAX_LN_LOSS,
    MIN_CORRELATION,
    MIN_GAIN_OVER_STD,
    TorqueRelation,
    motion_relations,
    range_without_spikes,
    sensor_gain,
    torque_relation,
)
from elastid.logs.repair import interpolate_linearly
from elastid.logs.repair.clock_drift import MIN_DELAY_CORRELATION
from elastid.logs.units_and_sides import find_value_errors, link_side_factor, to_joints
from elastid.robot import Joint, Robot


@dataclass(frozen=True)
class ChannelDoubt:
    """A doubt about a channel.  channel: index in the study's list, None for the rate of all.  key: setting at fault.

    is_weak: from the torque of a joint while other joints moved; a second log must confirm it.
    """

    channel: int | None
    key: str
    text: str
    is_weak: bool = False


def doubts_by_names(channels: Sequence[ChannelSpec]) -> Iterator[ChannelDoubt]:
    """Find contradictions of names: one signal in two roles, exchanged torques and motions or joints, odd units."""
    guesses = [guess_by_name(c.channel, c.column) for c in channels]
    torques = [g.name for g, c in zip(guesses, channels, strict=True) if c.role == "y" and g.quantity in DRIVES]
    families: dict[tuple[str, str, str], list[int]] = {}
    for i, (channel, guess) in enumerate(zip(channels, guesses, strict=True)):
        for earlier in channels[:i]:
            keys = [(c.channel, c.column, c.file) for c in (channel, earlier)]
            if keys[0] == keys[1] and "t" not in (channel.role, earlier.role):
                text = f"{channel.name_in_file} is the {earlier.quantity} at {earlier.at} (role {earlier.role}), and"
                text += f" cannot be the {channel.quantity} at {channel.at} (role {channel.role}), too"
                yield ChannelDoubt(i, "channel" if channel.channel else "column", text)
        names = [n for n in (guess.name, *torques) if re.search(r"[a-z]{2}", n, re.IGNORECASE)]
        if channel.role == "u" and guess.quantity in MOTIONS and names[:1] == [guess.name] and names[1:]:
            text = f"{guess.name} is a {guess.quantity} by its name, and {names[1]}, stated as a motion, a torque"
            yield ChannelDoubt(i, "channel", f"{text}: exchange them")
        unit = channel.unit or QUANTITY_UNIT[channel.quantity]
        is_same_kind = (guess.quantity in MOTIONS and channel.role == "y") or guess.quantity == channel.quantity
        has_other_unit = dimension_and_size(unit) != dimension_and_size(guess.unit or unit) and guess.scale == 1
        if in_brackets(channel.channel) and channel.scale == 1 and is_same_kind and has_other_unit:
            key = "unit" if guess.quantity == channel.quantity else "quantity"
            text = f"the heading {guess.name} says {guess.quantity} in {guess.unit}"
            yield ChannelDoubt(
                i, key, f"{text}, and not {channel.quantity} in {unit}. Correct the heading or the channel"
            )
        if re.search(r"\d", channel.channel) and not re.fullmatch(r"column \d+", channel.channel):
            families.setdefault((guess.family, channel.quantity, channel.role), []).append(i)
    for family in families.values():
        yield from _family_doubts(family, [guesses[i].joint_label for i in family], channels)


def _family_doubts(
    family: Sequence[int], labels: Sequence[str], channels: Sequence[ChannelSpec]
) -> Iterator[ChannelDoubt]:
    """Yield warnings on signals whose names differ by a number: one with a different unit, two exchanged ones."""
    units = [channels[i].unit or QUANTITY_UNIT[channels[i].quantity] for i in family]
    sizes = [dimension_and_size(unit) for unit in units]
    majority, count = Counter(sizes).most_common(1)[0]
    first = sizes.index(majority)
    digits = [re.sub(r"\D", "", channels[i].at) for i in family]
    are_numbered = sorted(digits) == sorted(labels) and len({*digits}) == len(digits)
    for i, unit, size, label, number in zip(family, units, sizes, labels, digits, strict=True):
        name = channels[i].name_in_file
        if size != majority and size[0] == majority[0] and count == len(family) - 1 > 1:
            text = f"{name} has unit {unit}, {channels[family[first]].name_in_file} and the others {units[first]}"
            yield ChannelDoubt(i, "unit", text + ". Use one unit for all joints of a log")
        if are_numbered and label != number:
            text = f"{name} has number {label} in its name and is assigned to {channels[i].at}"
            yield ChannelDoubt(i, "at", f"{text}. Check the order of the channels")


# Limits of warnings about channels. 150 clean logs cause none (scripts/studies/results.csv).
# Largest |log| of the ratio of a gain to its stated value, and to a known factor.
MAX_LN_GAIN, MAX_LN_FACTOR = 0.3, 0.1
MAX_LN_SPRING_GAIN = 1.0  # |log| of a gain of two positions of a joint, whose spring may lie between them
MAX_TURNS = 4.0  # that no joint behind a gear makes
MIN_SAMPLES = 200
_UNUSUAL_UNITS = ("arcmin", "arcsec", "mrad", "rev", "rev/s")  # that no log has, unless it says so


@dataclass(frozen=True)
class JointSignals:
    """Torque and motions of one joint in SI, link side, as a study reads them; places of channels in its list."""

    joint: Joint
    ratio: float
    rate_hz: float
    torque: int | None
    sensor: int | None
    motions: tuple[int, ...]
    channels: Sequence[ChannelSpec]
    signals: FloatArray

    def order(self, i: int) -> int:
        """Return the derivative of the position that a motion is, as stated."""
        return MOTIONS.index(self.channels[i].quantity)

    def describe(self, i: int) -> str:
        """Return quantity and name of a motion."""
        return f"{self.channels[i].quantity} {self.channels[i].name_in_file}"

    def factors(self, i: int) -> list[tuple[float, str]]:
        """Return factors by which the signal is too large for other units or sides, with the keys to give."""
        channel, unit = self.channels[i], QUANTITY_UNIT[self.channels[i].quantity]
        dimension = translation_unit(unit) if self.joint.slides and channel.side == "link" else unit
        size = dimension_and_size(channel.unit or dimension)[1]
        is_clear = channel.unit and table_unit(channel.unit) == guess_by_name(channel.channel, channel.column).unit
        other_units = () if is_clear else (unit for unit in units_of(dimension) if unit not in _UNUSUAL_UNITS)
        factors = [(size / dimension_and_size(unit)[1], f"unit: {unit}") for unit in other_units]
        units = [pair for pair in factors if pair[0] != 1]
        # A motor turns further than its joint, with less torque.
        ratio = abs(self.ratio) ** (1 if (channel.side == "link") == channel.is_motion else -1)
        side = "side: motor" if channel.side == "link" else "side: link"
        return [(ratio, side), *units] if abs(np.log(ratio)) > MAX_LN_GAIN else units


def channel_doubts(
    channels: Sequence[ChannelSpec], values: FloatArray, rate_hz: float, robot: Places
) -> Iterator[ChannelDoubt]:
    """Yield warnings about channels of one rate from the raw values (n, c) of a log."""
    constant = dict(find_value_errors(channels, list(values.T)))
    yield from (ChannelDoubt(i, "channel", f"{channels[i].name_in_file} {text}") for i, text in constant.items())
    name_doubts = list(doubts_by_names(channels))
    yield from name_doubts
    if name_doubts or constant or len(values) < MIN_SAMPLES or not isinstance(robot, Robot):
        return
    si = [interpolate_linearly(x) * link_side_factor(c, robot) for x, c in zip(values.T, channels, strict=True)]
    signals, joints = np.stack(si, axis=1) @ to_joints(channels, robot).T, []
    for joint in robot.driven:
        indices = [i for i, c in enumerate(channels) if c.at in (f"motor {joint.name}", f"joint {joint.name}")]
        torque, sensor = (next((i for i in indices if channels[i].role == role), None) for role in ("u", "d"))
        motions = tuple(i for i in indices if channels[i].role == "y")
        joints.append(JointSignals(joint, robot.ratio(joint.name), rate_hz, torque, sensor, motions, channels, signals))
    doubts = [doubt for joint in joints for doubt in _travel_doubts(joint)]
    doubts = doubts or [doubt for joint in joints for doubt in _motion_doubts(joint)]
    yield from doubts or (doubt for joint in joints for doubt in _sensor_doubts(joint))


def _travel_doubts(joint: JointSignals) -> Iterator[ChannelDoubt]:
    """Yield positions that no joint has: far beyond its limits, or so many turns behind a gear."""
    limits = joint.joint.limits.angle
    for i in [i for i in joint.motions if joint.order(i) == 0]:
        extent, limit = range_without_spikes(joint.signals[:, i]), limits[1] - limits[0]
        if not np.isfinite(limit):
            limit = np.inf if joint.joint.slides or abs(joint.ratio) < MAX_TURNS else 2 * np.pi * MAX_TURNS
        if extent > 1.2 * limit:
            candidates = [keys for factor, keys in joint.factors(i) if factor > 1 and extent / factor < limit]
            text = f"joint {joint.joint.name} would move over {extent:.4g} {joint.joint.unit}; its range is {limit:.4g}"
            remedy = f"Set {' or '.join(candidates) or 'the unit of its sensor'}"
            yield ChannelDoubt(i, "side" if candidates == ["side: motor"] else "unit", f"{text}. {remedy}")


def _motion_doubts(joint: JointSignals) -> Iterator[ChannelDoubt]:
    """Yield contradictions of the motions of a joint in quantity, unit or sign, else of its torque and motion."""
    is_consistent = False
    for a, b in combinations(sorted(joint.motions, key=joint.order), 2):
        relations = motion_relations(joint.signals[:, a], joint.signals[:, b], joint.rate_hz)
        stated_order = joint.order(b) - joint.order(a)
        at_order, best = relations[stated_order], max(relations, key=lambda k: abs(relations[k].correlation))
        gain, order = abs(at_order.gain), joint.order(a) + best
        if abs(at_order.correlation) < MIN_DELAY_CORRELATION and abs(relations[best].correlation) > MIN_CORRELATION:
            i, k = (b, order) if 0 <= order < len(MOTIONS) else (a, joint.order(b) - best)
            text = f"{joint.describe(b)} is proportional to the derivative of order {best} of {joint.describe(a)}"
            remedy = f"{joint.channels[i].name_in_file} is probably quantity: {MOTIONS[k % 3]}"
            yield ChannelDoubt(i, "quantity", f"{text}; {remedy}")
            return
        if abs(at_order.correlation) < MIN_CORRELATION:
            continue
        if abs(np.log(gain)) > MAX_LN_GAIN:
            yield from _gain_doubts(joint, a, b, gain, stated_order)
            return
        if at_order.gain < 0:
            i = next((i for i in (a, b) if _torque_relation(joint, i).is_against_motion), b)
            names = f"{joint.describe(a)} and {joint.describe(b)} of joint {joint.joint.name}"
            yield ChannelDoubt(i, "sign", f"{names} have opposite signs. Give one of them sign: -1")
            return
        is_consistent = True
    for i in joint.motions[:1]:
        relation = _torque_relation(joint, i)
        names = f"torque {joint.channels[joint.torque or 0].name_in_file} and {joint.describe(i)}"
        if relation.is_against_motion:
            text = f"{names} give a negative inertia or friction. Give one of them sign: -1"
            yield ChannelDoubt(joint.torque if is_consistent else i, "sign", text, relation.is_shared)
        elif relation.is_before_gear(joint.joint, joint.ratio):
            text = f"{names} give an inertia below the rotor's own. If they are logged before the gear, set side: motor"
            yield ChannelDoubt(joint.torque, "side", text, relation.is_shared)


def _sensor_doubts(joint: JointSignals) -> Iterator[ChannelDoubt]:
    """Yield contradictions of torque and torque sensor in sign or unit by u = J_m a + friction + s."""
    if joint.sensor is None or joint.torque is None or not joint.motions:
        return
    i, u, s = joint.sensor, joint.signals[:, joint.torque], -joint.signals[:, joint.sensor]
    motion = joint.motions[0]
    y, order = joint.signals[:, motion], joint.order(motion)
    gain, std = sensor_gain(u, s, y, order, joint.rate_hz)
    relations = [torque_relation(x, y, order, joint.rate_hz, not joint.joint.slides) for x in (u, s)]
    names = f"{joint.channels[joint.torque].name_in_file} and {joint.channels[i].name_in_file}"
    is_certain = np.isfinite(std)
    if MIN_GAIN_OVER_STD * std < -gain or (not is_certain and relations[1].is_against_motion):
        text = f"motor torque and torque sensor ({names}) have opposite signs"
        yield ChannelDoubt(i, "sign", f"{text}. Change the sign of the sensor channel (role d)")
        return
    if not is_certain:  # the sensor measures an inertia, which is a part of the motor's
        inertias = [relation.inertia for relation in relations]
        gain, std = inertias[0] / max(inertias[1], 1e-300), 0.0 if min(inertias) > 0 else np.inf
    is_other = abs(np.log(gain)) > MAX_LN_LOSS if is_certain else gain < np.exp(-MAX_LN_LOSS)
    if MIN_GAIN_OVER_STD * std < gain and is_other and joint.channels[joint.torque].quantity != "current":
        for distance, keys in sorted([(abs(np.log(gain * factor)), keys) for factor, keys in joint.factors(i)])[:1]:
            text = f"the motor torque is {gain:.3g} times the sensor's ({names})"
            if distance < MAX_LN_LOSS or not is_certain:
                yield ChannelDoubt(i, keys.partition(":")[0], f"{text}; with {keys} they are consistent")


def _torque_relation(joint: JointSignals, i: int) -> TorqueRelation:
    if joint.torque is None:
        return TorqueRelation()
    u, y = joint.signals[:, joint.torque], joint.signals[:, i]
    index_of = {c.at: k for k, c in reversed(list(enumerate(joint.channels))) if c.role == "y"}
    other_motions = [(joint.signals[:, k], joint.order(k)) for k in index_of.values() if k not in joint.motions]
    return torque_relation(u, y, joint.order(i), joint.rate_hz, not joint.joint.slides, other_motions)


def _gain_doubts(joint: JointSignals, a: int, b: int, gain: float, order: int) -> Iterator[ChannelDoubt]:
    """Yield `ChannelDoubt` of unit or side of two inconsistent motions, of the gear ratio, or of the rate."""
    text = f"{joint.describe(b)} is {gain:.4g} times the value computed from {joint.describe(a)}"
    factors = [(x**sense, i, keys) for i, sense in ((b, 1), (a, -1)) for x, keys in joint.factors(i)]
    candidates = [(i, keys) for x, i, keys in factors if abs(np.log(gain / x)) <= MAX_LN_FACTOR]
    for i, keys in sorted(candidates, key=lambda pair: not pair[1].startswith("side"))[:1]:
        yield ChannelDoubt(i, keys.partition(":")[0], f"{text}; with {keys} both are consistent")
    if not candidates and order == 0 and abs(np.log(gain)) > MAX_LN_SPRING_GAIN:
        ratio = f"motor.ratio of joint {joint.joint.name} in the robot's file ({joint.ratio:g})"
        yield ChannelDoubt(b, "scale", f"{text}. Check {ratio}, and unit and scale of both")
    elif not candidates and order > 0:
        rate_hz = gain ** (1 / order) * joint.rate_hz
        yield ChannelDoubt(None, "rate_hz", f"{text}; the sampling rate is probably {rate_hz:.4g} Hz")
