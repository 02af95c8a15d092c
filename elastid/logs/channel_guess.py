"""Channels of a log: guessed by names, units and the motions of one joint.

A signal without a telling name has the quantity that is missing among the other signals.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.units import dimension_and_size, of_translation
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec
from elastid.logs.channel_names import ChannelGuess, ChannelKey, guess_by_name
from elastid.logs.clocks import channel_rates, is_clock, slowest_ms
from elastid.logs.files.log import ArrayLog, Log
from elastid.logs.files.text import TextLog
from elastid.logs.motion_relations import (
    MAX_EFFICIENCY,
    MIN_CORRELATION,
    MIN_GAIN_OVER_STD,
    TorqueRelation,
    motion_relations,
    sensor_gain,
    torque_relation,
    travel,
)
from elastid.logs.repair import Log as RepairLog
from elastid.logs.repair import bridged
from elastid.logs.repair.outliers import without_lone
from elastid.logs.units_and_sides import MAX_COMPUTABLE, unwrapped

DRIVES = ("torque", "force", "current", "voltage")
MIN_SAMPLES = 100  # of a log
_MIN_MEASURED_FRACTION = 2 / 3  # of the samples of a signal
_GRAVITY, _MAX_GRAVITY_ERROR = 9.80665, 0.1  # m/s^2, and relative error of an accelerometer
_MOTION_HZ = 3.0  # half of the power of a torque is below it in a motion, and above it in a vibration test
_MIN_COUNTS = 50  # minimum range of whole numbers that may be counts

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
        if self.sensor is None or abs(np.log(gain)) < MAX_EFFICIENCY:
            return ""
        return f"{self.torque.name} is {gain:.3g} times {self.sensor.name}. State unit, and side or ratio, of both"

    @property
    def slides(self) -> bool:
        """True if the motion has a unit of translation."""
        return dimension_and_size(self.motion.unit)[0].startswith("m")


@dataclass(frozen=True)
class LogGuess:
    """The joints or inputs and outputs of a log.

    is_motion: they move as robots do, so that friction can be found.  references: commanded positions of the joints.
    """

    joints: tuple[JointGuess, ...]
    further: tuple[ChannelGuess, ...]
    is_motion: bool
    references: tuple[ChannelGuess, ...] = ()

    def with_separate_motions(self) -> "LogGuess":
        """Drop joints that share the motion channel of an earlier joint."""
        motions = [joint.motion.key for joint in self.joints]
        return replace(self, joints=tuple(j for i, j in enumerate(self.joints) if motions[i] not in motions[:i]))

    @property
    def is_hit(self) -> bool:
        """True for the force of a hammer or shaker, and accelerations."""
        return (self.joints[0].torque.quantity, self.joints[0].motion.quantity) == ("force", "acceleration")

    @property
    def sensor_doubt(self) -> str:
        """Contradiction of the first torque sensor that has one; if there is any, no sensor is used."""
        return next((joint.sensor_doubt for joint in self.joints if joint.sensor_doubt), "")

    @property
    def motions(self) -> tuple[ChannelGuess, ...]:
        """Motions of the joints, then further ones."""
        return (*(joint.motion for joint in self.joints), *self.further)


def signals_of(log: Log, most: int, with_constant: bool = False) -> list[tuple[ChannelGuess, FloatArray]]:
    """Return varying signals (n,) of the most frequent length, matrices by column, each with the guess by its name.

    with_constant: include constant signals.
    """
    if channels_ms := channel_rates(log):
        return _resample_to_slowest(log, channels_ms, most)
    shapes = {name: shape for name, shape in log.shapes().items() if max(shape) > 2}
    frequent = Counter(max(shape) for shape in shapes.values() if max(shape) > MIN_SAMPLES).most_common(1)
    units = dict(zip(log.headings, log.units, strict=False)) if isinstance(log, TextLog) else {}
    result = []
    for name, shape in shapes.items():
        count = min(shape) if len(shape) > 1 else 1
        columns = (log.numbers_of(name) if isinstance(log, TextLog) else []) or range(1, count + 1)
        for column in columns if frequent and max(shape) == frequent[0][0] else ():
            number = column if len(columns) > 1 else None
            try:
                x = log.values([ChannelSpec("y", "any", name, number, quantity="position")], slice(0, most))[:, 0]
            except DataError:  # words
                continue
            x = np.where(np.abs(x) < MAX_COMPUTABLE, x, np.nan)
            heading, unit = _heading(log, name, column) if isinstance(log, ArrayLog) else (name, units.get(name, ""))
            guess = guess_by_name(heading, number, unit)
            if np.isfinite(x).all() and len(x) > MIN_SAMPLES:  # a wrong cell is missing
                is_position = [True] if guess.quantity == "position" else []
                x = without_lone(x[:, None], RepairLog("", ("",)), is_position)[:, 0]
            is_measured = np.isfinite(x).sum() > _MIN_MEASURED_FRACTION * len(x)
            if is_measured and (np.ptp(whole := bridged(x)) > 0 or with_constant):
                result.append((replace(_with_counts(guess, whole), name=name), whole))
    return _with_gravity(_with_commands(result))


def _with_counts(guess: ChannelGuess, x: FloatArray) -> ChannelGuess:
    """Return the guess with a question if it has no unit and its values (n,) are whole numbers, as counts are."""
    is_whole = bool(np.all(x == np.round(x))) and float(np.ptp(x)) > _MIN_COUNTS
    if guess.unit or guess.quantity not in (*MOTIONS, *DRIVES) or not is_whole or guess.why.startswith("?"):
        return guess
    remedy = "scale = 360 / counts per turn, with unit: deg" if guess.quantity == "position" else "give unit and scale"
    return replace(guess, why=f"? whole numbers without a unit: {remedy}")


def wrong_cells(log: Log, names: Sequence[str], most: int) -> list[str]:
    """Return message on the first cell of a text without a number: first among the signals, then in other columns."""
    if not isinstance(log, TextLog) or log.sample_ms:
        return []
    columns = enumerate(name for name, _ in log.named_columns())
    groups = [[i for i, name in columns if name in names]]
    groups += [[*range(log.n_columns)]] if not groups[0] else []
    return [cell for cell in [log.wrong_cell(groups[-1], slice(0, most))] if cell]


def _with_gravity(signals: list[tuple[ChannelGuess, FloatArray]]) -> list[tuple[ChannelGuess, FloatArray]]:
    """Set the unit, g or mm/s^2, of three axes of an accelerometer without one, whose mean is gravity."""
    axes = [
        (g, float(np.mean(x)))
        for g, x in signals
        if g.quantity == "acceleration" and not (g.unit or g.why.startswith("?"))
    ]
    gravity = float(np.linalg.norm([mean for _, mean in axes]))
    is_one = len(axes) == 3 and len({g.parts[0] for g, _ in axes}) == 1
    units = {"g": ("m/s^2", _GRAVITY, 1.0), "mm/s^2": ("mm/s^2", 1.0, 1e3 * _GRAVITY)}
    unit = next((name for name, row in units.items() if is_one and abs(gravity / row[2] - 1) < _MAX_GRAVITY_ERROR), "")
    if not unit:
        return signals
    members, (si, scale, _) = {g.key for g, _ in axes}, units[unit]
    why = f"unit {unit}: the mean acceleration is {gravity:.4g}"
    return [(replace(g, unit=si, scale=scale, why=why) if g.key in members else g, x) for g, x in signals]


def _resample_to_slowest(
    log: Log, channels: Sequence[tuple[str, str, float]], most: int
) -> list[tuple[ChannelGuess, FloatArray]]:
    """Interpolate the signals that have a quantity at the times of the slowest one; DataError if these begin later."""
    slowest, result = slowest_ms(channels), []
    for name, unit, ms in channels:
        guess = guess_by_name(name, None, unit)
        if guess.quantity and ms <= slowest:
            x = log.values([ChannelSpec("y", "any", name, quantity="position")], slice(0, int(most * slowest / ms)))
            whole = bridged(without_lone(x, RepairLog("", ("",)))[:, 0])
            at = np.arange(int(len(whole) * ms / slowest)) * slowest / ms
            rate_hz = None if ms == slowest else float(f"{1e3 / ms:.6g}")
            result.append((replace(guess, rate_hz=rate_hz), np.interp(at, np.arange(len(whole)), whole)))
    n = min((len(x) for _, x in result), default=0)
    return _with_commands([(guess, x[:n]) for guess, x in result if np.ptp(x[:n]) > 0])


def _heading(log: Log, name: str, column: int) -> tuple[str, str]:
    """Name and unit of a column by its array, or by the cells InputName{1} and InputUnit{1} of an iddata struct."""
    side = re.fullmatch(r"(.*(?:Input|Output))Data", name)
    keys = [f"{side[1]}{key}{{{column}}}" if side else "" for key in ("Name", "Unit")]
    heading, unit = (log.arrays[key].text if key in log.arrays else "" for key in keys)
    return heading or name, unit or log.arrays[name].units


def _with_commands(signals: list[tuple[ChannelGuess, FloatArray]]) -> list[tuple[ChannelGuess, FloatArray]]:
    """Interpret signals named as commands, without a quantity, as positions if their joint's position follows them."""
    positions = {g.parts[1]: (g.name, x) for g, x in signals if g.quantity == "position" and g.rank >= 0}

    def interpret(guess: ChannelGuess, x: FloatArray) -> ChannelGuess:
        name, y = positions.get(guess.parts[1], ("", x))
        lag = _lag(x, y)
        is_near = 0 < np.std(x[: len(x) - lag] - y[lag:]) < np.std(y) / 2
        if guess.quantity or guess.rank >= 0 or not is_near:
            return guess
        return replace(guess, quantity="position", why=f"by its name, and since {name} follows it")

    return [(interpret(guess, x), x) for guess, x in signals]


def _lag(x: FloatArray, y: FloatArray) -> int:
    """Return the delay of y behind x in samples, at most a twentieth of the signal."""
    X, Y = (np.fft.rfft(signal - signal.mean(), 2 * len(signal)) for signal in (x, y))
    return int(np.argmax(np.fft.irfft(X.conj() * Y)[: max(1, len(x) // 20)]))


def guess_log(signals: Sequence[tuple[ChannelGuess, FloatArray]], rate_hz: float) -> LogGuess | None:
    """Guess the joints of a log, each with torque and motion channel; None if nothing identifies the channels."""
    values, guesses = {g.key: x for g, x in signals}, [g for g, _ in signals]
    on_motors = [g for g in guesses if not g.is_torque_sensor]
    has_motors = any(g.quantity in DRIVES and g.rank >= 0 for g in on_motors)
    drives, motions = _best_family(on_motors if has_motors else guesses, DRIVES), _best_family(guesses, MOTIONS)
    if bool(drives) != bool(motions):
        drives, motions = _completed(drives, motions, [g for g, x in signals if not is_clock(x)])
    if not drives:
        return None
    quantity, slides = motions[0].quantity, all(g.quantity == "force" for g in drives)
    speeds = {g.parts[1]: g for g in _best_family([g for g in guesses if g.quantity == "velocity"], MOTIONS)}
    motions = [_with_unit(m, speeds.get(m.parts[1]), values, rate_hz, slides) for m in motions]
    motions = _with_common_unit(motions)
    motion_at = {m.parts[1]: m for m in motions}
    paired = [motion_at.get(d.parts[1], motions[min(i, len(motions) - 1)]) for i, d in enumerate(drives)]
    joints = [_joint(*pair, paired, values, rate_hz) for pair in zip(drives, paired, strict=True)]
    joints = _sorted(joints, [drive.parts[1] for drive in drives])
    joints = _with_sensors(guesses, joints, values, rate_hz) if has_motors else joints
    motor_motions = {joint.motion.key for joint in joints}
    measured = {g.key: g for g in (*(g for g in guesses if g.quantity in MOTIONS and g.rank >= 0), *motions)}
    kinds = MOTIONS if slides and len(drives) < len(measured) else (quantity,)  # of a structure all of them
    outputs = [g for g in measured.values() if g.quantity in kinds and g.key not in motor_motions]
    outputs = [_with_unit(g, None, values, rate_hz, slides) for g in outputs]
    torques = np.stack([values[joint.torque.key] for joint in joints])
    power = np.cumsum(np.abs(np.fft.rfft(torques - torques.mean(axis=1, keepdims=True))) ** 2, axis=1)
    half_hz = np.argmax(power >= power[:, -1:] / 2, axis=1) * rate_hz / torques.shape[1]
    is_motion = bool(np.all(half_hz < _MOTION_HZ)) and quantity == "position"
    return LogGuess(tuple(joints), tuple(outputs), is_motion, _references(guesses, joints))


def _with_sensors(
    guesses: Sequence[ChannelGuess], joints: Sequence[JointGuess], values: Values, rate_hz: float
) -> list[JointGuess]:
    """Add torque sensors behind the gears to joints by numbers in their names; none unless each joint has one."""
    sensors = _best_family([g for g in guesses if g.is_torque_sensor and g.rank >= 0], ("torque",))
    by_number = {tuple(re.findall(r"\d+", g.parts[1])): g for g in sensors}
    pairs = [(by_number.get(tuple(re.findall(r"\d+", joint.torque.parts[1]))), joint) for joint in joints]
    if len(sensors) != len(joints):
        return list(joints)
    result = [_with_sensor(joint, sensor, values, rate_hz) for sensor, joint in pairs if sensor]
    return result if len(result) == len(joints) else list(joints)


def _with_sensor(joint: JointGuess, sensor: ChannelGuess, values: Values, rate_hz: float) -> JointGuess:
    """Add the sensor of a joint; its sign turns it into the torque of the links on the motor."""
    s, u = (dimension_and_size(g.unit)[1] * values[g.key] for g in (sensor, joint.torque))
    y = joint.motion.sign * _in_si(joint.motion, values)
    gain, std = sensor_gain(u, s, y, MOTIONS.index(joint.motion.quantity), rate_hz)
    is_certain, why = MIN_GAIN_OVER_STD * std < abs(gain), "torque sensor behind the gear, by its name"
    sensor = replace(sensor, unit=sensor.unit or "N*m", sign=1 if is_certain and gain < 0 else -1, why=why)
    is_torque = joint.torque.quantity == "torque"  # of a current the constant is unknown
    return replace(joint, sensor=sensor, sensor_gain=abs(gain) if is_certain and is_torque else 1.0)


def _in_si(motion: ChannelGuess, values: Values) -> FloatArray:
    """Return motion (n,) in SI without its sign, an angle unwrapped."""
    size, turns = abs(motion.to_si), motion.quantity == "position" and dimension_and_size(motion.unit)[0] == "rad"
    x = values[motion.key]
    return size * (unwrapped(x, 2 * np.pi / size)[0] if turns else x)


def _sorted(items: Sequence[T], labels: Sequence[str]) -> list[T]:
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
    measured = _best_family([g for g in guesses if g.rank >= 0], ("position",))
    measured = _with_common_unit([_with_unit(g, None, values, rate_hz, False) for g in measured])
    commanded = _commanded_positions(guesses)
    pairs = [(g, commanded[g.parts[1]]) for g in measured if g.parts[1] in commanded]
    pairs = _sorted(pairs, [g.parts[1] for g, _ in pairs])
    return tuple((y, replace(r, unit=r.unit or y.unit)) for y, r in pairs) if len(pairs) == len(measured) else ()


def _with_common_unit(motions: list[ChannelGuess]) -> list[ChannelGuess]:
    if in_deg := next((m.name for m in motions if m.unit == "deg"), ""):
        return [replace(m, unit="deg", why=f"deg as {in_deg}") if "assumed" in m.why else m for m in motions]
    return motions


def _commanded_positions(guesses: Sequence[ChannelGuess]) -> dict[str, ChannelGuess]:
    return {g.parts[1]: g for g in _best_family([g for g in guesses if g.rank < 0], ("position",))}


def _references(guesses: Sequence[ChannelGuess], joints: Sequence[JointGuess]) -> tuple[ChannelGuess, ...]:
    """Return commanded positions by their names, one for each joint whose position is known; else none."""
    commanded = _commanded_positions(guesses)
    members = [commanded.get(joint.motion.parts[1]) for joint in joints if joint.motion.quantity == "position"]
    if len(members) < len(joints) or None in members:
        return ()
    return tuple(replace(g, unit=g.unit or joint.motion.unit) for g, joint in zip(members, joints, strict=True) if g)


def _completed(
    drives: list[ChannelGuess], motions: list[ChannelGuess], guesses: Sequence[ChannelGuess]
) -> tuple[list[ChannelGuess], list[ChannelGuess]]:
    """Complete drives or motions, if either is missing, by signals without a quantity at the same joints.

    A force without a motion is a hammer's or a shaker's, and all other signals of its log are accelerations.
    """
    labels, unknown = [g.parts[1] for g in drives or motions], [g for g in guesses if not g.quantity]
    families = [[g for g in unknown if g.parts[0] == name] for name in dict.fromkeys(g.parts[0] for g in unknown)]
    matches = [family for family in families if sorted(g.parts[1] for g in family) == sorted(labels)]
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
            families.setdefault((guess.parts[0], guess.quantity), []).append(guess)

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
    if motion.quantity == "position" and not (slides or is_counted) and travel(x) > 8 * np.pi:
        return replace(motion, unit="deg", why=f"{motion.why}; deg since it covers {travel(x):.3g}")
    unit = QUANTITY_UNIT[motion.quantity]
    unit = of_translation(unit) if slides else unit
    return replace(motion, unit=unit, why=f"{motion.why}; {unit} is assumed")


def _joint(
    drive: ChannelGuess, motion: ChannelGuess, motions: Sequence[ChannelGuess], values: Values, rate_hz: float
) -> JointGuess:
    """Make the joint of a torque and a motion, among the motions of all joints."""
    others = {g.key: (_in_si(g, values), MOTIONS.index(g.quantity)) for g in (*motions, motion)}
    y, order = others.pop(motion.key)
    best = torque_relation(drive.to_si * values[drive.key], y, order, rate_hz, others=[*others.values()])
    if best.is_against_motion:
        motion = replace(motion, sign=-1, why=f"{motion.why}; sign -1 since inertia and friction are positive so")
    motion = replace(motion, why=f"{motion.why}; it explains {100 * best.explained:.0f} % of {drive.name}")
    return JointGuess(drive, motion, best)
