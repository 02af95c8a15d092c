"""Joints of a log: torque and motion channels, guessed from names, units and relations between the signals of a joint.

If a name states no quantity, the signal is assumed to have the quantity that is missing among the other signals.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.units import dimension_and_size, translation_unit
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT
from elastid.logs.channel_names import DRIVES, ChannelGuess, ChannelKey
from elastid.logs.clocks import is_clock
from elastid.logs.motion_relations import (
    MAX_LN_LOSS,
    MIN_CORRELATION,
    MIN_GAIN_OVER_STD,
    REST_TRAVEL_M,
    REST_TRAVEL_RAD,
    TorqueRelation,
    motion_relations,
    range_without_spikes,
    sensor_gain,
    torque_relation,
)
from elastid.logs.units_and_sides import unwrap

_MOTION_HZ = 3.0  # torques have half of their power below this frequency in motions, above it in vibration tests

T = TypeVar("T")
Values = Mapping[ChannelKey, FloatArray]


@dataclass(frozen=True)
class JointGuess:
    """Torque and motion of a motor, and the fraction of the torque that the motion explains.

    sensor: torque sensor behind the gear.  sensor_gain: of the torque over the sensor; 1 if unknown.
    """

    torque: ChannelGuess
    motion: ChannelGuess
    relation: TorqueRelation
    sensor: ChannelGuess | None = None
    sensor_gain: float = 1.0

    @property
    def sensor_doubt(self) -> str:
        """Contradiction of sensor and torque in size; empty without one."""
        gain = self.sensor_gain * self.torque.ratio
        if self.sensor is None or abs(np.log(gain)) < MAX_LN_LOSS:
            return ""
        return f"{self.torque.name} is {gain:.3g} times {self.sensor.name}. State unit, and side or ratio, of both"


@dataclass(frozen=True)
class LogGuess:
    """The joints or inputs and outputs of a log.

    is_motion: they move as robots do, so that friction can be found.  references: commanded positions of the joints.
    """

    joints: tuple[JointGuess, ...]
    other_outputs: tuple[ChannelGuess, ...]
    is_motion: bool
    references: tuple[ChannelGuess, ...] = ()

    def with_separate_motions(self) -> "LogGuess":
        """Drop joints that share the motion channel of an earlier joint."""
        motions = [joint.motion.key for joint in self.joints]
        return replace(self, joints=tuple(j for i, j in enumerate(self.joints) if motions[i] not in motions[:i]))

    @property
    def is_impact_test(self) -> bool:
        """True for the force of a hammer or shaker, and accelerations."""
        return (self.joints[0].torque.quantity, self.joints[0].motion.quantity) == ("force", "acceleration")

    @property
    def sensor_doubt(self) -> str:
        """First contradiction of a torque sensor, empty without one; after a contradiction no sensor is used."""
        return next((joint.sensor_doubt for joint in self.joints if joint.sensor_doubt), "")

    @property
    def motions(self) -> tuple[ChannelGuess, ...]:
        """Motions of the joints, then the other outputs."""
        return (*(joint.motion for joint in self.joints), *self.other_outputs)


def guess_log(signals: Sequence[tuple[ChannelGuess, FloatArray]], rate_hz: float) -> LogGuess | None:
    """Guess the joints of a log, each with torque and motion channel; None if nothing identifies the channels."""
    values, guesses = {g.key: x for g, x in signals}, [g for g, _ in signals]
    on_motors = [g for g in guesses if not g.is_torque_sensor]
    has_motors = any(g.quantity in DRIVES and g.rank >= 0 for g in on_motors)
    drives, motions = _best_family(on_motors if has_motors else guesses, DRIVES), _best_family(guesses, MOTIONS)
    if bool(drives) != bool(motions):
        drives, motions = _assume_missing_quantity(drives, motions, [g for g, x in signals if not is_clock(x)])
    if not drives:
        return None
    quantity, slides = motions[0].quantity, all(g.quantity == "force" for g in drives)
    speeds = {g.joint_label: g for g in _best_family([g for g in guesses if g.quantity == "velocity"], MOTIONS)}
    motions = [_with_unit(m, speeds.get(m.joint_label), values, rate_hz, slides) for m in motions]
    motions = _with_common_unit(motions)
    motion_at = {m.joint_label: m for m in motions}
    motion_of_drive = [motion_at.get(d.joint_label, motions[min(i, len(motions) - 1)]) for i, d in enumerate(drives)]
    joints = [
        _make_joint(*pair, motion_of_drive, values, rate_hz) for pair in zip(drives, motion_of_drive, strict=True)
    ]
    joints = _sort_by_number(joints, [drive.joint_label for drive in drives])
    joints = _with_sensors(guesses, joints, values, rate_hz) if has_motors else joints
    motor_motions = {joint.motion.key for joint in joints}
    measured = {g.key: g for g in (*(g for g in guesses if g.quantity in MOTIONS and g.rank >= 0), *motions)}
    kinds = MOTIONS if slides and len(drives) < len(measured) else (quantity,)  # a structure has several quantities
    outputs = [g for g in measured.values() if g.quantity in kinds and g.key not in motor_motions]
    outputs = [_with_unit(g, None, values, rate_hz, slides) for g in outputs]
    pairs = [(values[joint.torque.key], _in_si(joint.motion, values)) for joint in joints]
    rests = [REST_TRAVEL_M if joint.motion.slides else REST_TRAVEL_RAD for joint in joints]
    moving = [pair for pair, rest in zip(pairs, rests, strict=True) if range_without_spikes(pair[1]) > rest]
    moving = moving or [(u, u) for u, _ in pairs]  # without a moving joint, noise is used
    if quantity != "position":
        return LogGuess(tuple(joints), tuple(outputs), is_motion=False)
    is_motion = bool(np.median([_half_power_hz(u, y, rate_hz) for u, y in moving]) < _MOTION_HZ)
    references = (command for _, command in _command_pairs([joint.motion for joint in joints], guesses))
    return LogGuess(tuple(joints), tuple(outputs), is_motion, tuple(references))


def _half_power_hz(u: FloatArray, y: FloatArray, rate_hz: float) -> float:
    """Return the frequency, Hz, below which a torque (n,) has half of its power that is coherent with the motion (n,).

    Segments last up to 1 s (Carter, Proc. IEEE 75, 1987); coherence below the 99 % quantile of noise counts as zero.
    """
    from scipy.signal import coherence

    power, size = np.abs(np.fft.rfft(u - u.mean())) ** 2, min(int(rate_hz), len(u) // 8)
    if size > 2:
        hz, fraction = coherence(u, np.gradient(y), rate_hz, nperseg=size)
        fraction[fraction < 1 - 0.01 ** (size / len(u))] = 0.0
        fraction[:2] = 1.0  # a segment is too short for these lines
        power *= np.interp(np.arange(len(power)) * rate_hz / len(u), hz, fraction)
    total = np.cumsum(power)
    return float(np.argmax(total >= total[-1] / 2)) * rate_hz / len(u)


def _with_sensors(
    guesses: Sequence[ChannelGuess], joints: Sequence[JointGuess], values: Values, rate_hz: float
) -> list[JointGuess]:
    """Add torque sensors behind the gears to joints by numbers in their names; none unless each joint has one."""
    sensors = _best_family([g for g in guesses if g.is_torque_sensor and g.rank >= 0], ("torque",))
    by_number = {tuple(re.findall(r"\d+", g.joint_label)): g for g in sensors}
    matches = [by_number.get(tuple(re.findall(r"\d+", joint.torque.joint_label))) for joint in joints]
    if len(sensors) != len(joints) or None in matches:
        return list(joints)
    return [_with_sensor(*pair, values, rate_hz) for pair in zip(joints, filter(None, matches), strict=True)]


def _with_sensor(joint: JointGuess, sensor: ChannelGuess, values: Values, rate_hz: float) -> JointGuess:
    """Add the sensor of a joint; its sign turns it into the torque of the links on the motor."""
    s, u = (dimension_and_size(g.unit)[1] * values[g.key] for g in (sensor, joint.torque))
    y = joint.motion.sign * _in_si(joint.motion, values)
    gain, std = sensor_gain(u, s, y, MOTIONS.index(joint.motion.quantity), rate_hz)
    is_certain, why = MIN_GAIN_OVER_STD * std < abs(gain), "torque sensor behind the gear, by its name"
    sensor = replace(sensor, unit=sensor.unit or "N*m", sign=1 if is_certain and gain < 0 else -1, why=why)
    is_torque = joint.torque.quantity == "torque"  # the torque constant of a current is unknown
    return replace(joint, sensor=sensor, sensor_gain=abs(gain) if is_certain and is_torque else 1.0)


def _in_si(motion: ChannelGuess, values: Values) -> FloatArray:
    """Return motion (n,) in SI without its sign, an angle unwrapped."""
    size, turns = abs(motion.to_si), motion.quantity == "position" and dimension_and_size(motion.unit)[0] == "rad"
    x = values[motion.key]
    return size * (unwrap(x, 2 * np.pi / size)[0] if turns else x)


def _sort_by_number(items: Sequence[T], labels: Sequence[str]) -> list[T]:
    """Sort joints by the numbers in their labels, if these differ; else in the order of the log."""
    numbers = [tuple(map(int, re.findall(r"\d+", label))) for label in labels]
    is_numbered = all(numbers) and len(set(numbers)) == len(numbers)
    order = sorted(range(len(items)), key=numbers.__getitem__) if is_numbered else range(len(items))
    return [items[i] for i in order]


def guess_commands(
    signals: Sequence[tuple[ChannelGuess, FloatArray]], rate_hz: float
) -> tuple[tuple[ChannelGuess, ChannelGuess], ...]:
    """Pair measured and commanded positions of joints by names; none unless every measured one has a command."""
    values, guesses = {g.key: x for g, x in signals}, [g for g, _ in signals]
    positions = _best_family([g for g in guesses if g.rank >= 0], ("position",))
    positions = _with_common_unit([_with_unit(g, None, values, rate_hz, False) for g in positions])
    pairs = _command_pairs(positions, guesses)
    return tuple(_sort_by_number(pairs, [g.joint_label for g, _ in pairs]))


def _with_common_unit(motions: list[ChannelGuess]) -> list[ChannelGuess]:
    if in_deg := next((m.name for m in motions if m.unit == "deg"), ""):
        return [replace(m, unit="deg", why=f"deg as {in_deg}") if "assumed" in m.why else m for m in motions]
    return motions


def _command_pairs(
    positions: Sequence[ChannelGuess], guesses: Sequence[ChannelGuess]
) -> list[tuple[ChannelGuess, ChannelGuess]]:
    """Pair each position with the commanded position of its joint by names; empty unless all of them have a command."""
    commands = {g.joint_label: g for g in _best_family([g for g in guesses if g.rank < 0], ("position",))}
    pairs = [(y, commands[y.joint_label]) for y in positions if y.joint_label in commands]
    return [(y, replace(r, unit=r.unit or y.unit)) for y, r in pairs] if len(pairs) == len(positions) else []


def _assume_missing_quantity(
    drives: list[ChannelGuess], motions: list[ChannelGuess], guesses: Sequence[ChannelGuess]
) -> tuple[list[ChannelGuess], list[ChannelGuess]]:
    """Complete drives or motions, if either is missing, by signals without a quantity at the same joints.

    A force without a motion is a hammer's or a shaker's, and all other signals of its log are accelerations.
    """
    labels, unknown = [g.joint_label for g in drives or motions], [g for g in guesses if not g.quantity]
    families = [[g for g in unknown if g.family == name] for name in dict.fromkeys(g.family for g in unknown)]
    matches = [family for family in families if sorted(g.joint_label for g in family) == sorted(labels)]
    matches = matches or ([unknown] if len(unknown) == len(labels) == 1 else [])
    is_structure = bool(drives) and drives[0].quantity == "force" and len(drives) < len(unknown)
    if not unknown or not (matches or is_structure):
        return [], []
    quantity = "torque" if motions else "acceleration" if is_structure else "position"
    members = unknown if is_structure else max(matches, key=lambda family: family[0].rank)
    why = f"its name identifies nothing; a {quantity} according to the channels next to it"
    guess = [replace(g, quantity=quantity, why=g.why if g.why.startswith("?") else why) for g in members]
    return (drives, guess) if drives else (guess, motions)


def _best_family(guesses: Sequence[ChannelGuess], order: Sequence[str]) -> list[ChannelGuess]:
    families: dict[tuple[str, str], list[ChannelGuess]] = {}
    for guess in guesses:
        if guess.quantity in order:
            families.setdefault((guess.family, guess.quantity), []).append(guess)

    def merit(family: Sequence[ChannelGuess]) -> tuple[float, ...]:
        first = family[0]
        return (first.rank >= 0, -order.index(first.quantity), first.rank, bool(first.unit), len(family))

    return max(families.values(), key=merit, default=[])


def _with_unit(
    motion: ChannelGuess, speed: ChannelGuess | None, values: Values, rate_hz: float, slides: bool
) -> ChannelGuess:
    """Set the unit of a motion channel by its velocity or range, SI by default. slides: its drive is a force."""
    if motion.unit:
        return motion
    x, is_counted = values[motion.key], motion.why.startswith("?")
    if speed is not None and motion.quantity == "position" and not is_counted:
        relation = motion_relations(x, values[speed.key], rate_hz)[1]
        size = abs(relation.gain) * dimension_and_size(speed.unit)[1]
        if abs(relation.correlation) > MIN_CORRELATION and abs(np.log(max(size, 1e-300) * 180 / np.pi)) < 0.1:
            return replace(motion, unit="deg", why=f"deg by its derivative, {speed.name}")
    if motion.quantity == "position" and not (slides or is_counted) and range_without_spikes(x) > 8 * np.pi:
        return replace(motion, unit="deg", why=f"{motion.why}; deg since it covers {range_without_spikes(x):.3g}")
    unit = QUANTITY_UNIT[motion.quantity]
    unit = translation_unit(unit) if slides else unit
    return replace(motion, unit=unit, why=f"{motion.why}; {unit} is assumed")


def _make_joint(
    drive: ChannelGuess, motion: ChannelGuess, motions: Sequence[ChannelGuess], values: Values, rate_hz: float
) -> JointGuess:
    """Make the joint of a torque and a motion, among the motions of all joints."""
    other_motions = {g.key: (_in_si(g, values), MOTIONS.index(g.quantity)) for g in (*motions, motion)}
    y, order = other_motions.pop(motion.key)
    best = torque_relation(drive.to_si * values[drive.key], y, order, rate_hz, others=[*other_motions.values()])
    if best.is_against_motion:
        motion = replace(motion, sign=-1, why=f"{motion.why}; sign -1 since inertia and friction are positive so")
    motion = replace(motion, why=f"{motion.why}; it explains {100 * best.explained:.0f} % of {drive.name}")
    return JointGuess(drive, motion, best)
