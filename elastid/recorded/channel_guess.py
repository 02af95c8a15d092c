"""Guesses of the channels of a log: quantity and unit by name, joint, sign and unit by kinematics and Newton's law.

Of logs without headings, or with such that say nothing: by what the signals hold, all as they are behind one Gaussian.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.units import TABLE, of_translation, usual_spelling
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec
from elastid.recorded.evidence import (
    NO_RELATION,
    WIDTHS,
    TorqueRelation,
    derivative,
    motion_relations,
    torque_relation,
    travel,
)
from elastid.recorded.files.formats import values_of
from elastid.recorded.files.log import ArrayLog, Log
from elastid.recorded.files.text import TextLog
from elastid.recorded.repair.time_stamps import even_grid

_WIDTH = WIDTHS[1]
_MAX_ROWS = 16  # of one sample: the joints of two arms
# Change from one sample to the next of a signal that is smooth, over that within a sample of several rows.
_MAX_SMOOTH = 0.05
# Of a clock: steps that differ from their median by more are none, and the share of them that may.
_MAX_STEP, _MAX_UNEVEN_SHARE = 1.0, 0.02
_MIN_CORRELATION = 0.98  # of a derivative with the signal that is it
_MIN_EXPLAINED = 0.75  # share of a torque that the motion of its joint explains
_MAX_SAMPLES = 1 << 15  # that suffice for a guess


@dataclass(frozen=True)
class MotionGuess:
    """Places, among some signals, of a torque, the position that explains it, and the velocity of that (or None)."""

    torque: int
    position: int
    velocity: int | None
    explained: float


def rows_of_a_sample(values: FloatArray) -> int:
    """How many rows of a table (n, c) make one sample: 1, or as many as lie between values that follow each other."""
    change = [np.nan_to_num(np.nanmean((values[k:] - values[:-k]) ** 2, axis=0)) for k in range(1, _MAX_ROWS + 1)]
    moving = change[0] > 0
    if len(values) < 20 * _MAX_ROWS or not moving.any():
        return 1
    shares = [float(np.max(each[moving] / change[0][moving])) for each in change]
    best = int(np.argmin(shares[1:])) + 2
    return best if shares[best - 1] < _MAX_SMOOTH and len(values) % best == 0 else 1


def is_clock(x: FloatArray) -> bool:
    """True for a signal (n,) that rises as time stamps do, by steps that are alike but for a few gaps."""
    steps = np.diff(x)
    if len(x) < 20 or not np.isfinite(x).all() or not steps.min() > 0:
        return False
    usual = float(np.median(steps))
    return even_grid(x - x[0]) is not None or float(np.mean(np.abs(steps / usual - 1) > _MAX_STEP)) < _MAX_UNEVEN_SHARE


def motions_in(signals: Sequence[FloatArray]) -> tuple[tuple[MotionGuess, ...], tuple[float, ...]]:
    """The joints whose torque, position and velocity are among signals (n,), by place, and rates in Hz.

    Rates are those at which each velocity is the derivative of its position, in the same unit.
    """
    if not signals or len(signals[0]) < 40 * _WIDTH:
        return (), ()
    X = np.stack([x[:_MAX_SAMPLES] for x in signals], axis=1)
    smooth, speed, change = (np.stack([derivative(x, k, 1.0, _WIDTH) for x in X.T], axis=1) for k in (0, 1, 2))
    velocity_of, rates = _velocities(smooth, speed)
    derived = set(velocity_of.values())
    found = [
        MotionGuess(j, i, velocity_of.get(i), explained)
        for i in range(X.shape[1])
        if i not in derived
        for j, explained in _explained(smooth, speed[:, i], change[:, i], i)
        if j not in derived | set(velocity_of)
    ]
    result: list[MotionGuess] = []
    for guess in sorted(found, key=lambda g: (g.velocity is None, -round(g.explained, 2), g.position)):
        if all(len({guess.torque, guess.position} & {other.torque, other.position}) == 0 for other in result):
            result.append(guess)
    return tuple(sorted(result, key=lambda g: g.position)), tuple(rates)


def _velocities(smooth: FloatArray, speed: FloatArray) -> tuple[dict[int, int], list[float]]:
    """The place of the velocity of each position that has one, and their ratio to the change from sample to sample."""
    a, b = (x - x.mean(axis=0) for x in (speed, smooth))
    size = np.maximum(np.linalg.norm(a, axis=0)[:, None] * np.linalg.norm(b, axis=0), 1e-300)
    rho = (a.T @ b) / size
    pairs = {i: int(np.argmax(row)) for i, row in enumerate(rho) if row.max() > _MIN_CORRELATION}
    # A velocity has an acceleration where it is logged too, and is no position then.
    pairs = {i: j for i, j in pairs.items() if i not in pairs.values()}
    return pairs, [float(np.linalg.norm(b[:, j]) / np.linalg.norm(a[:, i])) for i, j in pairs.items()]


def _explained(smooth: FloatArray, v: FloatArray, a: FloatArray, i: int) -> list[tuple[int, float]]:
    """The signals that a position explains as torques, by positive inertia and friction, and their shares."""
    q, s = smooth[:, i], np.sign(v) * (np.abs(v) > 1e-3 * np.abs(v).max())
    turn = np.pi / 180 if np.ptp(q) > 8 * np.pi else 1.0
    A = np.stack([a, v, s, np.ones_like(v), np.cos(turn * q), np.sin(turn * q)], axis=1)
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    theta = np.linalg.lstsq(A / size, smooth, rcond=1e-9)[0]
    total = np.maximum(np.var(smooth, axis=0), 1e-300)
    share = 1 - np.var(smooth - (A / size) @ theta, axis=0) / total
    friction = A[:, 1:3] / size[1:3] @ theta[1:3]
    is_torque = (theta[0] > 0) & (v @ friction > 0) & (share > _MIN_EXPLAINED)
    return [(int(j), float(share[j])) for j in np.flatnonzero(is_torque) if j != i]


DRIVES = ("torque", "force", "current", "voltage")
# In the order in which they are tried: the spelling of a unit within a name, its quantity, and the unit of a study.
_UNITS = (
    (r"rad(/|_?per_?|_)s(ec)?(\^?2|²)", "acceleration", "rad/s^2"), (r"deg(/|_?per_?|_)s(ec)?(\^?2|²)", "acceleration",
    "deg/s^2"), (r"m(/|_?per_?)s(\^?2|²)", "acceleration", "m/s^2"), (r"rad(/|_?per_?|_)s", "velocity", "rad/s"),
    (r"deg(/|_?per_?|_)s", "velocity", "deg/s"), (r"rpm|1/min", "velocity", "rpm"), (r"mm(/|_?per_?)s", "velocity",
    "mm/s"), (r"m(/|_?per_?)s", "velocity", "m/s"), (r"deg|°", "position", "deg"), (r"m?rad", "position", "rad"),
    (r"mm", "position", "mm"), (r"n\*?m", "torque", "N*m"), (r"ma", "current", "mA"), (r"amps?", "current", "A"),
    (r"g", "acceleration", "g"), (r"[\[(]n[\])]", "force", "N"),
    (r"[\[(]a[\])]", "current", "A"), (r"[\[(]v[\])]", "voltage", "V"),
)  # fmt: skip
_WORDS = {
    "temperature": r"temp.*", "torque": r"torques?|tau|trq|\w*moment|efforts?",
    "force": r"forces?|\w*kraft|f|hammer|shaker", "current": r"currents?|curr|\w*strom|iq|i",
    "voltage": r"volt.*|vir|vdc",
    "acceleration": r"acc.*|qdd|ddq|\w*beschl.*", "velocity": r"vel.*|speeds?|omega|qd|dq|w|v|\w*geschw.*|\w*drehzahl",
    "position": r"pos.*|angles?|theta|phi|\w*winkel|enc.*|q|qm|qg|x|\w*lage",
}  # fmt: skip
_MEASURED = r"act|actual|meas|measured|ist|adx?|fb|mot|motor|qm"
_NOT_MEASURED = r"ref.*|cmd|command|des|desired|soll|set|target|ff|err.*|rel|model|init|kin|dyn|traj|qg|simple"
_MIN_SAMPLES = 100  # of a log
_MAX_RATE_SPREAD = 1.02  # of the rates that pairs of positions and velocities show
_MIN_KNOWN_SHARE = 2 / 3  # of a signal's samples, the others missing
_MAX_LEFT_BY_GRAVITY = 0.7  # of what is left of a torque without it
_MAX_SLOW_CORRELATION = 0.999  # of neighbouring samples of an excitation
_MOTION_HZ = 3.0  # below which half of the power of a torque is that moves a robot, rather than shakes it


@dataclass(frozen=True)
class ChannelGuess:
    """One signal, its quantity and its unit (empty where unknown), and the reasons.

    rank: how much its name speaks for a measured signal.  confidence: from 0 to 1.  sign: against its torque.
    scale: of its numbers to the unit.  file: that it is in, of those of one measurement.
    """

    name: str
    column: int | None
    quantity: str
    unit: str
    rank: int
    confidence: float
    why: str
    sign: int = 1
    scale: float = 1.0
    file: int = 1

    @property
    def family(self) -> str:
        """The name without numbers, which the channels of several joints share."""
        return re.sub(r"\d+", "#", self.name)

    @property
    def place(self) -> str:
        """The name of a place in a study without a robot, without the unit behind it."""
        name = re.sub(r"(?<=\w)\s*[\[(][^\])]*[\])]\s*$", "", self.name) if self.unit else self.name
        return " ".join(filter(None, (re.sub(r"[^\w]+", " ", name).strip(), str(self.column or ""))))


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


def guess_by_name(name: str, column: int | None, unit: str = "") -> ChannelGuess:
    """The guess of a channel by its name and the unit that its file states."""
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    lower, words = split.lower(), [w for w in re.split(r"[^a-z°]+", split.lower()) if w]
    rank = sum(bool(re.fullmatch(_MEASURED, w)) - bool(re.fullmatch(_NOT_MEASURED, w)) for w in words)
    spelt = [(q, u) for spelling, q, u in _UNITS if re.search(rf"(?<![a-z]){spelling}(?![a-z])", lower)]
    if unit in TABLE:
        fitting = [(q, u) for q, u in QUANTITY_UNIT.items() if TABLE[unit][0] in (u, of_translation(u))]
        stated = [q for q, u in sorted(fitting, key=lambda each: each[1] != TABLE[unit][0])]  # N: a force first
        spelt = [(q, usual_spelling(unit)) for q in stated] or spelt
    if unit == "g" or (spelt and spelt[0][1] == "g"):
        return ChannelGuess(name, column, "acceleration", "m/s^2", rank, 0.9, "in multiples of gravity", scale=9.80665)
    if spelt:
        return ChannelGuess(name, column, *spelt[0], rank, 0.95, f"the unit {spelt[0][1]} is stated")
    for quantity, pattern in _WORDS.items():
        if any(re.fullmatch(pattern, word) for word in words):
            return ChannelGuess(name, column, quantity, "", rank, 0.8, "by its name")
    return ChannelGuess(name, column, "", "", rank, 0.0, "nothing in its name")


def signals_of(log: Log, most: int) -> list[tuple[ChannelGuess, FloatArray]]:
    """Each signal (n,) of the usual length that changes, matrices by their columns, with the guess by its name."""
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


def rate_by_motions(signals: Sequence[tuple[ChannelGuess, FloatArray]], least: int = 1) -> float | None:
    """The rate in Hz at which velocities are the derivatives of positions, None where none of signals (n,) are.

    least: so many of them must agree; one alone may be another signal of a resonance.
    """
    rates = motions_in([x * TABLE[guess.unit][1] if guess.unit in TABLE else x for guess, x in signals])[1]
    is_one = len(rates) >= least and max(rates) < _MAX_RATE_SPREAD * min(rates)
    return float(np.median(rates)) if is_one else None


def guess_log(signals: Sequence[tuple[ChannelGuess, FloatArray]], rate_hz: float) -> LogGuess | None:
    """The joints of a log, each a torque and its motion; None where nothing says which signals are."""
    values = {(g.name, g.column): x for g, x in signals}
    drives = _best_family([g for g, _ in signals if g.quantity in DRIVES], DRIVES)
    motions = _best_family([g for g, _ in signals if g.quantity in MOTIONS], MOTIONS)
    if len(drives) == 1:
        drives, motions = _by_labels([g for g, _ in signals]) or (drives, motions)
    if not drives or not motions:
        drives, motions = _by_content([(g, x) for g, x in signals if g.confidence == 0])
    if not drives:
        return None
    given = motions[0].quantity
    velocities = _best_family([g for g, _ in signals if g.quantity == "velocity"], MOTIONS)
    slides = all(g.quantity == "force" for g in drives)
    motions = _alike([_with_unit(m, velocities[i : i + 1], values, rate_hz, slides) for i, m in enumerate(motions)])
    joints = [_joint(drive, motions, i, values, rate_hz) for i, drive in enumerate(drives)]
    taken = [joint.motion for joint in joints]
    others = [_with_unit(g, (), values, rate_hz, slides) for g, _ in signals if g.quantity == given and g.rank >= 0]
    further = [g for g in others if all((g.name, g.column) != (t.name, t.column) for t in taken)]
    slow = all(_median_hz(values[j.torque.name, j.torque.column], rate_hz) < _MOTION_HZ for j in joints)
    return LogGuess(tuple(joints), tuple(further), slow and motions[0].quantity == "position")


def _by_content(signals: Sequence[tuple[ChannelGuess, FloatArray]]) -> tuple[list[ChannelGuess], list[ChannelGuess]]:
    """Torques and motions among signals (n,) whose names say nothing; none of them where nothing else does."""
    signals = [(g, x) for g, x in signals if not is_clock(x)]
    joints, _ = motions_in([x for _, x in signals])
    if joints:
        why = "no name says it: by Newton's law"
        drives = [replace(signals[j.torque][0], quantity="torque", confidence=0.5, why=why) for j in joints]
        whys = [why if j.velocity is None else f"its derivative is {signals[j.velocity][0].name}" for j in joints]
        motions = [
            replace(signals[j.position][0], quantity="position", confidence=0.5, why=each)
            for j, each in zip(joints, whys, strict=True)
        ]
        return drives, motions
    if len(signals) < 2 or _is_slow(signals[0][1]):
        return [], []
    why = "no name says it: the first column is taken as a torque, the second as an acceleration"
    first, second = (replace(g, confidence=0.1, why=why) for g, _ in signals[:2])
    return [replace(first, quantity="torque")], [replace(second, quantity="acceleration", unit="rad/s^2")]


def _is_slow(x: FloatArray) -> bool:
    """True for a signal (n,) that hardly changes from one sample to the next, as no excitation of a structure does."""
    return float(np.var(np.diff(x))) < 2 * (1 - _MAX_SLOW_CORRELATION) * float(np.var(x))


def _alike(motions: Sequence[ChannelGuess]) -> list[ChannelGuess]:
    """Motions of one family in one unit: where some are found to be in deg, all are that are only assumed not to be."""
    in_deg = [m for m in motions if m.unit == "deg"]
    why = f"deg as {in_deg[0].name}" if in_deg else ""
    return [
        replace(m, unit="deg", why=why) if in_deg and m.unit == "rad" and "assumed" in m.why else m for m in motions
    ]


def _best_family(guesses: Sequence[ChannelGuess], order: Sequence[str]) -> list[ChannelGuess]:
    """The channels of one family: of the first quantity, measured by their names, stated with a unit."""
    families: dict[str, list[ChannelGuess]] = {}
    for guess in guesses:
        families.setdefault(guess.family, []).append(guess)

    def merit(family: Sequence[ChannelGuess]) -> tuple[float, ...]:
        first = family[0]
        return (first.rank >= 0, -order.index(first.quantity), first.rank, first.confidence, len(family))

    return max(families.values(), key=merit, default=[])


def _by_labels(guesses: Sequence[ChannelGuess]) -> tuple[list[ChannelGuess], list[ChannelGuess]] | None:
    """Torques and motions of two joints or more that share words behind their quantity's: tau_elbow and q_elbow."""
    families: dict[tuple[str, ...], dict[str, ChannelGuess]] = {}
    for guess in guesses:
        words = re.findall(r"[^\W_]+", re.sub(r"\[.*", "", guess.name))
        at = [i for i, word in enumerate(words) if re.fullmatch(_WORDS.get(guess.quantity, ""), word.lower())]
        if at and guess.rank >= 0:
            key, label = (guess.quantity, *words[: at[0] + 1]), "_".join(words[at[0] + 1 :])
            families.setdefault(key, {})[label] = guess
    drives = [family for (quantity, *_), family in families.items() if quantity in ("torque", "force")]
    motions = [family for (quantity, *_), family in families.items() if quantity in MOTIONS]
    motions.sort(key=lambda family: MOTIONS.index(next(iter(family.values())).quantity))
    pairs = ((u, y, [label for label in u if label in y]) for y in motions for u in drives)
    return next((([u[k] for k in own], [y[k] for k in own]) for u, y, own in pairs if len(own) > 1), None)


def _with_unit(
    motion: ChannelGuess, velocities: Sequence[ChannelGuess], values: Mapping[tuple[str, int | None], FloatArray],
    rate_hz: float, slides: bool,
) -> ChannelGuess:  # fmt: skip
    """A motion with a unit: by its velocity's, by its travel, or SI; slides: its drive is a force."""
    if motion.unit:
        return motion
    x = values[motion.name, motion.column]
    for other in velocities if motion.quantity == "position" else ():
        speed = values[other.name, other.column]
        relation = next(r for r in motion_relations(x, speed, rate_hz) if r.order == 1)
        of_speed = TABLE[other.unit][1] if other.unit else 1.0
        if abs(relation.correlation) > 0.98 and abs(np.log(abs(relation.gain) * of_speed * 180 / np.pi)) < 0.1:
            return replace(motion, unit="deg", confidence=0.9, why=f"deg by its derivative, {other.name}")
    if motion.quantity == "position" and not slides and travel(x) > 8 * np.pi:
        return replace(motion, unit="deg", why=f"{motion.why}; deg since it covers {travel(x):.3g}")
    unit = QUANTITY_UNIT[motion.quantity]
    unit = of_translation(unit) if slides else unit
    return replace(motion, unit=unit, confidence=0.5 * motion.confidence, why=f"{motion.why}; {unit} is assumed")


def _joint(
    drive: ChannelGuess, motions: Sequence[ChannelGuess], i: int,
    values: Mapping[tuple[str, int | None], FloatArray], rate_hz: float,
) -> JointGuess:  # fmt: skip
    """The motion of a torque: that of the same number, unless another one explains the torque far better."""
    u = values[drive.name, drive.column]

    def relation(motion: ChannelGuess, turns: bool = True) -> TorqueRelation:
        y = values[motion.name, motion.column] * TABLE[motion.unit][1]
        return torque_relation(u, y, MOTIONS.index(motion.quantity), rate_hz, turns)

    relations = [relation(motion) for motion in motions] or [NO_RELATION]
    k = int(np.argmax([r.explained + 0.3 * (j == i) for j, r in enumerate(relations)]))
    best, motion = relations[k], motions[k]
    plain = relation(motion, turns=False)
    share = f"it explains {100 * best.explained:.0f} % of {drive.name}"
    if best.is_against_motion and best.explained > 0.75:
        motion = replace(motion, sign=-1, why=f"{motion.why}; sign -1 since inertia and friction are positive so")
    has_gravity = 1 - best.explained < _MAX_LEFT_BY_GRAVITY * (1 - plain.explained)
    return JointGuess(drive, replace(motion, why=f"{motion.why}; {share}"), best, has_gravity)


def _median_hz(x: FloatArray, rate_hz: float) -> float:
    """The frequency below which half of the power of a signal (n,) is."""
    power = np.cumsum(np.abs(np.fft.rfft(x - x.mean())) ** 2)
    return float(np.searchsorted(power, 0.5 * power[-1]) * rate_hz / len(x))
