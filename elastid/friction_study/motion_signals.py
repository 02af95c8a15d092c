"""Log of one axis: its plateaus and constant-velocity runs, and its signals after the filter of the regression.

The filter has a finite length: a sample with a wrong model, such as in sticking, affects only its neighbours. The
equations of all other samples are exact (modulating functions: Shinbrot, Trans. ASME 79, 1957). Each unused sample
has a stated reason.

In the log of any motion, runs are strokes at one mean speed, and steady parts of other strokes. A stroke is the part of
the log between two reversals. Cogging changes the speed of a slow run by 20 % and more, so that its acceleration is
never small. Its position nevertheless stays close to a straight line. Such a stroke is one plateau, which ends where
the position leaves the line. In other strokes, such as strokes with several speeds, a plateau is where the velocity is
steady.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import comb
from typing import Any

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import correlate1d, maximum_filter1d, spline_filter1d
from scipy.signal import butter, cont2discrete, lfilter, resample_poly, sosfiltfilt, upfirdn

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, true_runs
from elastid.base.errors import DataError
from elastid.friction_record import FrictionRecord
from elastid.model.formulation import ElasticJoint

# Above, before a position is differentiated: speeds and ripple of a pass are slower.
SMOOTHED_HZ = 60.0


def smooth_motion(record: FrictionRecord, hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return low-pass filtered position, velocity (as logged, if available) and acceleration (n,)."""
    smooth = butter(2, min(hz, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    position = sosfiltfilt(smooth, record.position)
    velocity = np.gradient(position, 1 / record.rate_hz) if record.velocity is None else record.velocity
    return position, velocity, np.gradient(sosfiltfilt(smooth, velocity), 1 / record.rate_hz)


PIECE = 20_000  # samples whose columns are in memory at once
# Thresholds of plateaus and their pairs, and of the judgement of passes.
MAX_STEADY_CHANGE = 0.05  # change of a steady velocity in the shortest plateau; closer speeds are the same
SHORTEST_S = 0.15
MAX_REST_FRACTION = 0.005  # of the highest speed, below which a joint is at rest
MIN_OVERLAP = 0.1  # of the shorter plateau's travel, that there and back share under gravity
MAX_SPEED_DIFFERENCE = 0.2  # relative distance to the stated speed of a log, beyond which a plateau is no pass of it
STEADY_HZ = 15.0  # band in which a plateau is steady, about as long as the shortest one
MIN_RETURN_FRACTION = 0.01  # of the travel of a log, by which it goes back after a turning point at least
WAY_WINDOWS = 6  # of a way at one speed, between whose means its speed changes by less than steady_share
MAX_LINE_RATIO = 1.5  # of the largest distance of its inner part from a line, beyond which such a way has ended
MIN_CHANGE = 0.03  # of friction with the angle, relative, that is worth a note
MIN_COUNTS = 3.0  # amplitude of a loop or a response at rest in counts of the encoder: below, it is steps


@dataclass(frozen=True)
class Plateau:
    """Samples start to stop of steady sliding at a mean velocity, rad/s or m/s with its sign."""

    start: int
    stop: int
    velocity: float


def find_plateaus(velocity: FloatArray, acceleration: FloatArray, rate_hz: float) -> tuple[Plateau, ...]:
    """Return the plateaus of a smooth motion (n,), in their order."""
    speed = np.abs(velocity)
    steady = speed > MAX_REST_FRACTION * speed.max(initial=0.0)
    steady &= np.abs(acceleration) * SHORTEST_S < MAX_STEADY_CHANGE * speed
    return tuple(
        Plateau(start, stop, float(velocity[start:stop].mean()))
        for start, stop in true_runs(steady).tolist()
        if stop - start >= SHORTEST_S * rate_hz
    )


def alike_speeds(speeds: FloatArray) -> FloatArray:
    """Return speeds (n,), each the mean of those that are the same."""
    groups = np.array(distinct_speeds(speeds))
    return groups[np.argmin(np.abs(speeds[:, None] - groups), axis=1)] if len(groups) else speeds


def distinct_speeds(speeds: Iterable[float]) -> tuple[float, ...]:
    """Return the speeds without sign, each once, lowest first: the mean of those that are the same."""
    groups: list[list[float]] = []
    for speed in sorted(abs(float(speed)) for speed in speeds):
        if groups and speed < groups[-1][0] * (1 + MAX_STEADY_CHANGE):
            groups[-1].append(speed)
        else:
            groups.append([speed])
    return tuple(float(np.mean(group)) for group in groups)


def detect_passes(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """Return record of constant-velocity runs for each pair of plateaus of a motion, named after it with a number.

    has_gravity: there and back must then share positions.  Of a log with a speed, its plateaus at that speed alone;
    DataError where such a log has no pass there and back at it.
    """
    plateaus = _plateaus(record)
    pairs = _pairs(record, plateaus, has_gravity)
    if record.speed is not None and not pairs:
        text = (
            f"of {len(plateaus)} plateaus at {record.speed:.4g} {record.unit}/s none is there and back through common "
            "positions; record both directions, longer than ramps and settling, or correct speed"
        )
        raise DataError("friction/constant-velocity-runs", text, f"{record.place}: joint {record.joint}")
    return tuple(_cut(record, *pair, number) for number, pair in enumerate(pairs, start=1))


def _plateaus(record: FrictionRecord) -> tuple[Plateau, ...]:
    """Return plateaus in chronological order; for a log with a speed, the plateaus at this speed."""
    position, velocity, acceleration = smooth_motion(record, STEADY_HZ)
    candidates = [_way_plateau(position, *span, record.rate_hz) for span in _one_way_spans(position)]
    way_plateaus = [plateau for plateau in candidates if plateau is not None]
    steady = find_plateaus(velocity, acceleration, record.rate_hz)
    steady_plateaus = [
        part for part in steady if not any(part.start < span.stop and span.start < part.stop for span in way_plateaus)
    ]
    plateaus = [*way_plateaus, *steady_plateaus]
    if record.speed is not None:
        max_difference = MAX_SPEED_DIFFERENCE * record.speed
        plateaus = [part for part in plateaus if abs(abs(part.velocity) - record.speed) <= max_difference]
    return tuple(sorted(plateaus, key=lambda part: part.start))


def _one_way_spans(position: FloatArray) -> list[tuple[int, int]]:
    """Return first sample and end of each way: between turning points, from which it goes back far enough.

    What is not as far, stick-slip and noise at rest, turns no way.
    """
    far = MIN_RETURN_FRACTION * float(np.ptp(position))
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


def _way_plateau(position: FloatArray, start: int, stop: int, rate_hz: float) -> Plateau | None:
    """Return the plateau of a way with at least half of its time at one speed, if its means over windows are equal."""
    q = position[start:stop]
    has_left_start = np.abs(q - q[0]) > MAX_STEADY_CHANGE * np.ptp(q)
    ahead = np.abs(q - q[-1]) > MAX_STEADY_CHANGE * np.ptp(q)
    first, last = int(np.argmax(has_left_start)), len(q) - int(np.argmax(ahead[::-1]))
    w = (last - first) // WAY_WINDOWS
    if WAY_WINDOWS * w < 2 * SHORTEST_S * rate_hz:
        return None
    steps = q[first + w : last] - q[first : last - w]  # travels over one window
    change, travel = np.abs(steps[w:] - steps[:-w]), np.abs(steps[w:] + steps[:-w]) / 2
    steady = true_runs(change < MAX_STEADY_CHANGE * travel, w).tolist()
    if not steady:
        return None
    begin, end = max(steady, key=lambda run: run[1] - run[0])
    # The outer windows may reach into ramps, by as much as their means allow.
    inner = slice(first + begin + w // 2, first + end + 2 * w - w // 2)
    t = np.arange(len(q)) / rate_hz
    speed, offset = np.polyfit(t[inner], q[inner], 1)
    away = np.abs(q - speed * t - offset)
    on_line = away <= MAX_LINE_RATIO * away[inner].max()
    flags_before, flags_after = on_line[: inner.start][::-1], on_line[inner.stop :]
    begin = inner.start - int(np.argmin(np.append(flags_before, False)))
    return Plateau(start + begin, start + inner.stop + int(np.argmin(np.append(flags_after, False))), float(speed))


def _pairs(record: FrictionRecord, plateaus: Sequence[Plateau], has_gravity: bool) -> list[tuple[Plateau, Plateau]]:
    """Return pairs of each plateau with the next one back at the same speed, each used once."""

    def is_way_back(first: Plateau, other: Plateau) -> bool:
        limit = MAX_STEADY_CHANGE * abs(first.velocity)
        if first.velocity * other.velocity >= 0 or abs(first.velocity + other.velocity) > limit:
            return False
        q, q_back = (record.position[plateau.start : plateau.stop] for plateau in (first, other))
        common = min(q.max(), q_back.max()) - max(q.min(), q_back.min())
        return not has_gravity or bool(common > MIN_OVERLAP * min(np.ptp(q), np.ptp(q_back)))

    pairs = []
    free = list(plateaus)
    while free:
        first = free.pop(0)
        if (partner := next((back for back in free if is_way_back(first, back)), None)) is not None:
            free.remove(partner)
            pairs.append((first, partner))
    return pairs


def _cut(record: FrictionRecord, forth: Plateau, back: Plateau, number: int) -> FrictionRecord:
    margin = round(2 * SHORTEST_S * record.rate_hz)
    start, stop = max(0, forth.start - margin), min(len(record.position), back.stop + margin)
    names = ("position", "torque", "velocity", "temperature", "disturbance", "reference", "link_position")
    logged_signals = {name: getattr(record, name) for name in names}
    signals: dict[str, Any] = {name: None if log is None else log[start:stop] for name, log in logged_signals.items()}
    return replace(
        record, **signals,
        name=f"{record.name}-{number}", purpose="constant_velocity", there=(forth.start - start, forth.stop - start),
        back=(back.start - start, back.stop - start), speed=(abs(forth.velocity) + abs(back.velocity)) / 2,
        start_s=record.start_s + start / record.rate_hz, notes=()
    )  # fmt: skip


@frozen_value
class Motion:
    """A log of one axis on one side: position (n,) in rad or m, torque (n,) in Nm or N, at rate_hz.

    turns_against_gravity: True if the torque of gravity changes with the angle.  turn: of the joint for one of its
    motor, 0 for none.  load: |torque| that the joint carries.  temperature (n,): degC, None where none was logged.
    torque_delay_s: by which the torque acts later than its position was read.  payload_torque (n,): of a payload
    that other logs do not have, by the robot's geometry.  is_run_down: it coasts, its torque without the rigid body.
    spring: of the robot model between motor and link, None for a rigid joint.
    """

    place: str
    rate_hz: float
    position: FloatArray
    torque: FloatArray
    slides: bool = False
    turns_against_gravity: bool = False
    turn: float = 0.0
    load: float = 0.0
    temperature: FloatArray | None = None
    torque_delay_s: float = 0.0
    payload_torque: FloatArray | None = None
    is_run_down: bool = False
    spring: ElasticJoint | None = None


@dataclass(frozen=True)
class MotionSignals:
    """A motion at full rate (n,) behind the filter of derivatives; direction: sgn of the velocity.

    derivatives (2, n): of the position as logged, which the filter of both sides smooths.
    taps: the filter of both sides.  decimation: the samples of the filtered equation, thinned, without the ends.
    """

    motion: Motion
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    derivatives: FloatArray
    direction: FloatArray
    taps: FloatArray
    decimation: slice
    passband_hz: float

    @classmethod
    def of(cls, motion: Motion, passband_hz: float) -> "MotionSignals":
        """Return signals of a motion; DataError where it is too short, or sampled too slowly, for the passband."""
        rate = motion.rate_hz
        spoilt = round(6.0 / passband_hz * rate)  # samples at either end, six periods of the passband
        if not passband_hz < rate / 4 or len(motion.position) < 4 * spoilt:
            raise DataError(
                "friction/motion",
                f"it lasts {len(motion.position) / rate:.3g} s at {rate:g} Hz; a passband of {passband_hz:g} Hz takes "
                f"{4 * spoilt / rate:.3g} s and more than {4 * passband_hz:g} Hz: record longer, or faster",
                f"motion of {motion.place}",
            )
        smooth = butter(4, min(3.0 * passband_hz, 0.45 * rate), fs=rate, output="sos")
        # The position where the torque acts: a command that is held acts half a sample later.
        acting, delay = motion.position, motion.torque_delay_s * rate
        if delay:
            acting = acting[np.clip(np.arange(len(acting)) + round(delay), 0, len(acting) - 1)]
            acting = spline_derivative(spline_filter1d(acting, 5), 0, delay - round(delay))
        position = sosfiltfilt(smooth, acting)
        # Central differences would take 43 % of an acceleration at a fifth of the rate.
        spline, torque_spline = spline_filter1d(position, 5), spline_filter1d(acting, 5)
        derivatives = np.stack([spline_derivative(torque_spline, order) * rate**order for order in (1, 2)])
        # A jump between two samples is sampled as its part within the band is.
        # Samples of jumps in a period of the passband.
        finer = max(1, int(np.ceil(100.0 * passband_hz / rate)))
        velocity = np.stack([spline_derivative(spline, 1, i / finer) * rate for i in range(finer)], axis=1).ravel()
        direction = resample_poly(np.sign(velocity), 1, finer, padtype="line")
        taps = b_spline_taps(rate, passband_hz)
        inner = slice(spoilt, len(position) - spoilt, max(1, int(rate / (4 * passband_hz))))
        acceleration = spline_derivative(spline, 2) * rate**2
        return cls(motion, position, velocity[::finer], acceleration, derivatives, direction, taps, inner, passband_hz)

    @cached_property
    def inertial_acceleration(self) -> FloatArray:
        r"""Acceleration (n,) of motor and link, each weighted by its share of the inertia, as logged.

        .. math:: \ddot l = H(s)\, \ddot q, \qquad H = \frac{d s + k}{J_l s^2 + d s + k}

        exact for an acceleration that is linear between samples, from a link that starts with its motor; the spring is
        damped by 2 % at least, so that this start is forgotten.
        """
        spring, change = self.motion.spring, self.acceleration - self.acceleration[0]
        if spring is None:
            return np.asarray(self.derivatives[1])
        J_l, k = spring.link_inertia, spring.stiffness
        d = max(spring.damping, 0.04 * float(np.sqrt(k * J_l)))
        (b,), a, _ = cont2discrete(([d, k], [J_l, d, k]), 1 / self.motion.rate_hz, "foh")
        return np.asarray(self.derivatives[1] + J_l / spring.inertia * (lfilter(b, a, change) - change))

    def filtered(self, column: FloatArray) -> FloatArray:
        """Return a side of the equation (n, ...) behind the filter, at the decimated samples, away from the ends."""
        samples, h = self.decimation, len(self.taps) // 2
        offset = h + -2 * h % samples.step  # a whole number of steps before the end of the taps
        sums = upfirdn(self.taps, column[samples.start - offset : samples.stop + h], 1, samples.step, axis=0)
        first = (offset + h) // samples.step
        return np.asarray(sums[first : first + len(range(samples.start, samples.stop, samples.step))])

    def pieces(self) -> Iterator[tuple["MotionSignals", slice]]:
        """Yield overlapping parts that divide the decimated samples between them, and the samples of each part."""
        step, n, log = self.decimation.step, len(self.position), self.motion
        overlap, size = len(self.taps) + step, max(1, PIECE // step) * step
        for start in range(self.decimation.start, self.decimation.stop, size):
            stop = min(start + size, self.decimation.stop)
            span = slice(max(0, start - overlap), min(n, stop + overlap))
            names = ("position", "torque", "temperature", "payload_torque")
            signals = {name: None if (x := getattr(log, name)) is None else x[span] for name in names}
            piece = replace(
                self, motion=replace(log, **signals), decimation=slice(start - span.start, stop - span.start, step),  # type: ignore[arg-type]
                derivatives=self.derivatives[:, span],
                **{name: getattr(self, name)[span] for name in ("position", "velocity", "acceleration", "direction")}
            )  # fmt: skip
            yield piece, span

    @property
    def noise_powers(self) -> FloatArray:
        """Variances (2,) of filtered velocity and acceleration by white noise of the position.

        The noise is that of fifth differences, to which slow motion adds nothing (Hall, Kay and Titterington,
        Biometrika 77, 1990), away from reversals.
        """
        inner = self.slides[3:-2] if self.slides.any() else slice(None)
        variance = np.mean(np.diff(self.motion.position, 5)[inner] ** 2) / comb(10, 5)
        slopes = np.convolve(self.taps, [0.5, 0.0, -0.5]), np.convolve(self.taps, [1.0, -2.0, 1.0])
        gains = [np.sum((slope * self.motion.rate_hz**order) ** 2) for order, slope in enumerate(slopes, start=1)]
        return variance * np.array(gains)

    @property
    def decimated_hz(self) -> float:
        """The rate of the samples that are kept."""
        return self.motion.rate_hz / int(self.decimation.step)

    @property
    def rests(self) -> BoolArray:
        """Flags at full rate (n,), true at rest."""
        speed = np.abs(self.velocity)
        return np.asarray(speed < MAX_REST_FRACTION * speed.max())

    @cached_property
    def slides(self) -> BoolArray:
        """Flags at full rate (n,), true where neither rest nor a reversal is within the filter."""
        sign = np.sign(self.velocity)
        turns = np.append(False, sign[1:] != sign[:-1])
        # The derivatives of a spline reach 4 samples.
        width = 2 * (len(self.taps) // 2 + 4) + 1
        return np.asarray(maximum_filter1d((self.rests | turns).astype(np.uint8), width, mode="constant") == 0)

    @cached_property
    def used(self) -> BoolArray:
        """Flags of the samples that are kept (k,), those that slide; all, where hardly any does."""
        slides = self.slides[self.decimation]
        # All are used where fewer than a fifth slide clear of reversals.
        return slides if slides.mean() > 0.2 else np.ones_like(slides)

    @property
    def seconds(self) -> dict[str, float]:
        """Durations that sum to the duration of the log: used in the regression, and rejected with the reason."""
        total, used_s = len(self.position) / self.motion.rate_hz, float(self.used.sum()) / self.decimated_hz
        rest_s = min(float(self.rests.mean()) * total, total - used_s)
        return {"used": used_s, "at rest": rest_s, "near a reversal, rest or end": total - used_s - rest_s}

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """Plateaus where it slides steadily."""
        return find_plateaus(self.velocity, self.acceleration, self.motion.rate_hz)

    def moves(self, direction: int) -> bool:
        """Return True if it moves that way (1, -1) faster than 2 % of its highest speed for 2 % of the time."""
        inside = self.velocity[self.decimation.start : self.decimation.stop]
        return bool(np.mean(direction * inside > 0.02 * np.abs(inside).max()) > 0.02)


def spline_derivative(coefficients: FloatArray, order: int, shift: float = 0.0) -> FloatArray:
    """Return derivative (n,) per sample^order of a quintic spline at its samples, shifted by less than one sample."""
    basis = BSpline.basis_element(np.arange(-3.0, 4.0), extrapolate=False)
    weights = np.nan_to_num((basis.derivative(order) if order else basis)(shift - np.arange(-3, 4)))
    return np.asarray(correlate1d(coefficients, weights, mode="mirror"))


# Boxes whose convolution the taps are, and their width over a period of the passband for -3 dB at its end.
_BOXES, _WIDTH = 6, 0.1863


def b_spline_taps(rate_hz: float, passband_hz: float) -> FloatArray:
    r"""Return taps (2 h + 1,) of unit sum: |H(f)| = |sinc(w f)|^6 with w = 0.1863 / passband."""
    half = _BOXES / 2 * _WIDTH * rate_hz / passband_hz  # samples
    h = max(1, int(half))
    spline = BSpline.basis_element(np.linspace(-half, half, _BOXES + 1), extrapolate=False)
    taps = np.nan_to_num(spline(np.arange(-h, h + 1)))
    return np.asarray(taps / taps.sum())


@dataclass(frozen=True)
class MotionLog:
    """Signals of a log by joint, and the angles of the joints that rest."""

    signals: Mapping[str, MotionSignals]
    resting: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, motions: Mapping[str, Motion], resting: Mapping[str, float], passband_hz: float) -> "MotionLog":
        """Return log of motions by joint; DataError as of `MotionSignals`."""
        return cls({joint: MotionSignals.of(motion, passband_hz) for joint, motion in motions.items()}, resting)

    @property
    def first(self) -> MotionSignals:
        """Signals of one of its joints, which all have its times."""
        return next(iter(self.signals.values()))


# Second band over the passband; a correct model has equal parameters in both.
NARROW_BAND = 0.25


def both_bands(logs: Sequence[MotionLog]) -> tuple[list[MotionLog], ...]:
    """Return signals of the whole and of a narrow band at the same samples; none for short logs or many reversals."""
    bands = list[MotionLog](), list[MotionLog]()
    for log in logs:
        motions = {joint: axis.motion for joint, axis in log.signals.items()}
        try:
            slow = MotionLog.of(motions, log.resting, NARROW_BAND * log.first.passband_hz)
        except DataError:
            return ()
        if any(axis.used.all() for axis in slow.signals.values()):
            return ()
        inner = slow.first.decimation
        samples = slice(inner.start, inner.stop, log.first.decimation.step)
        for band, log_ in zip(bands, (log, slow), strict=True):
            signals = {joint: replace(axis, decimation=samples) for joint, axis in log_.signals.items()}
            band.append(replace(log_, signals=signals))
    return bands
