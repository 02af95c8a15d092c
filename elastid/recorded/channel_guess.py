r"""Channels of a log: guessed by names, units and the motions of one joint, and doubted where these contradict a study.

Signals whose names say nothing are those that the others lack. Motions are compared as derivatives of one Gaussian,
:math:`x^{(k)} = (G_s * x)^{(k)}`, at several widths s: :math:`b = g\, a^{(k)}`. The sign of a torque is that with which

.. math:: u = J a + f v + F_c\,\mathrm{sgn}(v) + o + c_1 \cos q + c_2 \sin q, \qquad J > 0, \quad f v^2 + F_c |v| > 0.

Only what cannot be otherwise is doubted: relations that agree to a few per cent, off by a known factor.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.units import TABLE, of_translation, units_of
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec, Places
from elastid.recorded.files.log import ArrayLog, Log
from elastid.recorded.files.text import TextLog
from elastid.recorded.headings import unit_of_heading
from elastid.recorded.link_side import link_side_factor, to_joints, value_refusals
from elastid.recorded.repair import Log as RepairLog
from elastid.recorded.repair import bridged
from elastid.recorded.repair.outliers import without_lone
from elastid.recorded.repair.time_stamps import even_grid
from elastid.robot import Joint, Robot

DRIVES = ("torque", "force", "current", "voltage")
_WORDS = {
    "temperature": r"temp.*", "torque": r"\w*torques?|tau|\w*trq|tq|\w*moment|\w*efforts?",
    "force": r"\w*forces?|\w*kraft|f|hammer|shaker", "current": r"\w*currents?|(ma)?curr?|\w*strom|is?q|i",
    "voltage": r"volt.*|vir|vdc",
    "acceleration": r"\w*acc(el\w*)?|qdd|ddq|\w*beschl.*", "velocity":
    r"\w*vel(oc\w*)?|\w*speeds?|omega|qd|dq|w|v|\w*geschw.*|\w*drehzahl",
    "position": r"\w*pos(i\w*)?|\w*angles?|ang|theta|phi|\w*winkel|enc.*|q|qm|qg|\w*lage|axis|joints?|"
    "ak|[ar]korr",
}  # fmt: skip
_MEASURED = r"act.*|aipos|meas.*|mea|ist.*|adx?|fb|fdb|mot|motor|qm"
_UNIT_WORDS = r"nm|rad|deg|mm|rpm|hz"
_NOT_MEASURED = (
    r"ref.*|cmd.*|command.*|aspos|ak|[ar]korr|d|des|desired.*|soll.*|set.*|target.*|ff|err.*|rel|"
    "model|init|kin|dyn|traj|qg|simple|follow.*"
)


@dataclass(frozen=True)
class ChannelGuess:
    """One signal, its quantity and its unit (empty where unknown), and the reasons.

    rank: how much its name speaks for a measured signal.  sign: against its torque.  scale: of its numbers to the unit.
    ratio: of the gear on whose motor's side it is, 1 on the link's.
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

    @property
    def to_si(self) -> float:
        """Factor from the numbers of a motion to SI on the link side."""
        return self.sign * self.scale * TABLE[self.unit][1] / self.ratio

    @property
    def key(self) -> tuple[str, int | None]:
        """Name and column, which no two signals of a log share."""
        return self.name, self.column

    @property
    def parts(self) -> tuple[str, str]:
        """Split a name into the common part and the joint's identifier: numbers, else the last other word."""
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
    stated = unit_of_heading(name, unit)
    if stated.unit == "g":
        return ChannelGuess(name, column, "acceleration", "m/s^2", rank, "in multiples of gravity", scale=9.80665)
    if stated.quantity:
        return ChannelGuess(name, column, stated.quantity, stated.unit, rank, f"the unit {stated.unit} is stated")
    question = f"? {stated.question}" if stated.unknown else ""
    for quantity, pattern in _WORDS.items():
        if any(re.fullmatch(pattern, word) for word in words):
            return ChannelGuess(name, column, quantity, "", rank, question or "by its name")
    return ChannelGuess(name, column, "", "", rank, question or "nothing in its name")


# Widths of the Gaussian in samples: the band up to a tenth of the rate, a fortieth, and a hundred-sixtieth.
WIDTHS = (2.0, 8.0, 32.0)
# Correlation of a derivative with the signal that is it.
MIN_CORRELATION = 0.98
# Share of a torque that the motion of its joint explains, at least.
MIN_EXPLAINED = 0.75
# Likewise of the acceleration alone, for a statement on the inertia.
MIN_BY_INERTIA = 0.2


@dataclass(frozen=True)
class MotionRelation:
    """b = gain a^(order) of two motions, and the correlation of both sides, with the sign of the gain."""

    order: int
    gain: float
    correlation: float


@dataclass(frozen=True)
class TorqueRelation:
    """Fraction of the variance of a torque that the motion of one joint explains, and the inertia J.

    inertia, largest_inertia: J in the band where it carries most of the torque, and its upper limit (three standard
    errors) over all bands where it carries enough, infinite without one, as where friction carries a slow motion.
    is_against_motion: J is negative, or friction gives power, and neither contradicts the other.
    """

    explained: float = 0.0
    inertia: float = 0.0
    largest_inertia: float = np.inf
    is_against_motion: bool = False

    def is_before_gear(self, joint: Joint, ratio: float, scale: float = 1.0) -> bool:
        """True if J / scale is below half the rotor's inertia as a link-side number, but not as a motor-side one."""
        rotor = 0.0 if joint.motor is None else joint.motor.inertia * ratio**2 * scale
        return 2 * self.largest_inertia < rotor < 2 * self.inertia * ratio**2


def derivative(x: FloatArray, order: int, rate_hz: float, width: float) -> FloatArray:
    """The derivative (n - 12 width,) of a signal (n,), smoothed by a Gaussian of a width in samples; -1: integral."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(x))
    gain = (1j * np.append(1.0, omega[1:])) ** order * np.exp(-((width * omega) ** 2) / 2)
    gain[0] = order == 0  # an integral has no mean
    margin = int(6 * width)  # a jump from the last sample to the first has no effect beyond
    return np.fft.irfft(np.fft.rfft(x) * gain, len(x))[margin:-margin] * rate_hz**order


def motion_relations(a: FloatArray, b: FloatArray, rate_hz: float) -> Iterator[MotionRelation]:
    """The relations of order -2 to 2 of two motions (n,), each at the width where both sides agree best."""
    for order in range(-2, 3):
        # Positions drift and keep offsets, so that velocities are compared.
        common = 1 if order == 0 else 0
        pairs = [
            (derivative(a, common + max(order, 0), rate_hz, s), derivative(b, common + max(-order, 0), rate_hz, s))
            for s in WIDTHS
            if len(a) > 20 * s
        ]
        results = [(correlation(x, y), float(np.std(y)) / max(float(np.std(x)), 1e-300)) for x, y in pairs]
        rho, size = max(results, key=lambda result: abs(result[0]))
        yield MotionRelation(order, float(np.sign(rho)) * size, rho)


def torque_relation(u: FloatArray, y: FloatArray, order: int, rate_hz: float, turns: bool = True) -> TorqueRelation:
    """How the motion y (n,), a derivative of the position of the given order, explains the torque u (n,).

    turns: the joint turns, so that gravity may change with its angle.
    """
    widths = [width for width in WIDTHS if len(u) > 20 * width and np.ptp(u) > 0]
    pairs = [_relation_at(u, y, order, rate_hz, width, turns) for width in widths]
    if not pairs:
        return TorqueRelation()
    best = max((relation for relation, _ in pairs), key=lambda relation: relation.explained)
    by_law = [(relation, by_inertia) for relation, by_inertia in pairs if relation.explained > MIN_EXPLAINED]
    limits = [relation.largest_inertia for relation, by_inertia in by_law if by_inertia > MIN_BY_INERTIA]
    inertia = max(pairs, key=lambda pair: pair[1])[0].inertia
    return replace(best, inertia=inertia, largest_inertia=max(limits, default=np.inf))


def _relation_at(
    u: FloatArray, y: FloatArray, order: int, rate_hz: float, width: float, turns: bool
) -> tuple[TorqueRelation, float]:
    """The relation in a band, and the fraction of the torque's variance that only the acceleration explains."""
    torque = derivative(u, 0, rate_hz, width)
    v, a = (derivative(y, k - order, rate_hz, width) for k in (1, 2))
    columns = [a, v, np.sign(v), np.ones_like(a)]
    q = derivative(y, -order, rate_hz, width) if turns and order < 2 else np.zeros(1)
    if np.ptp(q) > 0.3:  # from so many rad on gravity changes as a cosine
        columns += [np.cos(q), np.sin(q)]
    A, torque = np.stack(columns, axis=1)[:: int(width / 2)], torque[:: int(width / 2)]
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    theta = np.linalg.lstsq(A / size, torque, rcond=1e-9)[0] / size
    residual = torque - A @ theta
    explained = 1 - float(np.var(residual) / np.var(torque))
    alone = A[:, 0] - A[:, 1:] @ np.linalg.lstsq(A[:, 1:], A[:, 0], rcond=1e-9)[0]
    # Sandwich estimate with a window of ten samples: neighbouring residuals are correlated.
    score = alone * residual
    variance = score @ score + 2 * sum((1 - k / 10) * float(score[k:] @ score[:-k]) for k in range(1, 10))
    std = float(np.sqrt(max(variance, 0.0))) / max(float(alone @ alone), 1e-300)
    by_inertia = float(theta[0] ** 2 * np.var(alone) / np.var(torque))
    parts = (A[:, 0] * theta[0], A[:, 1:3] @ theta[1:3])
    signs = (np.sign(theta[0]), np.sign(np.mean(parts[1] * A[:, 1])))
    shares = [float(s * abs(np.cov(part, torque)[0, 1]) / np.var(torque)) for s, part in zip(signs, parts, strict=True)]
    is_against = explained > MIN_EXPLAINED and min(shares) < -0.3 and max(shares) < 0.1
    return TorqueRelation(explained, float(theta[0]), abs(float(theta[0])) + 3 * std, is_against), by_inertia


def travel(x: FloatArray) -> float:
    """The range of a signal (n,), single spikes left out."""
    return float(np.percentile(x, 99.9) - np.percentile(x, 0.1))


def correlation(x: FloatArray, y: FloatArray) -> float:
    """Correlation of two signals (n,); 0 where one is still."""
    x, y = x - x.mean(), y - y.mean()
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0 else 0.0


# Of a clock: steps that differ from their median by more are none, and the share of them that may.
_MAX_STEP, _MAX_UNEVEN_SHARE = 1.0, 0.02
_MIN_SAMPLES = 100  # of a log
_MIN_KNOWN_SHARE = 2 / 3  # of a signal's samples, the others missing
_MOTION_HZ = 3.0  # below which half of the power of a torque is that moves a robot, rather than shakes it

Values = Mapping[tuple[str, int | None], FloatArray]


@dataclass(frozen=True)
class JointGuess:
    """A torque, the motion at its motor, and how the second explains the first."""

    torque: ChannelGuess
    motion: ChannelGuess
    relation: TorqueRelation

    @property
    def slides(self) -> bool:
        """True if the motion has a unit of translation."""
        return TABLE[self.motion.unit][0].startswith("m")


@dataclass(frozen=True)
class LogGuess:
    """The joints or inputs and outputs of a log.

    is_motion: they move as robots do, so that friction can be found.  references: commanded positions of the joints.
    """

    joints: tuple[JointGuess, ...]
    further: tuple[ChannelGuess, ...]
    is_motion: bool
    references: tuple[ChannelGuess, ...] = ()


def is_clock(x: FloatArray) -> bool:
    """True for a signal (n,) that rises as time stamps do, by steps that are alike but for a few gaps."""
    steps = np.diff(x)
    if len(x) < 20 or not np.isfinite(x).all() or not steps.min() > 0:
        return False
    usual = float(np.median(steps))
    return even_grid(x) is not None or float(np.mean(np.abs(steps / usual - 1) > _MAX_STEP)) < _MAX_UNEVEN_SHARE


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
                x = log.values([ChannelSpec("y", "any", name, number, quantity="position")], slice(0, most))[:, 0]
            except DataError:  # words, or two columns with one heading
                continue
            x = _without_lone(x)
            if np.isfinite(x).sum() > _MIN_KNOWN_SHARE * len(x) and np.ptp(whole := bridged(x)) > 0:
                result.append((guess_by_name(name, number, units), whole))
    return result


def _without_lone(x: FloatArray) -> FloatArray:
    """Signal (n,) with NaN at single values far from their neighbours, such as a wrong cell."""
    whole = np.isfinite(x).all() and len(x) > _MIN_SAMPLES
    return without_lone(x[:, None], RepairLog("", ("",))).signals[:, 0] if whole else x


def guess_log(signals: Sequence[tuple[ChannelGuess, FloatArray]], rate_hz: float) -> LogGuess | None:
    """Guess the joints of a log, each with torque and motion channel; None if nothing identifies the channels."""
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
    measured = {g.key: g for g in (*(g for g in guesses if g.quantity in MOTIONS and g.rank >= 0), *motions)}
    alike = MOTIONS if slides and len(drives) < len(measured) else (given,)  # of a structure all of them
    further = [g for g in measured.values() if g.quantity in alike and g.key not in taken]
    further = [_with_unit(g, None, values, rate_hz, slides) for g in further]
    torques = np.stack([values[joint.torque.key] for joint in joints])
    power = np.cumsum(np.abs(np.fft.rfft(torques - torques.mean(axis=1, keepdims=True))) ** 2, axis=1)
    half_hz = np.argmax(power >= power[:, -1:] / 2, axis=1) * rate_hz / torques.shape[1]
    is_motion = bool(np.all(half_hz < _MOTION_HZ)) and given == "position"
    return LogGuess(tuple(joints), tuple(further), is_motion, _references(guesses, joints))


def _references(guesses: Sequence[ChannelGuess], joints: Sequence[JointGuess]) -> tuple[ChannelGuess, ...]:
    """Commanded positions by their names, one for each joint whose position is known; else none."""
    commanded = {g.parts[1]: g for g in _best_family([g for g in guesses if g.rank < 0], ("position",))}
    members = [commanded.get(joint.motion.parts[1]) for joint in joints if joint.motion.quantity == "position"]
    if len(members) < len(joints) or None in members:
        return ()
    return tuple(replace(g, unit=g.unit or joint.motion.unit) for g, joint in zip(members, joints, strict=True) if g)


def _completed(
    drives: list[ChannelGuess], motions: list[ChannelGuess], guesses: Sequence[ChannelGuess]
) -> tuple[list[ChannelGuess], list[ChannelGuess]]:
    """Drives and motions with one of them missing: signals without telling names, of the joints of the others.

    A force without a motion is that of a hammer or a shaker, and what else is in its log are accelerations.
    """
    labels, unknown = [g.parts[1] for g in drives or motions], [g for g in guesses if not g.quantity]
    families = [[g for g in unknown if g.parts[0] == name] for name in dict.fromkeys(g.parts[0] for g in unknown)]
    alike = [family for family in families if sorted(g.parts[1] for g in family) == sorted(labels)]
    is_structure = bool(drives) and drives[0].quantity == "force" and len(drives) < len(unknown)
    if not unknown or not (alike or is_structure):
        return [], []
    quantity = "torque" if motions else "acceleration" if is_structure else "position"
    members = unknown if is_structure else max(alike, key=lambda family: family[0].rank)
    why = f"its name identifies nothing; a {quantity} according to the channels next to it"
    guess = [replace(g, quantity=quantity, why=why) for g in members]
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
    """Motion channel with its unit from its velocity or range, SI by default. slides: its drive is a force."""
    if motion.unit:
        return motion
    x, is_counted = values[motion.key], motion.why.startswith("?")
    if speed is not None and motion.quantity == "position" and not is_counted:
        relation = next(r for r in motion_relations(x, values[speed.key], rate_hz) if r.order == 1)
        size = abs(relation.gain) * (TABLE[speed.unit][1] if speed.unit else 1.0)
        if abs(relation.correlation) > MIN_CORRELATION and abs(np.log(max(size, 1e-300) * 180 / np.pi)) < 0.1:
            return replace(motion, unit="deg", why=f"deg by its derivative, {speed.name}")
    if motion.quantity == "position" and not (slides or is_counted) and travel(x) > 8 * np.pi:
        return replace(motion, unit="deg", why=f"{motion.why}; deg since it covers {travel(x):.3g}")
    unit = QUANTITY_UNIT[motion.quantity]
    unit = of_translation(unit) if slides else unit
    return replace(motion, unit=unit, why=f"{motion.why}; {unit} is assumed")


def _joint(drive: ChannelGuess, motion: ChannelGuess, values: Values, rate_hz: float) -> JointGuess:
    y, order = values[motion.key] * TABLE[motion.unit][1], MOTIONS.index(motion.quantity)
    best = torque_relation(values[drive.key], y, order, rate_hz)
    if best.is_against_motion:
        motion = replace(motion, sign=-1, why=f"{motion.why}; sign -1 since inertia and friction are positive so")
    motion = replace(motion, why=f"{motion.why}; it explains {100 * best.explained:.0f} % of {drive.name}")
    return JointGuess(drive, motion, best)


@dataclass(frozen=True)
class Doubt:
    """A doubt about a channel, by its place in the study's list, None for the rate of all; key: that is at fault."""

    channel: int | None
    key: str
    text: str


def doubts_by_names(channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """One signal as torque and motion, torques and motions that are exchanged, joints that are, units unlike all."""
    guesses = [guess_by_name(c.channel, c.column) for c in channels]
    torques = [g.name for g, c in zip(guesses, channels, strict=True) if c.role == "y" and g.quantity in DRIVES]
    families: dict[tuple[str, str, str], list[int]] = {}
    for i, (channel, guess) in enumerate(zip(channels, guesses, strict=True)):
        for earlier in channels[:i]:
            is_one = (channel.channel, channel.column) == (earlier.channel, earlier.column)
            if is_one and channel.is_motion != earlier.is_motion and "t" not in (channel.role, earlier.role):
                text = f"{channel.name_in_file} is the {earlier.quantity} at {earlier.at}, and cannot be the"
                key = "channel" if channel.channel else "column"
                yield Doubt(i, key, f"{text} {channel.quantity} at {channel.at}, too")
        words = [n for n in (guess.name, *torques) if re.search(r"[a-z]{2}", n, re.IGNORECASE)]
        if channel.role == "u" and guess.quantity in MOTIONS and words[:1] == [guess.name] and words[1:]:
            text = f"{guess.name} is a {guess.quantity} by its name, and {words[1]}, stated as a motion, a torque"
            yield Doubt(i, "channel", f"{text}: exchange them")
        unit = channel.unit or QUANTITY_UNIT[channel.quantity]
        in_brackets = re.search(r"[\[(][^\])]+[\])]\s*$", channel.channel) is not None
        is_same_kind = (guess.quantity in MOTIONS and channel.role == "y") or guess.quantity == channel.quantity
        is_other = TABLE.get(unit) != TABLE.get(guess.unit, TABLE.get(unit)) and guess.scale == 1
        if in_brackets and channel.scale == 1 and is_same_kind and is_other:
            key = "unit" if guess.quantity == channel.quantity else "quantity"
            text = f"the heading {guess.name} says {guess.quantity} in {guess.unit}"
            yield Doubt(i, key, f"{text}, and not {channel.quantity} in {unit}")
        if re.search(r"\d", channel.channel) and not re.fullmatch(r"column \d+", channel.channel):
            families.setdefault((guess.parts[0], channel.quantity, channel.role), []).append(i)
    for members in families.values():
        yield from _of_a_family(members, [guesses[i].parts[1] for i in members], channels)


def _of_a_family(members: Sequence[int], labels: Sequence[str], channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """Warnings on signals whose names differ by a number: one with a different unit, two exchanged ones."""
    units = [channels[i].unit or QUANTITY_UNIT[channels[i].quantity] for i in members]
    sizes = [TABLE.get(unit, ("", 1.0)) for unit in units]
    usual, count = Counter(sizes).most_common(1)[0]
    digits = [re.sub(r"\D", "", channels[i].at) for i in members]
    are_numbered = sorted(digits) == sorted(labels) and len({*digits}) == len(digits)
    for i, unit, size, label, number in zip(members, units, sizes, labels, digits, strict=True):
        name = channels[i].name_in_file
        if size != usual and size[0] == usual[0] and count == len(members) - 1 > 1:
            text = f"{name} has unit {unit}, {channels[members[sizes.index(usual)]].name_in_file} and the others"
            yield Doubt(i, "unit", f"{text} {units[sizes.index(usual)]}; use one unit for all joints of a log")
        if are_numbered and label != number:
            text = f"{name} has number {label} in its name and is assigned to {channels[i].at}"
            yield Doubt(i, "at", f"{text}; check the order of the channels")


@dataclass(frozen=True)
class DoubtLimits:
    """Limits of warnings about channels. 150 clean logs cause none (scripts/studies/results.csv)."""

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

    def named(self, i: int) -> str:
        """Quantity and name of a motion."""
        return f"{self.channels[i].quantity} {self.channels[i].name_in_file}"

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
    """Warnings about channels of one rate from the raw values (n, c) of a log."""
    constant = dict(value_refusals(channels, list(values.T)))
    yield from (Doubt(i, "channel", f"{channels[i].name_in_file} {text}") for i, text in constant.items())
    by_names = list(doubts_by_names(channels))
    yield from by_names
    if by_names or constant or len(values) < LIMITS.min_samples or not isinstance(robot, Robot):
        return
    si = [bridged(x) * link_side_factor(c, robot) for x, c in zip(values.T, channels, strict=True)]
    signals, joints = np.stack(si, axis=1) @ to_joints(channels, robot).T, []
    for joint in robot.driven:
        ours = [i for i, c in enumerate(channels) if c.at in (f"motor {joint.name}", f"joint {joint.name}")]
        torque = next((i for i in ours if channels[i].role == "u"), None)
        motions = tuple(i for i in ours if channels[i].role == "y")
        joints.append(JointSignals(joint, robot.ratio(joint.name), rate_hz, torque, motions, channels, signals))
    too_far = [doubt for joint in joints for doubt in _travels(joint)]
    yield from too_far or (doubt for joint in joints for doubt in _motions(joint))


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
                f"joint {joint.joint.name} would move over {moved:.4g} {joint.joint.unit}; its range is {most:.4g}. "
                f"The unit of its sensor is probably {' or '.join(fitting) or 'a different one'}"
            )
            yield Doubt(i, "side" if fitting == ["side: motor"] else "unit", text)


def _motions(joint: JointSignals) -> Iterator[Doubt]:
    """Motions of one joint that contradict each other in quantity, unit or sign; else its torque and its motion."""
    is_consistent = False
    for a, b in combinations(sorted(joint.motions, key=joint.order), 2):
        relations = {r.order: r for r in motion_relations(joint.signals[:, a], joint.signals[:, b], joint.rate_hz)}
        stated = relations[joint.order(b) - joint.order(a)]
        best = max(relations.values(), key=lambda relation: abs(relation.correlation))
        gain, order = abs(stated.gain), joint.order(a) + best.order
        if abs(stated.correlation) < LIMITS.max_stated_correlation and abs(best.correlation) > MIN_CORRELATION:
            i, k = (b, order) if 0 <= order < len(MOTIONS) else (a, joint.order(b) - best.order)
            text = f"{joint.named(b)} is proportional to the derivative of order {best.order} of {joint.named(a)}"
            yield Doubt(
                i, "quantity", f"{text}; {joint.channels[i].name_in_file} is probably quantity: {MOTIONS[k % 3]}"
            )
            return
        if abs(stated.correlation) < MIN_CORRELATION:
            continue
        if abs(np.log(gain)) > LIMITS.max_gain:
            yield from _of_gain(joint, a, b, gain, stated.order)
            return
        if stated.gain < 0:
            i = next((i for i in (a, b) if _by_torque(joint, i).is_against_motion), b)
            names = f"{joint.named(a)} and {joint.named(b)} of joint {joint.joint.name}"
            yield Doubt(i, "sign", f"{names} have opposite signs; give one of them sign: -1")
            return
        is_consistent = True
    for i in joint.motions[:1]:
        relation = _by_torque(joint, i)
        names = f"torque {joint.channels[joint.torque or 0].name_in_file} and {joint.named(i)}"
        if relation.is_against_motion:
            text = f"{names} give a negative inertia or friction. Give one of them sign: -1"
            yield Doubt(joint.torque if is_consistent else i, "sign", text)
        elif relation.is_before_gear(joint.joint, joint.ratio):
            text = f"{names} give an inertia below the rotor's own. If they are logged before the gear, set side: motor"
            yield Doubt(joint.torque, "side", text)


def _by_torque(joint: JointSignals, i: int) -> TorqueRelation:
    if joint.torque is None:
        return TorqueRelation()
    u, y = joint.signals[:, joint.torque], joint.signals[:, i]
    return torque_relation(u, y, joint.order(i), joint.rate_hz, not joint.joint.slides)


def _of_gain(joint: JointSignals, a: int, b: int, gain: float, order: int) -> Iterator[Doubt]:
    """Another unit or side of one of two motions; another gear, or another rate."""
    text = f"{joint.named(b)} is {gain:.4g} times the value computed from {joint.named(a)}"
    factors = [(x**sense, i, keys) for i, sense in ((b, 1), (a, -1)) for x, keys in joint.factors(i)]
    fitting = [(i, keys) for x, i, keys in factors if abs(np.log(gain / x)) <= LIMITS.max_factor]
    for i, keys in sorted(fitting, key=lambda pair: not pair[1].startswith("side"))[:1]:
        yield Doubt(i, keys.partition(":")[0], f"{text}; with {keys} both are consistent")
    if not fitting and order == 0 and abs(np.log(gain)) > LIMITS.max_play:
        what = f"motor.ratio of joint {joint.joint.name} in the robot's file ({joint.ratio:g})"
        yield Doubt(b, "scale", f"{text}. Check {what}, and unit and scale of both")
    elif not fitting and order > 0:
        yield Doubt(
            None, "rate_hz", (f"{text}; the sampling rate is probably {gain ** (1 / order) * joint.rate_hz:.4g} Hz")
        )
