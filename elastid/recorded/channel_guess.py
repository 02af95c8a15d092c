"""Guesses of the channels of a log: quantity and unit by name, joint by what names share, sign by the power.

Signals whose names say nothing are what the others lack.

Names of channels: the quantity, unit and joint that they say, and channels that a study states otherwise.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.units import TABLE, of_translation, usual_spelling
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec
from elastid.recorded.evidence import (
    MIN_CORRELATION,
    TorqueRelation,
    motion_relations,
    torque_relation,
    travel,
    velocities,
)
from elastid.recorded.files.formats import values_of
from elastid.recorded.files.log import ArrayLog, Log
from elastid.recorded.files.text import TextLog
from elastid.recorded.repair.time_stamps import even_grid

DRIVES = ("torque", "force", "current", "voltage")
# In the order in which they are tried: the spelling of a unit within a name, its quantity, and the unit of a study.
_UNITS = (
    (r"rad(/|_?per_?|_)s(ec)?(\^?2|²)", "acceleration", "rad/s^2"), (r"deg(/|_?per_?|_)s(ec)?(\^?2|²)", "acceleration",
    "deg/s^2"), (r"m(/|_?per_?)s(\^?2|²)", "acceleration", "m/s^2"), (r"rad(/|_?per_?|_)s", "velocity", "rad/s"),
    (r"deg(/|_?per_?|_)s", "velocity", "deg/s"), (r"rpm|1/min", "velocity", "rpm"), (r"mm(/|_?per_?)s", "velocity",
    "mm/s"), (r"m(/|_?per_?)s", "velocity", "m/s"), (r"deg|°", "position", "deg"), (r"m?rad", "position", "rad"),
    (r"mm", "position", "mm"), (r"n\*?m", "torque", "N*m"), (r"ma", "current", "mA"), (r"amps?", "current", "A"),
    (r"g[\])]?$", "acceleration", "g"), (r"kn[\])]?$", "force", "kN"), (r"n[\])]?$", "force", "N"),
    (r"[\[(]a[\])]", "current", "A"), (r"[\[(]v[\])]", "voltage", "V"),
)  # fmt: skip
_WORDS = {
    "temperature": r"temp.*", "torque": r"\w*torques?|tau|\w*trq|tq|\w*moment|\w*efforts?",
    "force": r"\w*forces?|\w*kraft|f|hammer|shaker", "current": r"\w*currents?|curr?|\w*strom|iq|i",
    "voltage": r"volt.*|vir|vdc",
    "acceleration": r"\w*acc(el\w*)?|qdd|ddq|\w*beschl.*", "velocity":
    r"\w*vel(oc\w*)?|\w*speeds?|omega|qd|dq|w|v|\w*geschw.*|\w*drehzahl",
    "position": r"\w*pos(i\w*)?|\w*angles?|ang|theta|phi|\w*winkel|enc.*|q|qm|qg|\w*lage|axis",
}  # fmt: skip
_MEASURED = r"act.*|meas.*|mea|ist.*|adx?|fb|fdb|mot|motor|qm"
_UNIT_WORDS = r"nm|rad|deg|mm|rpm|hz"
_NOT_MEASURED = (
    r"ref.*|cmd.*|command.*|des|desired.*|soll.*|set.*|target.*|ff|err.*|rel|"
    "model|init|kin|dyn|traj|qg|simple|follow.*"
)


@dataclass(frozen=True)
class ChannelGuess:
    """One signal, its quantity and its unit (empty where unknown), and the reasons.

    rank: how much its name speaks for a measured signal.  sign: against its torque.  scale: of its numbers to the unit.
    """

    name: str
    column: int | None
    quantity: str
    unit: str
    rank: int
    why: str
    sign: int = 1
    scale: float = 1.0

    @property
    def key(self) -> tuple[str, int | None]:
        """Name and column, which no two signals of a log share."""
        return self.name, self.column

    @property
    def parts(self) -> tuple[str, str]:
        """The name without what tells joints apart, and that: numbers, else the last word that is no quantity's."""
        bare = re.sub(r"[\[(][^\])\d]*[a-z°][^\])]*[\])]", "", self.name, flags=re.IGNORECASE).strip()
        numbers = [*re.findall(r"\d+", bare), *([str(self.column)] if self.column else [])]
        if numbers:
            return re.sub(r"\d+", "#", bare), " ".join(numbers)
        words = re.findall(r"[^\W\d_]+", _split(bare))
        of_quantity = [word for word in words if re.fullmatch(_WORDS.get(self.quantity, ""), word.lower())]
        rest = f"{_MEASURED}|{_NOT_MEASURED}|{_UNIT_WORDS}"
        words = [w for w in words if w not in of_quantity[:1] and not re.fullmatch(rest, w.lower())]
        if not words:
            return bare, ""
        return re.sub(rf"(?<![A-Za-z]){words[-1]}(?![a-z])|(?<=[a-z]){words[-1]}(?![a-z])", "#", bare), words[-1]

    @property
    def place(self) -> str:
        """The name of a place in a study without a robot, without the unit behind it."""
        name = re.sub(r"(?<=\w)\s*[\[(][^\])]*[\])]\s*$", "", self.name) if self.unit else self.name
        return " ".join(filter(None, (re.sub(r"[^\w]+", " ", name).strip(), str(self.column or ""))))


def _split(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)


def guess_by_name(name: str, column: int | None, unit: str = "") -> ChannelGuess:
    """The guess of a channel by its name and the unit that its file states."""
    lower = _split(name).lower()
    words = [w for w in re.split(r"[^a-z°]+", lower) if w]
    rank = sum(bool(re.fullmatch(_MEASURED, w)) - bool(re.fullmatch(_NOT_MEASURED, w)) for w in words)
    spelt = [(q, u) for spelling, q, u in _UNITS if re.search(rf"(?<![a-z]){spelling}(?![a-z])", lower)]
    if unit in TABLE:
        fitting = [(q, u) for q, u in QUANTITY_UNIT.items() if TABLE[unit][0] in (u, of_translation(u))]
        stated = [q for q, u in sorted(fitting, key=lambda each: each[1] != TABLE[unit][0])]  # N: a force first
        spelt = [(q, usual_spelling(unit)) for q in stated] or spelt
    if unit == "g" or (spelt and spelt[0][1] == "g"):
        return ChannelGuess(name, column, "acceleration", "m/s^2", rank, "in multiples of gravity", scale=9.80665)
    if spelt:
        return ChannelGuess(name, column, *spelt[0], rank, f"the unit {spelt[0][1]} is stated")
    for quantity, pattern in _WORDS.items():
        if any(re.fullmatch(pattern, word) for word in words):
            return ChannelGuess(name, column, quantity, "", rank, "by its name")
    return ChannelGuess(name, column, "", "", rank, "nothing in its name")


@dataclass(frozen=True)
class Doubt:
    """A doubt about a channel, by its place in the study's list, None for the rate of all; key: that is at fault."""

    channel: int | None
    key: str
    text: str


def doubts_by_names(channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """One signal as torque and motion, torques and motions that are exchanged, joints that are, units unlike all."""
    guesses = [guess_by_name(c.channel, c.column) for c in channels]
    for i, channel in enumerate(channels):
        for other in channels[:i]:
            is_one = (channel.channel, channel.column) == (other.channel, other.column)
            if is_one and channel.is_motion != other.is_motion and "t" not in (channel.role, other.role):
                text = f"{channel.name_in_file} is the {other.quantity} at {other.at}, and cannot be the"
                key = "channel" if channel.channel else "column"
                yield Doubt(i, key, f"{text} {channel.quantity} at {channel.at}, too")
        yield from _by_name(i, channel, guesses, channels)
    families: dict[tuple[str, str, str], list[int]] = {}
    for i, (channel, guess) in enumerate(zip(channels, guesses, strict=True)):
        if re.search(r"\d", channel.channel) and not re.fullmatch(r"column \d+", channel.channel):
            families.setdefault((guess.parts[0], channel.quantity, channel.role), []).append(i)
    for members in families.values():
        yield from _of_a_family(members, [guesses[i].parts[1] for i in members], channels)


def _by_name(
    i: int, channel: ChannelSpec, guesses: Sequence[ChannelGuess], channels: Sequence[ChannelSpec]
) -> Iterator[Doubt]:
    """A torque and a motion that are called as each other, and a unit that its heading states otherwise."""
    guess, has_word = guesses[i], re.search(r"[a-z]{2}", channel.channel, re.IGNORECASE) is not None
    taken = [g.name for g, c in zip(guesses, channels, strict=True) if c.role == "y" and g.quantity in DRIVES]
    taken = [name for name in taken if re.search(r"[a-z]{2}", name, re.IGNORECASE)]
    if channel.role == "u" and has_word and guess.quantity in MOTIONS and taken:
        text = f"{guess.name} is a {guess.quantity} by its name, and {taken[0]}, stated as a motion, a torque"
        yield Doubt(i, "channel", f"{text}: exchange them")
    unit = channel.unit or QUANTITY_UNIT[channel.quantity]
    in_brackets = re.search(r"[\[(][^\])]+[\])]\s*$", channel.channel) is not None and guess.unit in TABLE
    is_other = TABLE.get(unit) != TABLE.get(guess.unit) and channel.scale == 1 == guess.scale
    if in_brackets and channel.role == "y" and guess.quantity in MOTIONS and is_other:
        key = "unit" if guess.quantity == channel.quantity else "quantity"
        text = f"the heading {guess.name} says {guess.quantity} in {guess.unit}"
        yield Doubt(i, key, f"{text}, and not {channel.quantity} in {unit}")


def _of_a_family(members: Sequence[int], labels: Sequence[str], channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """Doubts on signals whose names differ by a number: one in another unit than all, two that are exchanged."""
    units = [channels[i].unit or QUANTITY_UNIT[channels[i].quantity] for i in members]
    sizes = [TABLE.get(unit, ("", 1.0)) for unit in units]
    for place, i in enumerate(members):
        others = {size for j, size in enumerate(sizes) if j != place}
        is_odd = len(others) == 1 and sizes[place] not in others and sizes[place][0] == sizes[place - 1][0]
        if len(members) > 2 and is_odd:
            j = 0 if place else 1
            text = f"{channels[i].name_in_file} is stated in {units[place]}, {channels[members[j]].name_in_file}"
            yield Doubt(i, "unit", f"{text} and the others in {units[j]}; a log has one unit for all joints")
    own = [re.sub(r"\D", "", channels[i].at) for i in members]
    if len(members) > 1 and sorted(own) == sorted(labels) and len({*own}) == len(own):
        for i, label, number in zip(members, labels, own, strict=True):
            if label != number:
                text = f"{channels[i].name_in_file} has number {label} in its name and is at {channels[i].at}"
                yield Doubt(i, "at", f"{text}; check the order of the channels")


# Of a clock: steps that differ from their median by more are none, and the share of them that may.
_MAX_STEP, _MAX_UNEVEN_SHARE = 1.0, 0.02
_MAX_SAMPLES = 1 << 14  # that suffice to tell signals apart
_MIN_SAMPLES = 100  # of a log
_MAX_RATE_SPREAD = 1.02  # of the rates that pairs of positions and velocities show
_MIN_KNOWN_SHARE = 2 / 3  # of a signal's samples, the others missing
_MAX_LEFT_BY_GRAVITY = 0.7  # of what is left of a torque without it
_MOTION_HZ = 3.0  # below which half of the power of a torque is that moves a robot, rather than shakes it

Values = Mapping[tuple[str, int | None], FloatArray]


@dataclass(frozen=True)
class JointGuess:
    """A torque, the motion at its motor, how the second explains the first, and if gravity takes part in that."""

    torque: ChannelGuess
    motion: ChannelGuess
    relation: TorqueRelation
    has_gravity: bool

    @property
    def slides(self) -> bool:
        """True if the unit of the motion is that of a translation."""
        return TABLE[self.motion.unit][0].startswith("m")


@dataclass(frozen=True)
class LogGuess:
    """The joints or inputs and outputs of a log.  is_motion: they move as robots do, so that friction can be found."""

    joints: tuple[JointGuess, ...]
    further: tuple[ChannelGuess, ...]
    is_motion: bool


def is_clock(x: FloatArray) -> bool:
    """True for a signal (n,) that rises as time stamps do, by steps that are alike but for a few gaps."""
    steps = np.diff(x)
    if len(x) < 20 or not np.isfinite(x).all() or not steps.min() > 0:
        return False
    usual = float(np.median(steps))
    return even_grid(x - x[0]) is not None or float(np.mean(np.abs(steps / usual - 1) > _MAX_STEP)) < _MAX_UNEVEN_SHARE


def signals_of(log: Log, most: int) -> list[tuple[ChannelGuess, FloatArray]]:
    """Signals (n,) of the usual length that change, matrices by their columns, with the guesses by their names."""
    shapes = {name: shape for name, shape in log.shapes().items() if max(shape) > 2}
    usual = Counter(max(shape) for shape in shapes.values() if max(shape) > _MIN_SAMPLES).most_common(1)
    stated = dict(zip(log.headings, log.units, strict=False)) if isinstance(log, TextLog) else {}
    result = []
    for name, shape in shapes.items():
        count = min(shape) if len(shape) > 1 else 1
        units = log.arrays[name].units if isinstance(log, ArrayLog) else stated.get(name, "")
        for column in range(1, count + 1) if usual and max(shape) == usual[0][0] else ():
            number = column if count > 1 else None
            try:
                x = values_of(log, [ChannelSpec("y", "any", name, number, quantity="position")], 0, most)[:, 0]
            except DataError:  # words, or two columns with one heading
                continue
            known = np.flatnonzero(np.isfinite(x))
            if len(known) > _MIN_KNOWN_SHARE * len(x) and np.ptp(x[known]) > 0:
                result.append((guess_by_name(name, number, units), np.interp(np.arange(len(x)), known, x[known])))
    return result


def rate_by_motions(signals: Sequence[tuple[ChannelGuess, FloatArray]]) -> float | None:
    """The rate in Hz at which velocities are the derivatives of positions, None where none of signals (n,) are."""
    si = [x[: 2 * _MAX_SAMPLES] * TABLE[guess.unit][1] if guess.unit in TABLE else x for guess, x in signals]
    rates = [rate for _, rate in velocities(si).values()]
    return float(np.median(rates)) if rates and max(rates) < _MAX_RATE_SPREAD * min(rates) else None


def guess_log(signals: Sequence[tuple[ChannelGuess, FloatArray]], rate_hz: float) -> LogGuess | None:
    """The joints of a log, each a torque and its motion; None where nothing says which signals are."""
    values, guesses = {g.key: x for g, x in signals}, [g for g, _ in signals]
    drives, motions = _best_family(guesses, DRIVES), _best_family(guesses, MOTIONS)
    if bool(drives) != bool(motions):
        drives, motions = _completed(drives, motions, [g for g, x in signals if not is_clock(x)])
    if not drives:
        return None
    given, slides = motions[0].quantity, all(g.quantity == "force" for g in drives)
    speeds = {g.parts[1]: g for g in _best_family([g for g in guesses if g.quantity == "velocity"], MOTIONS)}
    motions = [_with_unit(m, speeds.get(m.parts[1]), values, rate_hz, slides) for m in motions]
    if in_deg := next((m.name for m in motions if m.unit == "deg"), ""):  # one unit for all
        motions = [replace(m, unit="deg", why=f"deg as {in_deg}") if "assumed" in m.why else m for m in motions]
    by_label = {m.parts[1]: m for m in motions}
    paired = [by_label.get(d.parts[1], motions[min(i, len(motions) - 1)]) for i, d in enumerate(drives)]
    joints = [_joint(*pair, values, rate_hz) for pair in zip(drives, paired, strict=True)]
    taken = {joint.motion.key for joint in joints}
    is_structure = all(g.quantity == "force" for g in drives) and len(drives) < len(motions)
    alike = MOTIONS if is_structure else (given,)
    others = [*motions, *(g for g in guesses if g.quantity in alike and g.rank >= 0)]
    others = list({g.key: _with_unit(g, None, values, rate_hz, slides) for g in others if g.key not in taken}.values())
    slow = all(_median_hz(values[j.torque.key], rate_hz) < _MOTION_HZ for j in joints)
    return LogGuess(tuple(joints), tuple(others), slow and given == "position")


def _completed(
    drives: list[ChannelGuess], motions: list[ChannelGuess], guesses: Sequence[ChannelGuess]
) -> tuple[list[ChannelGuess], list[ChannelGuess]]:
    """Drives and motions, of which one is missing: signals whose names say nothing, of the joints of the others.

    A force without a motion is that of a hammer or a shaker, and what else is in its log are accelerations.
    """
    labels, unknown = [g.parts[1] for g in drives or motions], [g for g in guesses if not g.quantity]
    families = [[g for g in unknown if g.parts[0] == name] for name in dict.fromkeys(g.parts[0] for g in unknown)]
    own = [each for each in families if sorted(g.parts[1] for g in each) == sorted(labels)]
    is_structure = bool(drives) and drives[0].quantity == "force" and len(drives) < len(unknown)
    if not unknown or not (own or is_structure):
        return [], []
    quantity = "torque" if motions else "acceleration" if is_structure else "position"
    members = unknown if is_structure else max(own, key=lambda family: family[0].rank)
    found = [
        replace(g, quantity=quantity, why=f"its name says nothing: a {quantity}, by those beside it") for g in members
    ]
    return (drives, found) if drives else (found, motions)


def _best_family(guesses: Sequence[ChannelGuess], order: Sequence[str]) -> list[ChannelGuess]:
    """The channels of one family: of the first quantity, measured by their names, stated with a unit."""
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
    """A motion with a unit: by its velocity's, by its travel, or SI; slides: its drive is a force."""
    if motion.unit:
        return motion
    x = values[motion.key]
    if speed is not None and motion.quantity == "position":
        relation = next(r for r in motion_relations(x, values[speed.key], rate_hz) if r.order == 1)
        size = abs(relation.gain) * (TABLE[speed.unit][1] if speed.unit else 1.0)
        if abs(relation.correlation) > MIN_CORRELATION and abs(np.log(max(size, 1e-300) * 180 / np.pi)) < 0.1:
            return replace(motion, unit="deg", why=f"deg by its derivative, {speed.name}")
    if motion.quantity == "position" and not slides and travel(x) > 8 * np.pi:
        return replace(motion, unit="deg", why=f"{motion.why}; deg since it covers {travel(x):.3g}")
    unit = QUANTITY_UNIT[motion.quantity]
    unit = of_translation(unit) if slides else unit
    return replace(motion, unit=unit, why=f"{motion.why}; {unit} is assumed")


def _joint(drive: ChannelGuess, motion: ChannelGuess, values: Values, rate_hz: float) -> JointGuess:
    """A torque and its motion, with the sign by which inertia and friction are positive."""
    y, order = values[motion.key] * TABLE[motion.unit][1], MOTIONS.index(motion.quantity)
    best, plain = (torque_relation(values[drive.key], y, order, rate_hz, turns) for turns in (True, False))
    if best.is_against_motion:
        motion = replace(motion, sign=-1, why=f"{motion.why}; sign -1 since inertia and friction are positive so")
    motion = replace(motion, why=f"{motion.why}; it explains {100 * best.explained:.0f} % of {drive.name}")
    return JointGuess(drive, motion, best, 1 - best.explained < _MAX_LEFT_BY_GRAVITY * (1 - plain.explained))


def _median_hz(x: FloatArray, rate_hz: float) -> float:
    """The frequency below which half of the power of a signal (n,) is."""
    power = np.cumsum(np.abs(np.fft.rfft(x - x.mean())) ** 2)
    return float(np.searchsorted(power, 0.5 * power[-1]) * rate_hz / len(x))
