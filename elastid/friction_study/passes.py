r"""Passes, plateaus of any motion there and back at one speed; and one regression over all passes of a joint.

.. math:: u = s\, g_k + o_k + f s (|\dot q| - v_k) + J \ddot q + G \cos q + H \sin q
              + \sum_h (a_h \cos h N q + b_h \sin h N q)

for the passes of pair k, with s the direction of the motion: ripple of the motor's turns (N a turn of the joint) and
inertia are the same in all pairs, gravity in all of one load; the level g_k and the part o_k that is the same in both
directions are each pair's own; f is the slope of friction about the mean speed v_k of a pass.  o_k is an offset of the
torque where it does not change with speed; a part that changes is friction that differs between the directions.
Levels hold at the measured speed, not at the commanded one.

A level's variance comes from how pairs of the same speed scatter, and within a pair from the autocovariance of the
residuals of all passes. Ripple that the regression lacks would be taken for such noise, so harmonics that stand out
of the residuals are added to it. Rows are means of a few samples, which loses no information under white noise.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value
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
    rate_hz: float
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

    @property
    def turns_back(self) -> bool:
        """True if the velocity changes its sign: the joint sticks and slips, or stands."""
        return bool(np.any(self.velocity * self.direction <= 0))


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
    def of(cls, passes: Sequence[Pass], pairs: dict[str, list[Pass]], has_gravity: bool, turn: float) -> PassRegression:
        """The columns of all passes; turn: angle of the joint for a turn of the motor, 0 without ripple."""
        lengths = [len(each.position) for each in passes]
        step = max(1, min(sum(lengths) // 15_000, min(lengths) // 40))  # rows of all passes, and of the shortest
        has_ripple = turn > 0 and any(np.ptp(each.position) > turn for each in passes)
        order = list(pairs)
        loads = list(dict.fromkeys(each.load_name for each in passes)) if has_gravity else []
        searched = range(N_WAVES if has_ripple else 0)
        rows, torques, waves, numbers = [], [], [], []
        for number, each in enumerate(passes):
            own = np.zeros((len(each.position), 2 * len(order)))
            own[:, order.index(each.pair)] = each.direction
            own[:, len(order) + order.index(each.pair)] = 1.0
            speed = np.abs(each.velocity)
            columns = [each.acceleration, each.direction * about_mean(speed)]
            for load in loads:
                carried = float(load == each.load_name)
                columns += [carried * np.cos(each.position), carried * np.sin(each.position)]
            rows.append(_means(np.hstack([own, np.stack(columns, axis=1)]), step))
            torques.append(_means(each.torque, step))
            waves.append(_means(turn_waves(each.position, each.direction, turn, searched), step))
            numbers.append(np.full(len(torques[-1]), number))
        names = ["inertia", "slope", *(name for load in loads for name in gravity_names(load))]
        y, of_pass = np.concatenate(torques), np.concatenate(numbers)
        regression = cls(np.vstack(rows), y, of_pass, np.vstack(waves), tuple(names))
        return regression._with_ripple() if has_ripple else regression

    def solve(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Numbers (n_x,), covariance (n_x, n_x) and residual (n,)."""
        size = np.linalg.norm(self.A, axis=0)
        size[size == 0] = 1.0
        B = self.A / size
        U, s, Vt = np.linalg.svd(B, full_matrices=False)
        good = s > 1e-10 * s[0]
        values = (Vt[good].T / s[good]) @ (U[:, good].T @ self.y)
        left = self.y - B @ values
        bread = (Vt[good].T / s[good] ** 2) @ Vt[good]
        autocovariance = self._autocovariance(left)
        # Of numbers that change more slowly than the residuals forget, as levels do.
        long_run = autocovariance[0] + 2 * float(autocovariance[1:].sum())
        # Every number takes its share of the long-run variance from each autocovariance of the residuals.
        spare = 1 + (2 * len(autocovariance) - 1) * B.shape[1] / len(self.y)
        return values / size, spare * long_run * bread / np.outer(size, size), left

    def _with_ripple(self) -> PassRegression:
        first, others = self._with_waves(np.arange(2)), np.arange(2, N_WAVES)
        Q = np.linalg.qr(first.A / np.maximum(np.linalg.norm(first.A, axis=0), 1e-300))[0]
        left = first.y - Q @ (Q.T @ first.y)
        return first._with_waves(others[harmonic_peaks(left, self.waves[:, others])])

    def _with_waves(self, waves: IntArray) -> PassRegression:
        columns = [column for i in waves for column in (self.waves[:, i].real, self.waves[:, i].imag)]
        names = [name for i in waves.tolist() for name in wave_names(i)]
        return replace(self, A=np.column_stack([self.A, *columns]), shared=(*self.shared, *names))

    @property
    def _passes(self) -> list[slice]:
        ends = (np.flatnonzero(np.diff(self.of_pass)) + 1).tolist()
        return [slice(a, b) for a, b in zip([0, *ends], [*ends, len(self.of_pass)], strict=True)]

    def _autocovariance(self, left: FloatArray) -> FloatArray:
        """Of the residuals of all passes, by lag in rows, up to the first that is not above chance."""
        values = [float(left @ left / len(left))]
        for lag in range(1, 201):
            long = [own for own in self._passes if own.stop - own.start > lag]
            count = sum(own.stop - own.start - lag for own in long)
            total = sum(float(left[own][lag:] @ left[own][:-lag]) for own in long)
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


def gravity_names(load: str) -> tuple[str, str]:
    """Names of the numbers of gravity under a load."""
    return (f"gravity.cos.{load}", f"gravity.sin.{load}") if load else ("gravity.cos", "gravity.sin")


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
    position, velocity, acceleration = (np.interp(lag, samples, x) for x in (record.position, *motion_of(record)))
    pair = f"{record.name}, load {record.load}" if record.load else record.name
    return tuple(
        Pass(
            f"joint {record.joint}", pair, record.rate_hz, position[part], velocity[part], acceleration[part],
            record.torque[part], record.load_torque, _mean_temperature(record, part), record.slides, record.load,
        )
        for part in (_inner(*window, record.rate_hz) for window in (record.there, record.back) if window is not None)
    )  # fmt: skip


def motion_of(record: FrictionRecord) -> tuple[FloatArray, FloatArray]:
    """Velocity, as measured where it was, and acceleration (n,)."""
    smooth = butter(2, min(SMOOTHED_HZ, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    velocity = record.velocity
    if velocity is None:
        velocity = np.gradient(sosfiltfilt(smooth, record.position), 1 / record.rate_hz)
    return velocity, np.gradient(sosfiltfilt(smooth, velocity), 1 / record.rate_hz)


def _inner(start: int, stop: int, rate_hz: float) -> slice:
    """A plateau without its ends, into which the filter brings the ramps; of a short one at most a tenth each."""
    margin = min(int(rate_hz / SMOOTHED_HZ) + 1, (stop - start) // 10)
    return slice(start + margin, stop - margin)


def _mean_temperature(record: FrictionRecord, part: slice) -> float:
    known = np.zeros(0) if record.temperature is None else record.temperature[part]
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else float("nan")


@dataclass(frozen=True)
class PlateauLimits:
    """Limits of plateaus and their pairs."""

    steady_share: float = 0.05  # change of a steady velocity in the shortest plateau, as a share of itself
    shortest_s: float = 0.15
    rest_share: float = 0.005  # of the highest speed, below which a joint is at rest
    same_speed: float = 0.05  # speeds closer than this share are the same
    common_share: float = 0.1  # of the shorter plateau's travel, that there and back share under gravity
    other_speed: float = 0.2  # relative distance to the stated speed of a log, beyond which a plateau is no pass of it
    steady_hz: float = 15.0  # band in which a plateau is steady, about as long as the shortest one
    turn_share: float = 0.01  # of the travel of a log, by which it goes back after a turning point at least
    end_share: float = 0.05  # of a way at each end, in which it may rest and accelerate
    windows: int = 6  # of a way at one speed, between whose means its speed changes by less than steady_share
    line_share: float = 1.5  # of the largest distance of its inner part from a line, beyond which such a way has ended
    margin_s: float = 0.3  # around a pair, for the derivatives at its ends


PLATEAUS = PlateauLimits()


@dataclass(frozen=True)
class Plateau:
    """Samples start to stop of steady sliding at a mean velocity, rad/s or m/s with its sign."""

    start: int
    stop: int
    velocity: float


def find_plateaus(velocity: FloatArray, acceleration: FloatArray, rate_hz: float) -> tuple[Plateau, ...]:
    """The plateaus of a smooth motion (n,), in their order."""
    speed = np.abs(velocity)
    steady = speed > PLATEAUS.rest_share * speed.max(initial=0.0)
    steady &= np.abs(acceleration) * PLATEAUS.shortest_s < PLATEAUS.steady_share * speed
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(np.int8)))
    return tuple(
        Plateau(int(start), int(stop), float(velocity[start:stop].mean()))
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
        if stop - start >= PLATEAUS.shortest_s * rate_hz
    )


def alike_speeds(speeds: FloatArray) -> FloatArray:
    """Each speed (n,) as the mean of those that are the same."""
    groups = np.array(distinct_speeds([Plateau(0, 0, speed) for speed in speeds.tolist()]))
    return groups[np.argmin(np.abs(speeds[:, None] - groups), axis=1)] if len(groups) else speeds


def distinct_speeds(plateaus: Sequence[Plateau]) -> tuple[float, ...]:
    """The speeds without sign, each once, lowest first: the mean of those that are the same."""
    groups: list[list[float]] = []
    for speed in sorted(abs(plateau.velocity) for plateau in plateaus):
        if groups and speed < groups[-1][0] * (1 + PLATEAUS.same_speed):
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
