r"""Prediction of logged positions from the commands alone, its errors, and tests of the numbers of the simulation.

The torque u = kp (r - q) + kd (r' - q') is the joint controllers', in drives that sample faster than the log, with a
zero-order hold of the commands r. The errors e_j = sqrt(mean (q_j - hat q_j)^2) are compared with three trivial
predictors: the initial position q_j(0), the command r_j(t), and the delayed command r_j(t - T_j) with fitted T_j.

Each test repeats the simulation with another value of one number: period of the log, delay of the commands, a gain, or
the sign of one joint. A number is in doubt if another value removes more than half of the mean square error, and
differs by more than the unknown sampling of the drives explains.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeAlias

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

# Typical rate of the controllers in drives; a slower one has more delay by hold and difference quotient.
DRIVE_HZ = 2000.0
# Largest fraction of the mean square error that another value of a reliable number removes.
MAX_REMOVED = 0.5
# Largest difference of a reliable number: delay of drives of 1 kHz in s, and an equivalent change of the factors.
TOLERANCE = {"delay": 1e-3, "clock": 0.04, "kp": 0.04, "kd": 0.04}
# Least error over the best trivial predictor's with which the signs of a joint are tested.
MIN_WEAK = 0.5
PREDICTORS = ("model", "still", "command", "late command")
# Ends in Hz, and the rms error of each predictor.
Octave: TypeAlias = tuple[float, float, tuple[float, ...]]
Quantity: TypeAlias = Literal["clock", "delay", "kp", "kd", "position sign", "joint direction"]


@frozen_value
class CommandedMotion:
    """Commands, commanded velocities and positions (n, n_u) of a log at rate_hz, rad and rad/s (m, m/s), and gains.

    delay_s: of the commands.  controller: filters behind the feedback.  offsets: constant torques against the joints,
    link side, Nm (N); empty for none.
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
        """Return the first seconds of the motion."""
        n = round(seconds * self.rate_hz)
        return replace(self, command=self.command[:n], velocity=self.velocity[:n], position=self.position[:n])


@dataclass(frozen=True)
class Change:
    """Changes of a replay: factors on the log's period and on the gains, and additional delay of the commands, s."""

    clock: float = 1.0
    delay: float = 0.0
    kp: float = 1.0
    kd: float = 1.0


@frozen_value
class JointError:
    """Rms errors of one joint by predictor, in total and in octaves, and the delay of the delayed command."""

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
class SettingTest:
    """Test of a number of the replay: its best value, and the rms errors with the best and the given value.

    joint: for a sign, the joint whose error is evaluated.
    """

    quantity: Quantity
    value: float
    rms: float
    rms_as_given: float
    joint: str = ""

    @property
    def removed_fraction(self) -> float:
        """Fraction of the mean square error that the best value removes."""
        return 1 - (self.rms / max(self.rms_as_given, 1e-300)) ** 2

    @property
    def is_in_doubt(self) -> bool:
        """True if the best value removes most of the error and differs from the given one by more than TOLERANCE."""
        nominal = getattr(Change(), self.quantity, 1.0)
        return self.removed_fraction > MAX_REMOVED and abs(self.value - nominal) > TOLERANCE.get(self.quantity, 0.0)


@frozen_value
class Replay:
    """Log with measured and predicted positions (n, n_u), errors by joint, and tests."""

    log: str
    rate_hz: float
    measured: FloatArray
    predicted: FloatArray
    joints: tuple[JointError, ...]
    tests: tuple[SettingTest, ...] = ()


def replay(robot: Robot, motion: CommandedMotion, with_tests: bool = True) -> Replay:
    """Predict the positions of at most LONGEST_S of a log from its commands, and test the numbers of the replay.

    Raises DataError if a position differs by more than a turn from its command, StudyError for a mode that is too fast.
    """
    motion = motion.first(LONGEST_S)
    plant = drive_plant(robot, motion)
    predicted = predict(plant, motion)
    joints = tuple(_joint_error(robot, motion, predicted, i) for i in range(predicted.shape[1]))
    weak = [i for i, row in enumerate(joints) if row.rms[0] > MIN_WEAK * min(row.rms[1:])]
    tests = (*_tests(plant, motion, predicted), *_signs(plant, motion, predicted, weak)) if with_tests else ()
    return Replay(motion.name, motion.rate_hz, motion.position, predicted, joints, tests)


def drive_plant(robot: Robot, motion: CommandedMotion) -> Plant:
    """Return the robot with controllers at a multiple of the log's rate, at rest at the start of the motion."""
    rate_hz = math.ceil(DRIVE_HZ / motion.rate_hz - 1e-9) * motion.rate_hz
    start = Configuration(motion.name, motion.position[0])
    # About 50 simulations of the log by the tests.
    samples = 50 * round(len(motion.position) * rate_hz / motion.rate_hz)
    spec = SimulatedSpec(compiled=True, controller=motion.controller)
    return true_plant(robot, spec, rate_hz, start, samples=samples, is_free=True)


def predict(plant: Plant, motion: CommandedMotion, change: Change | None = None) -> FloatArray:
    """Predict the positions (n, n_u) at the samples of a log from its commands alone."""
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
    """Return the means (m, n_u) between times (m + 1,), s, of a signal (n, n_u) with zero-order hold."""
    knots = np.arange(len(signal) + 1) * period_s
    sums = np.vstack([np.zeros((1, signal.shape[1])), np.cumsum(signal, axis=0) * period_s])
    integral = np.stack([np.interp(edges, knots, column) for column in sums.T], axis=1)
    # The first and the last sample extend beyond the log.
    extension = np.minimum(edges, 0.0)[:, None] * signal[0] + integral
    extension = extension + np.maximum(edges - knots[-1], 0.0)[:, None] * signal[-1]
    return np.asarray(np.diff(extension, axis=0) / np.diff(edges)[:, None])


# Grid of each tested number, on which its search starts: factors, and seconds.
_FACTORS = tuple((2.0 ** np.arange(-3, 4)).tolist())
_GRIDS: dict[Literal["clock", "delay", "kp", "kd"], tuple[float, ...]] = {
    "clock": _FACTORS, "delay": tuple((0.02 * np.arange(-1, 9)).tolist()), "kp": _FACTORS, "kd": _FACTORS
}  # fmt: skip


def _tests(plant: Plant, motion: CommandedMotion, predicted: FloatArray) -> Iterator[SettingTest]:
    """Yield the best value of each number, by its grid and then by Brent's method."""
    from scipy.optimize import minimize_scalar  # takes a while

    for name, grid in _GRIDS.items():
        error = partial(_error_with, plant, motion, name)
        nominal_rms, nominal = _rms(motion.position - predicted), getattr(Change(), name)
        errors = [nominal_rms if x == nominal else error(x) for x in grid]
        i = int(np.argmin(errors))
        ends = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
        best = minimize_scalar(error, bounds=ends, method="bounded", options={"maxiter": 8})
        value, rms = min((grid[i], errors[i]), (float(best.x), float(best.fun)), key=lambda pair: pair[1])
        yield SettingTest(name, value, rms, nominal_rms)


def _error_with(plant: Plant, motion: CommandedMotion, name: str, value: float) -> float:
    try:
        return _rms(motion.position - predict(plant, motion, replace(Change(), **{name: value})))
    except DataError:  # the robot leaves its commands
        return math.inf


def _signs(
    plant: Plant, motion: CommandedMotion, predicted: FloatArray, joints: Sequence[int]
) -> Iterator[SettingTest]:
    """Yield tests of joints (indices) with the opposite sign of the position, and of position and command."""
    for i in joints:
        joint = plant.model.robot.driven_names[i]
        sign = np.where(np.arange(len(predicted[0])) == i, -1.0, 1.0)
        positions = replace(motion, position=sign * motion.position)
        directions = replace(positions, command=sign * motion.command, velocity=sign * motion.velocity)
        nominal_rms = _rms(motion.position[:, i] - predicted[:, i])
        changes: dict[Quantity, CommandedMotion] = {"position sign": positions, "joint direction": directions}
        for quantity, variant in changes.items():
            with suppress(DataError):  # the robot leaves its commands
                rms = _rms((variant.position - predict(plant, variant))[:, i])
                yield SettingTest(quantity, -1.0, rms, nominal_rms, joint)


def pooled_tests(replays: Sequence[Replay]) -> tuple[SettingTest, ...]:
    """Return the tests of several logs as one, with the median of each value, the largest removed error first."""
    families: dict[tuple[str, str], list[SettingTest]] = {}
    for test in (test for log in replays for test in log.tests):
        families.setdefault((test.quantity, test.joint), []).append(test)
    pooled = []
    for rows in families.values():
        value = float(np.median([test.value for test in rows]))
        rms, nominal_rms = np.sqrt(np.mean([(test.rms**2, test.rms_as_given**2) for test in rows], axis=0)).tolist()
        pooled.append(replace(rows[0], value=value, rms=rms, rms_as_given=nominal_rms))
    return tuple(sorted(pooled, key=lambda test: -test.removed_fraction))


def pooled_joints(replays: Sequence[Replay]) -> tuple[JointError, ...]:
    """Return the errors of each joint over several logs."""
    joints = []
    for rows in zip(*(log.joints for log in replays), strict=True):
        delay_s = float(np.median([row.delay_s for row in rows]))
        joints.append(replace(rows[0], rms=overall(rows), octaves=pooled_octaves(rows), delay_s=delay_s))
    return tuple(joints)


def pooled_octaves(rows: Sequence[JointError]) -> tuple[Octave, ...]:
    """Return the errors by octave over all rows with the same octaves as the first row."""
    ends = [octave[:2] for octave in rows[0].octaves]
    octaves = [row.octaves for row in rows if [octave[:2] for octave in row.octaves] == ends]
    errors = (_mean_square_root([octave[2] for octave in members]) for members in zip(*octaves, strict=True))
    return tuple((low, high, rms) for (low, high), rms in zip(ends, errors, strict=True))


def overall(joints: Sequence[JointError]) -> tuple[float, ...]:
    """Return the rms error over all joints, by predictor."""
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
    """Return the delay, 0 to 2 s, with which a command (n,) fits the position best, and the delayed command."""
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
    """Yield the rms of errors (p, n) in octaves below half the rate, with Hann's window."""
    n = errors.shape[1]
    window = np.hanning(n + 1)[:-1]
    power = np.abs(np.fft.rfft(window * errors)) ** 2 / (n * np.sum(window**2))
    power[:, 1:] *= 2
    for low, high, lines in octave_lines((0.0, rate_hz / 2), rate_hz, n):
        yield low, high, tuple(np.sqrt(power[:, lines].sum(axis=1)).tolist())


def _rms(x: FloatArray) -> float:
    return math.sqrt(np.mean(np.square(x)))
