r"""Passes, plateaus of any motion there and back at one speed; and one regression over all passes of a joint.

.. math:: u = s\, g_k + o_k + f s (|\dot q| - v_k) + J \ddot q + G \cos q + H \sin q
              + \sum_h (a_h \cos h N q + b_h \sin h N q)

for the passes of pair k, with s the direction of the motion: ripple of the motor's turns (N a turn of the joint) and
inertia are the same in all pairs, gravity in all of one load; the level g_k and the part o_k that is the same in both
directions are each pair's own; f is the slope of friction about the mean speed v_k of a pass.  o_k is an offset of the
torque where it does not change with speed; a part that changes is friction that differs between the directions.
Levels hold at the measured speed, not at the commanded one.

A level's variance comes from the autocovariance of the residuals of all passes. Ripple that the regression lacks would
be taken for such noise, so harmonics that stand out of the residuals are added to it. Rows are means of a few samples,
which loses no information under white noise.

Of the log of any motion, passes are ways at one speed on the whole, and steady parts of other ways. A way is a part of
the log between two turning points. Cogging makes the speed of a slow pass wander about its mean by a fifth and more, so
that its acceleration is nowhere small; its position stays close to a straight line all the same. Such a way is one
plateau, whose ends are where the line is left. Elsewhere, as in ways with several speeds, a plateau is where the
velocity is steady. Sticking would be taken for friction: such passes do not count.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.record import FrictionRecord

# Ripple of a motor turn and of its half are always in the regression where passes cover a turn; further harmonics up to
# this, and those of dry friction, are searched for in its residuals.
MAX_HARMONIC = 24
N_WAVES = 2 * MAX_HARMONIC


@frozen_value
class Pass:
    """A part of a log in which one joint slides steadily, on one side, SI.

    pair: passes of one pair belong together, there and back.  position, velocity, acceleration, torque (n,).  load:
    |torque| that the joint carries.  temperature: mean, degC, NaN where it is not known.  load_name: passes of one have
    the same gravity.
    """

    place: str
    pair: str
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    load: float = 0.0
    temperature: float = float("nan")
    slides: bool = False
    load_name: str = ""

    @property
    def direction(self) -> float:
        """1 or -1."""
        return float(np.sign(self.velocity.mean()))


@dataclass(frozen=True)
class PassRegression:
    """Columns A (n, n_x) and torque y (n,), rows of the passes of_pass (n,); shared: names of the columns behind g, o.

    waves (n, N_WAVES): of `turn_waves`; (n, 0) where no pass covers a turn.
    """

    A: FloatArray
    y: FloatArray
    of_pass: IntArray
    waves: ComplexArray
    shared: tuple[str, ...]

    @classmethod
    def of(cls, passes: Sequence[Pass], has_gravity: bool, turn: float) -> PassRegression:
        """The columns of all passes; turn: angle of the joint for a turn of the motor, 0 without ripple."""
        lengths = [len(each.position) for each in passes]
        step = max(1, min(sum(lengths) // 15_000, min(lengths) // 40))  # rows of all passes, and of the shortest
        has_ripple = turn > 0 and any(np.ptp(each.position) > turn for each in passes)
        pairs = list(dict.fromkeys(each.pair for each in passes))
        loads = list(dict.fromkeys(each.load_name for each in passes)) if has_gravity else []
        searched = range(N_WAVES if has_ripple else 0)
        rows, torques, waves = [], [], []
        for each in passes:
            q, s, one = each.position, each.direction, np.ones(len(each.position))
            own = [float(pair == each.pair) * one for pair in pairs]
            carried = [float(load == each.load_name) * wave for load in loads for wave in (np.cos(q), np.sin(q))]
            shared = [each.acceleration, s * about_mean(np.abs(each.velocity)), *carried]
            rows.append(_means(np.stack([*(s * column for column in own), *own, *shared], axis=1), step))
            torques.append(_means(each.torque, step))
            waves.append(_means(turn_waves(q, s, turn, searched), step))
        gravity = [f"gravity.{wave}.{load}".rstrip(".") for load in loads for wave in ("cos", "sin")]
        y, of_pass = np.concatenate(torques), np.repeat(np.arange(len(torques)), [len(each) for each in torques])
        regression = cls(np.vstack(rows), y, of_pass, np.vstack(waves), ("inertia", "slope", *gravity))
        if not has_ripple:
            return regression
        first, others = regression._with_waves(np.arange(2)), np.arange(2, N_WAVES)
        left = first.y - first.A @ first.solve()[0]
        return first._with_waves(others[harmonic_peaks(left, first.waves[:, others])])

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Numbers (n_x,) and covariance (n_x, n_x)."""
        size = np.linalg.norm(self.A, axis=0)
        size[size == 0] = 1.0
        inverse = np.linalg.pinv(self.A / size, rcond=1e-10) / size[:, None]
        values = inverse @ self.y
        autocovariance = self._autocovariance(self.y - self.A @ values)
        # Of numbers that change more slowly than the residuals forget, as levels do.
        long_run = autocovariance[0] + 2 * float(autocovariance[1:].sum())
        # Every number takes its share of the long-run variance from each autocovariance of the residuals.
        spare = 1 + (2 * len(autocovariance) - 1) * len(values) / len(self.y)
        return values, spare * long_run * inverse @ inverse.T

    def _with_waves(self, waves: IntArray) -> PassRegression:
        columns = [column for i in waves for column in (self.waves[:, i].real, self.waves[:, i].imag)]
        names = [name for i in waves.tolist() for name in wave_names(i)]
        return replace(self, A=np.column_stack([self.A, *columns]), shared=(*self.shared, *names))

    def _autocovariance(self, left: FloatArray) -> FloatArray:
        """Of the residuals of all passes, by lag in rows, up to the first that is not above chance."""
        values = [float(left @ left / len(left))]
        for lag in range(1, min(201, len(left))):
            together = self.of_pass[lag:] == self.of_pass[:-lag]
            count, total = int(together.sum()), float(left[lag:] @ (left[:-lag] * together))
            if not count or total / count < 2 * values[0] / np.sqrt(count):
                break
            values.append(total / count)
        return np.array(values)


def about_mean(speed: FloatArray) -> FloatArray:
    """A positive speed (n,) less its mean; rounding, all that a constant one leaves, is none."""
    about = speed - speed.mean()
    return np.where(np.abs(about) < 1e-9 * speed.mean(), 0.0, about)


def harmonic_peaks(left: FloatArray, waves: ComplexArray) -> BoolArray:
    """True for each of the waves (n, n_h) that stands out of the residuals (n,)."""
    size = np.sum(np.abs(waves) ** 2, axis=0)
    power = np.abs(left @ waves) ** 2 / np.maximum(size, 1e-300)
    # Of noise the power is exponential, its median ln 2 of its mean: 12 means have a chance of 6e-6 each.
    return np.asarray((power > 12.0 / np.log(2) * np.median(power)) & (size > 0.01 * len(left)))


def turn_waves(
    position: FloatArray, direction: FloatArray | float, turn: float, chosen: Iterable[int] = range(N_WAVES)
) -> ComplexArray:
    """exp(j h N q) (n, n_h), chosen waves of the motor's turns: of ripple, then s times these, of dry friction."""
    waves = [np.exp(2j * np.pi / turn * (i % MAX_HARMONIC + 1) * position) for i in chosen]
    signs = [1.0 if i < MAX_HARMONIC else direction for i in chosen]
    own = [sign * wave for sign, wave in zip(signs, waves, strict=True)]
    return np.stack(own, axis=1) if own else np.zeros((len(position), 0), complex)


def wave_names(wave: int) -> tuple[str, str]:
    """Names of the cosine and sine of a wave of the motor's turns."""
    name = f"{'ripple' if wave < MAX_HARMONIC else 'angle.turn'}.{wave % MAX_HARMONIC + 1}"
    return f"{name}c", f"{name}s"


def _means(x: Any, step: int) -> Any:
    """Means of every `step` rows of x (n,) or (n, m); an incomplete end is dropped."""
    n = len(x) // step
    return x[: n * step].reshape(n, step, *x.shape[1:]).mean(axis=1)


SMOOTHED_HZ = 60.0  # above, before a position is differentiated: speeds and ripple of a pass are slower


def passes_of(record: FrictionRecord) -> tuple[Pass, ...]:
    """There and back of one record of passes, as one pair; whichever of both it has."""
    # Gravity and inertia are those where the torque acts: half a sample's travel turns both with the direction.
    samples = np.arange(len(record.position))
    lag = samples + record.torque_delay_s * record.rate_hz
    motion = record.position, *_smoothed(record, SMOOTHED_HZ)[1:]
    position, velocity, acceleration = (np.interp(lag, samples, x) for x in motion)
    pair = f"{record.name}, load {record.load}" if record.load else record.name
    return tuple(
        Pass(
            f"joint {record.joint}", pair, position[part], velocity[part], acceleration[part],
            record.torque[part], record.load_torque, _mean_temperature(record, part), record.slides, record.load,
        )
        for part in (_inner(*window, record.rate_hz) for window in (record.there, record.back) if window is not None)
    )  # fmt: skip


def _smoothed(record: FrictionRecord, hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity, that which was logged where it was, and acceleration (n,) below a frequency."""
    smooth = butter(2, min(hz, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    position = np.asarray(sosfiltfilt(smooth, record.position))
    velocity = np.gradient(position, 1 / record.rate_hz) if record.velocity is None else record.velocity
    return position, velocity, np.gradient(sosfiltfilt(smooth, velocity), 1 / record.rate_hz)


def _inner(start: int, stop: int, rate_hz: float) -> slice:
    """A plateau without its ends, into which the filter brings the ramps; of a short one at most a tenth each."""
    margin = min(int(rate_hz / SMOOTHED_HZ) + 1, (stop - start) // 10)
    return slice(start + margin, stop - margin)


def _mean_temperature(record: FrictionRecord, part: slice) -> float:
    known = np.zeros(0) if record.temperature is None else record.temperature[part]
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else float("nan")


@dataclass(frozen=True)
class PassThresholds:
    """Thresholds of plateaus and their pairs, and of the judgement of passes."""

    steady_share: float = 0.05  # change of a steady velocity in the shortest plateau; closer speeds are the same
    shortest_s: float = 0.15
    rest_share: float = 0.005  # of the highest speed, below which a joint is at rest
    common_share: float = 0.1  # of the shorter plateau's travel, that there and back share under gravity
    other_speed: float = 0.2  # relative distance to the stated speed of a log, beyond which a plateau is no pass of it
    steady_hz: float = 15.0  # band in which a plateau is steady, about as long as the shortest one
    turn_share: float = 0.01  # of the travel of a log, by which it goes back after a turning point at least
    windows: int = 6  # of a way at one speed, between whose means its speed changes by less than steady_share
    line_share: float = 1.5  # of the largest distance of its inner part from a line, beyond which such a way has ended
    min_change: float = 0.03  # of friction with the angle, relative, that is worth a note
    min_counts: float = 3.0  # amplitude of a loop or a response at rest in counts of the encoder: below, it is steps


PASSES = PassThresholds()


@dataclass(frozen=True)
class Plateau:
    """Samples start to stop of steady sliding at a mean velocity, rad/s or m/s with its sign."""

    start: int
    stop: int
    velocity: float


def find_plateaus(velocity: FloatArray, acceleration: FloatArray, rate_hz: float) -> tuple[Plateau, ...]:
    """The plateaus of a smooth motion (n,), in their order."""
    speed = np.abs(velocity)
    steady = speed > PASSES.rest_share * speed.max(initial=0.0)
    steady &= np.abs(acceleration) * PASSES.shortest_s < PASSES.steady_share * speed
    return tuple(
        Plateau(start, stop, float(velocity[start:stop].mean()))
        for start, stop in _runs(steady)
        if stop - start >= PASSES.shortest_s * rate_hz
    )


def _runs(samples: BoolArray) -> list[tuple[int, int]]:
    """First sample of each run of those that are true, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], samples, [False]]).astype(np.int8)))
    return [(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]


def alike_speeds(speeds: FloatArray) -> FloatArray:
    """Each speed (n,) as the mean of those that are the same."""
    groups = np.array(distinct_speeds(speeds))
    return groups[np.argmin(np.abs(speeds[:, None] - groups), axis=1)] if len(groups) else speeds


def distinct_speeds(speeds: Iterable[float]) -> tuple[float, ...]:
    """The speeds without sign, each once, lowest first: the mean of those that are the same."""
    groups: list[list[float]] = []
    for speed in sorted(abs(float(speed)) for speed in speeds):
        if groups and speed < groups[-1][0] * (1 + PASSES.steady_share):
            groups[-1].append(speed)
        else:
            groups.append([speed])
    return tuple(float(np.mean(group)) for group in groups)


def one_way(ways: Collection[float]) -> str:
    """The end of a message about passes of one direction alone, 1 or -1."""
    return (
        f"{'positive' if 1.0 in ways else 'negative'} velocity only; friction cannot be distinguished from gravity and "
        "offset without the way back; record both directions"
    )


def detect_passes(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """A record of passes for each pair of plateaus of a motion, named after it with a number; none where it has none.

    has_gravity: there and back must then share positions.  Of a log with a speed, its plateaus at that speed alone;
    DataError where such a log has no pass there and back at it.
    """
    plateaus = _plateaus(record)
    pairs = _pairs(record, plateaus, has_gravity)
    if record.speed is not None and not pairs:
        raise DataError("friction/passes", _refusal(record, plateaus))
    return tuple(_cut(record, *pair, number) for number, pair in enumerate(pairs, start=1))


def _plateaus(record: FrictionRecord) -> tuple[Plateau, ...]:
    """In their order; of a log with a speed those at it alone."""
    position, velocity, acceleration = _smoothed(record, PASSES.steady_hz)
    of_ways = [_plateau_of_way(position, *way, record.rate_hz) for way in _ways(position)]
    ways = [plateau for plateau in of_ways if plateau is not None]
    steady = find_plateaus(velocity, acceleration, record.rate_hz)
    parts = [each for each in steady if not any(each.start < way.stop and way.start < each.stop for way in ways)]
    plateaus = [*ways, *parts]
    if record.speed is not None:
        reach = PASSES.other_speed * record.speed
        plateaus = [each for each in plateaus if abs(abs(each.velocity) - record.speed) <= reach]
    return tuple(sorted(plateaus, key=lambda each: each.start))


def _ways(position: FloatArray) -> list[tuple[int, int]]:
    """First sample of each way and the one after its last: between turning points, from which it goes back far enough.

    What is not as far, stick-slip and noise at rest, turns no way.
    """
    far = PASSES.turn_share * float(np.ptp(position))
    slope = np.sign(np.diff(position))
    peaks = [0, *(np.flatnonzero(slope[1:] != slope[:-1]) + 1).tolist(), len(position) - 1]
    turns, low, high, sign = list[int](), 0, 0, 0  # sign: of the way, 0 before the first
    for i in peaks:
        low, high = (i if position[i] < position[low] else low), (i if position[i] > position[high] else high)
        if sign >= 0 and position[high] - position[i] > far:
            turns.append(high)
            sign, low, high = -1, i, i
        elif sign <= 0 and position[i] - position[low] > far:
            turns.append(low)
            sign, low, high = 1, i, i
    return list(zip(turns, [*turns[1:], len(position)], strict=True))


def _plateau_of_way(position: FloatArray, start: int, stop: int, rate_hz: float) -> Plateau | None:
    """The plateau of a way of which half of the time at least is spent at one speed, if means over windows are."""
    way = position[start:stop]
    travelled = np.abs(way - way[0]) > PASSES.steady_share * np.ptp(way)
    ahead = np.abs(way - way[-1]) > PASSES.steady_share * np.ptp(way)
    first, last = int(np.argmax(travelled)), len(way) - int(np.argmax(ahead[::-1]))
    w = (last - first) // PASSES.windows
    if PASSES.windows * w < 2 * PASSES.shortest_s * rate_hz:
        return None
    steps = way[first + w : last] - way[first : last - w]  # travels over one window
    change, travel = np.abs(steps[w:] - steps[:-w]), np.abs(steps[w:] + steps[:-w]) / 2
    runs = [run for run in _runs(change < PASSES.steady_share * travel) if run[1] - run[0] >= w]
    if not runs:
        return None
    begin, end = max(runs, key=lambda run: run[1] - run[0])
    # The outer windows may reach into ramps, by as much as their means allow.
    inner = slice(first + begin + w // 2, first + end + 2 * w - w // 2)
    t = np.arange(len(way)) / rate_hz
    speed, offset = np.polyfit(t[inner], way[inner], 1)
    away = np.abs(way - speed * t - offset)
    on_line = away <= PASSES.line_share * away[inner].max()
    before, after = on_line[: inner.start][::-1], on_line[inner.stop :]
    begin = inner.start - int(np.argmin(np.append(before, False)))
    return Plateau(start + begin, start + inner.stop + int(np.argmin(np.append(after, False))), float(speed))


def _pairs(record: FrictionRecord, plateaus: Sequence[Plateau], has_gravity: bool) -> list[tuple[Plateau, Plateau]]:
    """Each plateau with the next one back at the same speed, each used once."""

    def is_way_back(first: Plateau, other: Plateau) -> bool:
        limit = PASSES.steady_share * abs(first.velocity)
        if first.velocity * other.velocity >= 0 or abs(first.velocity + other.velocity) > limit:
            return False
        q, q_back = (record.position[each.start : each.stop] for each in (first, other))
        common = min(q.max(), q_back.max()) - max(q.min(), q_back.min())
        return not has_gravity or bool(common > PASSES.common_share * min(np.ptp(q), np.ptp(q_back)))

    pairs: list[tuple[Plateau, Plateau]] = []
    free = list(plateaus)
    while free:
        first = free.pop(0)
        if (partner := next((other for other in free if is_way_back(first, other)), None)) is not None:
            free.remove(partner)
            pairs.append((first, partner))
    return pairs


def _cut(record: FrictionRecord, forth: Plateau, back: Plateau, number: int) -> FrictionRecord:
    margin = round(2 * PASSES.shortest_s * record.rate_hz)
    start, stop = max(0, forth.start - margin), min(len(record.position), back.stop + margin)
    names = ("position", "torque", "velocity", "temperature", "disturbance", "reference", "link_position")
    logged = {name: getattr(record, name) for name in names}
    signals: dict[str, Any] = {name: None if log is None else log[start:stop] for name, log in logged.items()}
    return replace(
        record, **signals,
        name=f"{record.name}-{number}", purpose="passes", there=(forth.start - start, forth.stop - start),
        back=(back.start - start, back.stop - start), speed=(abs(forth.velocity) + abs(back.velocity)) / 2,
        start_s=record.start_s + start / record.rate_hz, notes=(),
    )  # fmt: skip


def _refusal(record: FrictionRecord, plateaus: Sequence[Plateau]) -> str:
    where = f"{record.place}: joint {record.joint}, passes at {record.speed:.4g} {record.unit}/s"
    ways = {float(np.sign(plateau.velocity)) for plateau in plateaus}
    if len(ways) == 1:
        return f"{where}: they have {one_way(ways)}"
    return (
        f"{where}: of {len(plateaus)} plateaus none is there and back at one speed, within {PASSES.steady_share:.0%}, "
        "through common positions; record both directions through the same window, longer than ramps and settling, or "
        "correct speed"
    )


def usable_passes(passes: Sequence[Pass]) -> tuple[list[Pass], list[Note]]:
    """The passes that slide all the time, and notes on the others, whole pairs; DataError where none is."""
    sticks = dict.fromkeys(each.pair for each in passes if np.any(each.velocity * each.direction <= 0))
    text = (
        "the joint stands or turns back within the pass: it sticks and slips at this speed, and its level does not "
        "count; raise the bandwidth of the controller, or measure faster"
    )
    used = [each for each in passes if each.pair not in sticks]
    if not used:
        place = passes[0].place if passes else "the joint"
        raise DataError("friction/passes", f"in none it slides all the time: {text}", f"passes of {place}")
    return used, [Note("friction/passes", text, f"pass {name}") for name in sticks]
