"""Channels of a log by their names: quantity, unit, joint, and whether the signal is measured."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TypeAlias

from elastid.base.units import dimension_and_size
from elastid.logs.headings import unit_of_heading, unit_of_text

_WORDS = {
    "temperature": r"temp(erat\w*)?", "torque":
    r"\w*torques?|tau|\w*trq|tq|\w*moment|\w*efforts?|couple|coppia|koppel",
    "force": r"\w*forces?|\w*kraft|f|hammer|shaker", "current": r"\w*currents?|(ma)?curr?|\w*strom|is?q|i",
    "voltage": r"volt.*|vir|vdc",
    "acceleration": r"\w*acc(el\w*)?|qdd|ddq|\w*beschl.*", "velocity":
    r"\w*vel(oc\w*)?|\w*speeds?|omega|qd|dq|w|v|\w*geschw.*|\w*drehzahl|vitesse",
    "position": r"\w*pos(i\w*)?|\w*angles?|ang|theta|phi|\w*winkel|enc.*|q|qm|qg|\w*lage|axis|joints?|"
    "ak|[ar]korr"
}  # fmt: skip
_MEASURED = r"act.*|aipos|meas.*|mea|ist.*|adx?|fb|fdb|mot|motor|qm"
_UNIT_WORDS = r"[mk]?nm|m?rad|deg|mm|rpm|hz|inc|rev|counts?|ticks?|arms|ma"
_NOT_MEASURED = (
    r"ref.*|cmd.*|command.*|aspos|ak|[ar]korr|d|des|desired.*|soll.*|set.*|target.*|ff|err.*|rel|"
    "model|init|kin|dyn|traj|qg|simple|follow.*"
)
_COMMON = rf"{_MEASURED}|{_NOT_MEASURED}|{_UNIT_WORDS}|joints?|ax[ei]s|sensor|jts|link|load"

STANDARD_GRAVITY = 9.80665  # m/s^2
DRIVES = ("torque", "force", "current", "voltage")
ChannelKey: TypeAlias = tuple[str, int | None, int]


@dataclass(frozen=True)
class ChannelGuess:
    """Guess of quantity and unit (empty if unknown) of one signal, with the reasons (why).

    rank: number of words in its name for a measured signal minus words against it.  sign: relative to its torque.
    scale: factor from its values to the unit.  ratio: gear ratio of a motor-side signal, else 1.  rate_hz: None for the
    rate of the log.  file: 1 or 2, file of the measurement.  by_words: True if words and numbers identify its joint.
    """

    name: str
    column: int | None
    quantity: str
    unit: str
    rank: int
    why: str
    sign: int = 1
    scale: float = 1.0
    ratio: float = 1.0
    rate_hz: float | None = None
    file: int = 1
    by_words: bool = False

    @property
    def to_si(self) -> float:
        """Factor from the values of a motion, or of a link-side torque, to SI on the link side."""
        return self.sign * self.scale * dimension_and_size(self.unit)[1] / self.ratio

    @property
    def slides(self) -> bool:
        """True for a translation."""
        return dimension_and_size(self.unit)[0].startswith("m")

    @property
    def key(self) -> ChannelKey:
        """Unique key of a signal in a measurement: name, column and file."""
        return self.name, self.column, self.file

    @property
    def family(self) -> str:
        """Name without the identifier of its joint: the same for all joints."""
        return self._family_and_label()[0]

    @property
    def joint_label(self) -> str:
        """Identifier of its joint in the name: numbers, else words that are no quantity."""
        return self._family_and_label()[1]

    def _family_and_label(self) -> tuple[str, str]:
        bare = re.sub(r"[\[(][^\])\d]*[a-z°][^\])]*[\])]", "", self.name, flags=re.IGNORECASE).strip()
        bare = re.sub(r"0[.,]1\s*%", "", bare)  # of the rated torque
        words = [*re.findall(r"[^\W\d_]+|\d+", _split(bare)), *([str(self.column)] if self.column else [])]
        if (numbers := [*filter(str.isdecimal, words)]) and not self.by_words:
            return re.sub(r"\d+", "#", bare), " ".join(numbers)
        nouns = [word for word in words if re.fullmatch(_WORDS.get(self.quantity, ""), word.lower())]
        labels = [w for w in words if w not in nouns and not re.fullmatch(_COMMON, w.lower())] or nouns[1:]
        common = ["#" if word in labels else word for word in words]
        return " ".join(word for word, _ in groupby(common)), " ".join(labels)

    @property
    def is_torque_sensor(self) -> bool:
        """True for a torque that may be measured behind the gear, by its name."""
        name_words = set(re.split(r"[^a-z]+", _split(self.name).lower()))
        return self.quantity == "torque" and bool(name_words & {"sensor", "jts", "link"} or {"tau", "j"} <= name_words)

    @property
    def place(self) -> str:
        """The name of a place in a study without a robot, without the unit behind it."""
        name = re.sub(r"(?<=\w)\s*[\[(][^\])]*[\])]\s*$", "", self.name) if self.unit else self.name
        name = re.sub(r"^(\d+r?[xyz]) \d+$", r"\1", name)  # another function of a node of a universal file
        return " ".join(filter(None, (re.sub(r"[^\w]+", " ", name).strip(), str(self.column or "")))) or "signal"


def _split(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)


def guess_by_name(name: str, column: int | None, unit: str = "") -> ChannelGuess:
    """Return the guess of a channel by its name and the unit that its file states."""
    words = [w for w in re.split(r"[^a-z°]+", _split(name).lower()) if w]
    rank = sum(bool(re.fullmatch(_MEASURED, w)) - bool(re.fullmatch(_NOT_MEASURED, w)) for w in words)
    parsed = unit_of_heading(name, unit)
    matches = (quantity for quantity, pattern in _WORDS.items() if any(re.fullmatch(pattern, word) for word in words))
    quantity = parsed.quantity or next(matches, "")
    why = f"the unit {parsed.unit} is stated" if parsed.unit else "by its name" if quantity else "nothing in its name"
    why = f"? {parsed.remedy}" if parsed.unknown else why
    if parsed.unit and dimension_and_size(unit_of_text(unit) or parsed.unit) != dimension_and_size(parsed.unit):
        why = f"? the heading says {parsed.unit}, and the unit of the column is {unit}"
    if parsed.unit == "g":  # of gravity
        return ChannelGuess(name, column, quantity, "m/s^2", rank, why, scale=STANDARD_GRAVITY)
    return ChannelGuess(name, column, quantity, parsed.unit, rank, why)


def label_by_words(guesses: Sequence[ChannelGuess]) -> list[ChannelGuess]:
    """Identify joints by words and numbers if more joints then have signals of two kinds: wrist_1_pos, elbow_pos."""
    by_words = [replace(guess, by_words=True) for guess in guesses]
    return by_words if _n_joints(by_words) > _n_joints(guesses) else list(guesses)


def _n_joints(guesses: Sequence[ChannelGuess]) -> int:
    """Count the joints that two kinds of signals have in common."""
    families: dict[tuple[str, str, bool], set[str]] = {}
    for guess in guesses:
        families.setdefault((guess.family, guess.quantity, guess.rank < 0), set()).add(guess.joint_label)
    counts = Counter(map(frozenset, families.values()))
    return max((len(joints) for joints, count in counts.items() if count > 1), default=0)
