r"""Positions predicted from the commands alone, beside predictors that need no model, and tests of the replay.

The torque is that of the joint controllers, u = kp (r - q) + kd (r' - q'), computed by drives that are faster than the
log and hold each command r until the next one. No torque of the log is needed.

.. math:: e_j = \sqrt{\overline{(q_j - \hat q_j)^2}}

Three trivial predictors: the joint stands still, :math:`\hat q_j(t) = q_j(0)`; it is where it was told to be,
:math:`\hat q_j(t) = r_j(t)`; or it is there one delay later, :math:`\hat q_j(t) = r_j(t - T_j)`, T_j fitted to the log.

Each test repeats the simulation with one number changed: the period of the log by a factor, a delay of the commands,
the gains by a factor, or the sign of one joint. A number is in doubt if another value of it removes more than half of
the mean square error, and differs by more than the unknown sampling of the drives can explain.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.experiment.simulated.plant import Plant, true_plant
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.record import Configuration, JointLoop, motion_unit
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands
from elastid.simulation.spec import ControllerSpec
from elastid.validation.simulation import LONGEST_S, simulate_tracking
from elastid.validation.torque_balance import octave_lines

# Typical rate of the controllers in drives: a slower one has half a sample more delay from hold and difference.
DRIVE_HZ: Final = 2000.0
# Fraction of the mean square error above which another value of a tested number puts it in doubt.
MAX_REMOVED: Final = 0.5
# By how much a tested number may differ: by delays of drives of 1 kHz in s, and as much in the factors.
TOLERANCE: Final = {"delay": 1e-3, "clock": 0.04, "kp": 0.04, "kd": 0.04}
# Error over that of the best trivial predictor, above which the signs of a joint are tested.
MIN_WEAK: Final = 0.5
PREDICTORS: Final = ("model", "still", "command", "late command")
# Ends in Hz, and the rms error of each predictor.
Octave: TypeAlias = tuple[float, float, tuple[float, ...]]
Quantity: TypeAlias = Literal["clock", "delay", "kp", "kd", "position sign", "joint direction"]


@frozen_value
class CommandedMotion:
    """Commands, commanded velocities and positions (n, n_u) of a log at rate_hz, and the gains of its controllers.

    delay_s: known delay of the commands.  controller: with filters behind the feedback, if any are known.  offsets:
    constant torques against the joints, link side; none if empty.
    """

    name: str
    rate_hz: float
    command: FloatArray
    velocity: FloatArray
    position: FloatArray
    gains: JointLoop
    delay_s: float = 0.0
    controller: ControllerSpec = ControllerSpec()
    offsets: tuple[float, ...] = ()

    def first(self, seconds: float) -> "CommandedMotion":
        """Return the motion up to a duration."""
        n = round(seconds * self.rate_hz)
        return replace(self, command=self.command[:n], velocity=self.velocity[:n], position=self.position[:n])


@dataclass(frozen=True)
class Change:
    """Numbers of a replay: factors of the log's period and of the gains, and a further delay of the commands in s."""

    clock: float = 1.0
    delay: float = 0.0
    kp: float = 1.0
    kd: float = 1.0


@frozen_value
class JointError:
    """Rms errors of one joint by predictor, and by octave upwards: ends in Hz, then errors of each predictor.

    delay_s: of the late command.
    """

    joint: str
    unit: str
    rms: tuple[float, ...]
    octaves: tuple[Octave, ...]
    delay_s: float

    @property
    def is_worse(self) -> bool:
        """True if a trivial predictor predicts at least as well as the model."""
        return self.rms[0] >= min(self.rms[1:])


@frozen_value
class Tested:
    """A number of the replay with the value that predicts best, and the rms error with it and as given.

    joint: whose sign it is; its error alone counts then.
    """

    quantity: Quantity
    value: float
    rms: float
    rms_as_given: float
    joint: str = ""

    @property
    def removed(self) -> float:
        """Fraction of the mean square error that the value removes."""
        return 1 - (self.rms / max(self.rms_as_given, 1e-300)) ** 2

    @property
    def is_in_doubt(self) -> bool:
        """True if the value removes most of the error and differs from the given number by more than TOLERANCE."""
        nominal = getattr(Change(), self.quantity, 1.0)
        return self.removed > MAX_REMOVED and abs(self.value - nominal) > TOLERANCE.get(self.quantity, 0.0)


@frozen_value
class Replay:
    """A log with its prediction (n, n_u), errors by joint, and the tests."""

    log: str
    rate_hz: float
    measured: FloatArray
    predicted: FloatArray
    joints: tuple[JointError, ...]
    tests: tuple[Tested, ...] = ()


def replay(robot: Robot, motion: CommandedMotion, with_tests: bool = True) -> Replay:
    """Predict the positions of a log, at most LONGEST_S of it, from its commands, and test the numbers of the replay.

    Raises DataError if the robot leaves its commands by more than a turn, StudyError for a mode that is too fast.
    """
    motion = motion.first(LONGEST_S)
    plant = drive_plant(robot, motion)
    predicted = predict(plant, motion)
    joints = tuple(_joint_error(robot, motion, predicted, i) for i in range(predicted.shape[1]))
    weak = [i for i, row in enumerate(joints) if row.rms[0] > MIN_WEAK * min(row.rms[1:])]
    tests = (*_tests(plant, motion, predicted), *_signs(plant, motion, predicted, weak)) if with_tests else ()
    return Replay(motion.name, motion.rate_hz, motion.position, predicted, joints, tests)


def drive_plant(robot: Robot, motion: CommandedMotion) -> Plant:
    """Return the robot under controllers at a multiple of the log's rate, at rest where the motion starts."""
    rate_hz = math.ceil(DRIVE_HZ / motion.rate_hz - 1e-9) * motion.rate_hz
    start = Configuration(motion.name, motion.position[0])
    # Each of the tests simulates the whole log.
    calls = 50 * round(len(motion.position) * rate_hz / motion.rate_hz)
    spec = SimulatedSpec(compiled=True, controller=motion.controller)
    return true_plant(robot, spec, rate_hz, start, samples=calls, is_free=True)


def predict(plant: Plant, motion: CommandedMotion, change: Change | None = None) -> FloatArray:
    """Return positions (n, n_u) at the samples of a log, from its commands alone."""
    change, (n, n_u) = change or Change(), motion.command.shape
    period_s, drive_s = change.clock / motion.rate_hz, 1 / plant.loop.rate_hz
    ticks = math.ceil(n * period_s / drive_s - 1e-9)
    edges = np.arange(ticks + 1) * drive_s - change.delay - motion.delay_s
    command = _zoh_means(motion.command, edges, period_s)
    velocity = _zoh_means(motion.velocity / change.clock, edges, period_s)
    zeros = np.zeros_like(command)
    gains = JointLoop(motion.gains.kp * change.kp, motion.gains.kd * change.kd, motion.gains.ki)
    commands = Commands(command, velocity, zeros - np.array(motion.offsets or 0.0), zeros, zeros)
    trajectory = simulate_tracking(plant, commands, np.ones(n_u, bool), gains, motion.position[0], np.zeros(n_u))
    samples = np.arange(n) * period_s / drive_s
    return np.stack([np.interp(samples, np.arange(ticks), reading) for reading in trajectory.reading.T], axis=1)


def _zoh_means(signal: FloatArray, edges: FloatArray, period_s: float) -> FloatArray:
    """Return means (m, n_u) between times (m + 1,) of a signal (n, n_u) whose samples are held for a period each."""
    knots = np.arange(len(signal) + 1) * period_s
    integral = np.vstack([np.zeros((1, signal.shape[1])), np.cumsum(signal, axis=0) * period_s])
    inside = np.stack([np.interp(edges, knots, column) for column in integral.T], axis=1)
    before, after = np.minimum(edges, 0.0)[:, None] * signal[0], np.maximum(edges - knots[-1], 0.0)[:, None]
    return np.asarray(np.diff(before + inside + after * signal[-1], axis=0) / np.diff(edges)[:, None])


# Values of each tested number, between which the best one is searched: factors, and seconds.
_FACTORS = tuple((2.0 ** np.arange(-3, 4)).tolist())
_GRIDS: dict[Literal["clock", "delay", "kp", "kd"], tuple[float, ...]] = {
    "clock": _FACTORS, "delay": tuple((0.02 * np.arange(-1, 9)).tolist()), "kp": _FACTORS, "kd": _FACTORS
}  # fmt: skip


def _tests(plant: Plant, motion: CommandedMotion, predicted: FloatArray) -> Iterator[Tested]:
    """Yield the best value of each number: the best of its grid, then by Brent's method beside it."""
    from scipy.optimize import minimize_scalar  # takes a while

    for name, grid in _GRIDS.items():
        error = partial(_error_with, plant, motion, name)
        nominal_rms, nominal = _rms(motion.position - predicted), getattr(Change(), name)
        errors = [nominal_rms if x == nominal else error(x) for x in grid]
        i = int(np.argmin(errors))
        ends = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
        best = minimize_scalar(error, bounds=ends, method="bounded", options={"maxiter": 8})
        value, rms = min((grid[i], errors[i]), (float(best.x), float(best.fun)), key=lambda pair: pair[1])
        yield Tested(name, value, rms, nominal_rms)


def _error_with(plant: Plant, motion: CommandedMotion, name: str, value: float) -> float:
    try:
        return _rms(motion.position - predict(plant, motion, replace(Change(), **{name: value})))
    except DataError:  # the robot leaves its commands
        return math.inf


def _signs(plant: Plant, motion: CommandedMotion, predicted: FloatArray, joints: Sequence[int]) -> Iterator[Tested]:
    """Yield some joints with the other sign of the position, and of position and command."""
    for i in joints:
        joint = plant.model.robot.driven_names[i]
        sign = np.where(np.arange(len(predicted[0])) == i, -1.0, 1.0)
        positions = replace(motion, position=sign * motion.position)
        directions = replace(positions, command=sign * motion.command, velocity=sign * motion.velocity)
        nominal_rms = _rms(motion.position[:, i] - predicted[:, i])
        changes: dict[Quantity, CommandedMotion] = {"position sign": positions, "joint direction": directions}
        for quantity, other in changes.items():
            try:
                yield Tested(quantity, -1.0, _rms((other.position - predict(plant, other))[:, i]), nominal_rms, joint)
            except DataError:  # the robot leaves its commands
                continue


def pooled_tests(replays: Sequence[Replay]) -> tuple[Tested, ...]:
    """Return the tests of several logs as one, the median of each value; the best explanation first."""
    families: dict[tuple[str, str], list[Tested]] = {}
    for test in (test for log in replays for test in log.tests):
        families.setdefault((test.quantity, test.joint), []).append(test)
    pooled = []
    for rows in families.values():
        value = float(np.median([test.value for test in rows]))
        rms, nominal_rms = np.sqrt(np.mean([(test.rms**2, test.rms_as_given**2) for test in rows], axis=0)).tolist()
        pooled.append(replace(rows[0], value=value, rms=rms, rms_as_given=nominal_rms))
    return tuple(sorted(pooled, key=lambda test: -test.removed))


def pooled_joints(replays: Sequence[Replay]) -> tuple[JointError, ...]:
    """Return errors of each joint over several logs; by octave if all have one rate and duration, else of the first."""
    return tuple(
        replace(
            rows[0],
            rms=overall(rows),
            octaves=pooled_octaves(rows),
            delay_s=float(np.median([r.delay_s for r in rows])),
        )
        for rows in zip(*(log.joints for log in replays), strict=True)
    )


def pooled_octaves(rows: Sequence[JointError]) -> tuple[Octave, ...]:
    """Return errors by octave over all rows with the same octaves as the first row."""
    ends = [octave[:2] for octave in rows[0].octaves]
    octaves = [row.octaves for row in rows if [octave[:2] for octave in row.octaves] == ends]
    errors = (_mean_square_root([octave[2] for octave in members]) for members in zip(*octaves, strict=True))
    return tuple((low, high, rms) for (low, high), rms in zip(ends, errors, strict=True))


def overall(joints: Sequence[JointError]) -> tuple[float, ...]:
    """Return rms error over all joints, by predictor."""
    return _mean_square_root([row.rms for row in joints])


def _mean_square_root(rows: Sequence[tuple[float, ...]]) -> tuple[float, ...]:
    return tuple(np.sqrt(np.mean(np.square(rows), axis=0)).tolist())


def _joint_error(robot: Robot, motion: CommandedMotion, predicted: FloatArray, i: int) -> JointError:
    joint, measured, command = robot.driven[i], motion.position[:, i], motion.command[:, i]
    delay_s, late = _late_command(measured, command, motion.rate_hz)
    errors = [measured - x for x in (predicted[:, i], measured[0], command, late)]
    octaves = tuple(_by_octave(np.stack(errors), motion.rate_hz))
    return JointError(joint.name, motion_unit("position", joint.slides), tuple(map(_rms, errors)), octaves, delay_s)


def _late_command(measured: FloatArray, command: FloatArray, rate_hz: float) -> tuple[float, FloatArray]:
    """Return the delay in s, from 0 to 2 s, by which a command (n,) fits the position best, and the late command."""
    from scipy.optimize import minimize_scalar  # takes a while

    rows = np.arange(len(command), dtype=float)

    def error(samples: float) -> float:
        return _rms(measured - np.interp(rows - samples, rows, command))

    shifts = np.arange(min(len(command) // 4, round(2 * rate_hz)) + 1)
    nearest = float(shifts[int(np.argmin([error(float(d)) for d in shifts]))])
    ends = max(nearest - 1, 0.0), nearest + 1
    samples = min(nearest, float(minimize_scalar(error, bounds=ends, method="bounded").x), key=error)
    return samples / rate_hz, np.interp(rows - samples, rows, command)


def _by_octave(errors: FloatArray, rate_hz: float) -> Iterator[Octave]:
    """Yield rms of errors (p, n) in octaves below half the rate, by Hann's window."""
    n = errors.shape[1]
    window = np.hanning(n + 1)[:-1]
    power = np.abs(np.fft.rfft(window * errors)) ** 2 / (n * np.sum(window**2))
    power[:, 1:] *= 2
    for low, high, lines in octave_lines((0.0, rate_hz / 2), rate_hz, n):
        yield low, high, tuple(np.sqrt(power[:, lines].sum(axis=1)).tolist())


def _rms(x: FloatArray) -> float:
    return math.sqrt(np.mean(np.square(x)))
