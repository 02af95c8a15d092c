r"""Friction torques from constant-velocity runs at several speeds, loads and temperatures: one common regression.

.. math:: u = s\, g_k + o_k + f s (|\dot q| - v_k) + J \ddot q + G \cos q + H \sin q
              + \sum_h (a_h \cos h N q + b_h \sin h N q)

for the runs of pair k, with s the direction of the motion. All pairs share the inertia and the ripple of the motor's
turns (N a turn of the joint); all pairs with one load share gravity. Each pair has its own torque g_k and its own part
o_k that is equal in both directions. f is the slope of friction about the mean speed v_k of a run. If o_k is equal at
all speeds, it is a torque offset; a part that changes with speed is friction that differs between the directions.
Friction torques refer to the measured speed, not to the commanded speed.

The variance of a friction torque comes from the autocovariance of the residuals of all runs. Ripple that the
regression does not model would count as noise. Therefore harmonics that are significant in the residuals are added to
the regression. Rows are means of a few samples, which loses no information under white noise. Runs with stick-slip are
discarded, since sticking would appear as friction.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, fold_periods, frozen_value
from elastid.base.errors import DataError, Note
from elastid.friction.static import Conditions
from elastid.friction_record import FrictionRecord
from elastid.friction_study.least_squares import FALSE_ALARM, Optimum, terms_p_value
from elastid.friction_study.motion_signals import SMOOTHED_HZ, smooth_motion

MAX_RELATIVE_STD = 0.2  # std over friction torque; above, it is not identified
# Ripple of a motor turn and of its half are always in the regression where passes cover a turn; further harmonics up to
# this, and those of dry friction, are searched for in its residuals.
MAX_HARMONIC = 24
N_WAVES = 2 * MAX_HARMONIC

NEGATIVE = "friction is negative ({:.4g}): torque and velocity have opposite signs. Set sign: -1 for one channel"


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
    """Columns A (n, n_x) and torque y (n,), pass of each row pass_index (n,); shared: names of the columns behind g, o.

    waves (n, N_WAVES): of `turn_waves`; (n, 0) where no pass covers a turn.
    """

    A: FloatArray
    y: FloatArray
    pass_index: IntArray
    waves: ComplexArray
    shared: tuple[str, ...]

    @classmethod
    def of(cls, passes: Sequence[Pass], has_gravity: bool, turn: float) -> "PassRegression":
        """Return the columns of all passes; turn: angle of the joint for a turn of the motor, 0 without ripple."""
        lengths = [len(run.position) for run in passes]
        total, shortest = sum(lengths), min(lengths)
        # Rows of all passes, and of the shortest; of very many passes fewer of the shortest, for the memory.
        step = max(1, min(total // 15_000, max(shortest // 40, min(total // 30_000, shortest // 4))))
        has_ripple = turn > 0 and any(np.ptp(run.position) > turn for run in passes)
        pairs = list(dict.fromkeys(run.pair for run in passes))
        loads = list(dict.fromkeys(run.load_name for run in passes)) if has_gravity else []
        wave_numbers = range(N_WAVES if has_ripple else 0)
        rows, torques, waves = [], [], []
        n_k = len(pairs)
        for run in passes:
            q, s, mean = run.position, run.direction, abs(run.velocity.mean())
            about = np.abs(run.velocity) - mean
            about[np.abs(about) < 1e-9 * mean] = 0.0  # rounding is all that a constant speed leaves
            columns = [s * np.ones_like(q), np.ones_like(q), run.acceleration, s * about, np.cos(q), np.sin(q)]
            pair, load = pairs.index(run.pair), 2 * loads.index(run.load_name) if loads else -2
            indices = [pair, n_k + pair, *(2 * n_k + i for i in (0, 1, 2 + load, 3 + load))]
            if not loads:
                indices, columns = indices[:4], columns[:4]
            torques.append(fold_periods(run.torque, step).mean(axis=1))
            X = np.zeros((len(torques[-1]), 2 * n_k + 2 + 2 * len(loads)))
            X[:, indices] = fold_periods(np.stack(columns, axis=1), step).mean(axis=1)
            rows.append(X)
            waves.append(fold_periods(turn_waves(q, s, turn, wave_numbers), step).mean(axis=1))
        gravity = [f"gravity.{wave}.{load}".rstrip(".") for load in loads for wave in ("cos", "sin")]
        y, pass_index = np.concatenate(torques), np.repeat(np.arange(len(torques)), [len(torque) for torque in torques])
        regression = cls(np.vstack(rows), y, pass_index, np.vstack(waves), ("inertia", "slope", *gravity))
        if not has_ripple:
            return regression
        first, others = regression._with_waves(np.arange(2)), np.arange(2, N_WAVES)
        return first._with_waves(others[harmonic_peaks(first.y - first.A @ first.solve()[0], first.waves[:, others])])

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Return numbers (n_x,) and covariance (n_x, n_x)."""
        size = np.linalg.norm(self.A, axis=0)
        size[size == 0] = 1.0
        inverse = np.linalg.pinv(self.A / size, rcond=1e-10) / size[:, None]
        values = inverse @ self.y
        autocovariance = self._autocovariance(self.y - self.A @ values)
        # Friction torques change more slowly than the residuals decorrelate: their long-run variance applies.
        long_run = autocovariance[0] + 2 * float(autocovariance[1:].sum())
        # Every number takes its share of the long-run variance from each autocovariance of the residuals.
        return values, (1 + (2 * len(autocovariance) - 1) * len(values) / len(self.y)) * long_run * inverse @ inverse.T

    def _with_waves(self, waves: IntArray) -> "PassRegression":
        columns = [column for i in waves for column in (self.waves[:, i].real, self.waves[:, i].imag)]
        names = [name for i in waves.tolist() for name in wave_names(i)]
        return replace(self, A=np.column_stack([self.A, *columns]), shared=(*self.shared, *names))

    def _autocovariance(self, residual: FloatArray) -> FloatArray:
        """Return autocovariance of all passes' residuals, by lag in rows, up to the first not above chance."""
        values = [float(residual @ residual / len(residual))]
        for lag in range(1, min(201, len(residual))):
            same_pass = self.pass_index[lag:] == self.pass_index[:-lag]
            count, total = int(same_pass.sum()), float(residual[lag:] @ (residual[:-lag] * same_pass))
            if not count or total / count < 2 * values[0] / np.sqrt(count):
                break
            values.append(total / count)
        return np.array(values)


def harmonic_peaks(residual: FloatArray, waves: ComplexArray) -> BoolArray:
    """Return True for each of the waves (n, n_h) that stands out of the residuals (n,)."""
    size = np.sum(np.abs(waves) ** 2, axis=0)
    power = np.abs(residual @ waves) ** 2 / np.maximum(size, 1e-300)
    # Of noise the power is exponential, its median ln 2 of its mean: 12 means have a chance of 6e-6 each.
    return np.asarray((power > 12.0 / np.log(2) * np.median(power)) & (size > 0.01 * len(residual)))


def turn_waves(
    position: FloatArray, direction: FloatArray | float, turn: float, numbers: Iterable[int] = range(N_WAVES)
) -> ComplexArray:
    """Return exp(j h N q) (n, n_h), chosen waves of the motor's turns: ripple, then s times these, dry friction."""
    waves = [np.exp(2j * np.pi / turn * (i % MAX_HARMONIC + 1) * position) for i in numbers]
    signs = [1.0 if i < MAX_HARMONIC else direction for i in numbers]
    signed_waves = [sign * wave for sign, wave in zip(signs, waves, strict=True)]
    return np.stack(signed_waves, axis=1) if signed_waves else np.zeros((len(position), 0), complex)


def wave_names(wave: int) -> tuple[str, str]:
    """Return names of the cosine and sine of a wave of the motor's turns."""
    name = f"{'ripple' if wave < MAX_HARMONIC else 'angle.turn'}.{wave % MAX_HARMONIC + 1}"
    return f"{name}c", f"{name}s"


def passes_of(record: FrictionRecord) -> tuple[Pass, ...]:
    """Return there and back of one record of passes, as one pair; whichever of both it has."""
    # Gravity and inertia are those where the torque acts: half a sample's travel turns both with the direction.
    samples = np.arange(len(record.position))
    lag = samples + record.torque_delay_s * record.rate_hz
    motion = record.position, *smooth_motion(record, SMOOTHED_HZ)[1:]
    position, velocity, acceleration = (np.interp(lag, samples, x) for x in motion)
    pair, passes = f"{record.name}, load {record.load}" if record.load else record.name, list[Pass]()
    for start, stop in (window for window in (record.there, record.back) if window is not None):
        # Into the ends of a plateau the filter brings the ramps; of a short one at most a tenth each.
        margin = min(int(record.rate_hz / SMOOTHED_HZ) + 1, (stop - start) // 10)
        part = slice(start + margin, stop - margin)
        degc = np.zeros(0) if record.temperature is None else record.temperature[part]
        measured = degc[np.isfinite(degc)]
        passes.append(
            Pass(
                f"joint {record.joint}", pair, position[part], velocity[part], acceleration[part], record.torque[part],
                record.load_torque, float(measured.mean()) if len(measured) else np.nan, record.slides, record.load
            )
        )  # fmt: skip
    return tuple(passes)


@frozen_value
class FrictionCurve:
    """Friction of one location (joint or motor) at n conditions of steady sliding, on its own side of the gear, SI.

    speed (n,): |v|, positive.  direction (n,): 1, -1, or 0 if the torque is the mean of both directions.
    torque (n,): friction torque with viscous friction, positive if it brakes.  std (n,): of torque.  load (n,):
    |torque| on the joint, 0 if unknown.  temperature (n,): degC, NaN if unknown.  shared: value and std of parameters
    that all runs share, by name (`inertia`, `gravity.cos`, `gravity.sin`, `offset`, ripple).  notes: on discarded runs.

    Raises DataError for friction that drives at every condition.
    """

    place: str
    speed: FloatArray
    direction: FloatArray
    torque: FloatArray
    std: FloatArray
    load: FloatArray
    temperature: FloatArray
    slides: bool = False
    shared: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        if len(self.torque) and np.all(self.torque < 0):
            raise DataError(
                "friction/constant-velocity", NEGATIVE.format(self.torque.min()), f"friction torques of {self.place}"
            )

    @property
    def n_conditions(self) -> int:
        """Number of conditions."""
        return len(self.speed)

    @property
    def measured_temperatures(self) -> FloatArray:
        """Temperatures of the torques that have one, degC."""
        return self.temperature[np.isfinite(self.temperature)]

    @property
    def conditions(self) -> Conditions:
        """Conditions of the measured torques."""
        return Conditions(self.speed, self.direction, self.load, self.temperature)


def estimate_friction_curve(passes: Sequence[Pass], has_gravity: bool, turn: float = 0.0) -> FrictionCurve:
    """Return the friction torques of all pairs of one place, by direction.

    has_gravity: True if its torque changes with the angle.  turn: of the joint for one of the motor, whose ripple is
    regressed too; 0 for none.  DataError where a pair has one direction only, or no pair slides.
    """
    sliding, notes = _sliding(passes)
    pairs = {test.pair: [back for back in sliding if back.pair == test.pair] for test in sliding}
    place = sliding[0].place
    for name, members in pairs.items():
        if len({test.direction for test in members}) < 2:
            text = (
                "it has one direction only; friction cannot be distinguished from gravity and offset without the way "
                "back; record both directions"
            )
            raise DataError("friction/constant-velocity", text, f"pass {name} of {place}")
    design, n_k = PassRegression.of(sliding, has_gravity, turn), len(pairs)
    values, covariance = design.solve()
    stds = np.sqrt(np.diag(covariance))
    states = [[(np.abs(test.velocity).mean(), test.load, test.temperature) for test in pair] for pair in pairs.values()]
    conditions = np.array([np.mean(pair, axis=0) for pair in states])
    g, o = values[:n_k], slice(n_k, 2 * n_k)
    uneven, offset = _uneven_offset(values[o], covariance[o, o], conditions[:, 0])
    if not np.any(stds[:n_k] < MAX_RELATIVE_STD * np.abs(g)):
        text = (
            f"no friction torque has a std below {MAX_RELATIVE_STD:.0%}: gravity, ripple or noise are too large. "
            "Repeat the runs, or make them longer"
        )
        raise DataError("friction/constant-velocity", text, f"passes of {place}")
    numbers = zip(values[2 * n_k :].tolist(), stds[2 * n_k :].tolist(), strict=True)
    shared_numbers = dict(zip(design.shared, numbers, strict=True)) | {"offset": offset}
    # By direction where the directions differ, else their means.
    signs = (1.0, -1.0) if uneven.any() else (0.0,)
    speed, load, temperature = np.tile(conditions.T, len(signs))
    torque, std = np.concatenate([g + s * uneven for s in signs]), np.tile(stds[:n_k] * np.sqrt(len(signs)), len(signs))
    directions, slides = np.repeat(signs, n_k), sliding[0].slides
    return FrictionCurve(place, speed, directions, torque, std, load, temperature, slides, shared_numbers, tuple(notes))


def _sliding(passes: Sequence[Pass]) -> tuple[list[Pass], list[Note]]:
    """Return constant-velocity runs that always slide, in pairs, and notes on the others; DataError without any."""
    sticks = dict.fromkeys(part.pair for part in passes if np.any(part.velocity * part.direction <= 0))
    text = (
        "the joint stops or reverses during the run (stick-slip at this speed), so that the run is discarded. "
        "Raise the bandwidth of the controller, or measure at a higher speed"
    )
    sliding = [part for part in passes if part.pair not in sticks]
    if not sliding:
        raise DataError("friction/constant-velocity-runs", f"no run is usable: {text}", f"passes of {passes[0].place}")
    return sliding, [Note("friction/constant-velocity-runs", text, f"pass {name}") for name in sticks]


def _uneven_offset(o: FloatArray, covariance: FloatArray, v: FloatArray) -> tuple[FloatArray, tuple[float, float]]:
    """Return excess friction forwards (n_k,), a slope of o over speed if significant, and the offset with its std."""
    W = np.linalg.inv(np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) / len(o) * np.eye(len(o))))

    def fitted(*columns: FloatArray) -> Optimum:
        A = W @ np.stack(columns, axis=1)
        x = np.linalg.lstsq(A, W @ o, rcond=None)[0]
        residual = W @ o - A @ x
        return Optimum(np.asarray(x), float(residual @ residual), A, residual)

    fit, slope = fitted(np.ones_like(v)), 0.0
    if len(o) >= 4 and np.ptp(v) > 0:
        line = fitted(np.ones_like(v), v)
        if terms_p_value(fit.cost, line.cost, 1, line.dof) <= FALSE_ALARM:
            fit, slope = line, float(line.x[1])
    return slope * v, (float(fit.x[0]), float(np.sqrt(fit.covariance[0, 0])))
