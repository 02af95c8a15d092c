"""Names of channels: the quantity, unit and joint that they say, and channels that a study states otherwise."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from elastid.base.units import TABLE, of_translation, usual_spelling
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec

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
    file: that it is in, of those of one measurement.
    """

    name: str
    column: int | None
    quantity: str
    unit: str
    rank: int
    why: str
    sign: int = 1
    scale: float = 1.0
    file: int = 1

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
            is_one = (channel.file, channel.channel, channel.column) == (other.file, other.channel, other.column)
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
    """Of signals whose names differ by a number alone: one in another unit than all, and two that are exchanged."""
    units = [channels[i].unit or QUANTITY_UNIT[channels[i].quantity] for i in members]
    sizes = [TABLE.get(unit, ("", 1.0)) for unit in units]
    for place, i in enumerate(members):
        others = {size for j, size in enumerate(sizes) if j != place}
        if (
            len(members) > 2
            and len(others) == 1
            and sizes[place] not in others
            and sizes[place][0] == sizes[place - 1][0]
        ):
            j = 0 if place else 1
            text = (
                f"{channels[i].name_in_file} is stated in {units[place]}, {channels[members[j]].name_in_file} and the"
            )
            yield Doubt(i, "unit", f"{text} others in {units[j]}; a log has one unit for all joints")
    own = [re.sub(r"\D", "", channels[i].at) for i in members]
    if len(members) > 1 and sorted(own) == sorted(labels) and len({*own}) == len(own):
        for i, label, number in zip(members, labels, own, strict=True):
            if label != number:
                text = f"{channels[i].name_in_file} has number {label} in its name and is at {channels[i].at}"
                yield Doubt(i, "at", f"{text}; check the order of the channels")
