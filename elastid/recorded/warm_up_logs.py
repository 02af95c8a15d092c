r"""Logs of a warm-up as heat: power and temperature in steps of seconds, and the test passes that the motion contains.

. math:: P_k = \frac{1}{\Delta t} \int_k^{k+1} u\, dq

The work of the torque over a step is kept whatever its length: inertia and gravity store energy and give it back, so
that over a motion to and fro friction alone is left, and of hours a few hundred steps say all that a joint feels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.friction_study.motion_signals import alike_speeds, detect_passes
from elastid.record import FrictionRecord, WarmUpLog
from elastid.recorded.repair.converter import step


@dataclass(frozen=True)
class WarmUpLogLimits:
    """Limits of logs of warm-ups.  False alarms of 12 logs: 0 refusals."""

    step_s: float = 10.0  # of constant power, at least: several cycles of a motion
    max_steps: int = 500  # of one log
    min_steps: int = 30  # of all logs together; five minutes warm no gear
    groups: int = 24  # of test passes, as of a designed warm-up of two hours with tests each five minutes
    min_groups: int = 6  # in which a speed must occur: a level's course has three numbers
    max_return: float = 0.99  # share of the travel from the first to the last position: above, no way back
    per_count: float = 2.0  # readings for each count of a coarse thermometer: within one they are no noise
    min_readings: int = 10
    start_std: float = 1.0  # K, of the temperature at the start, before readings are fitted


LIMITS = WarmUpLogLimits()


@frozen_value
class Heat:
    """Heat in one log: power (n,), W, between time_s (n + 1,), readings (n + 1,), degC, of a step of `count`."""

    time_s: FloatArray
    power: FloatArray
    readings: FloatArray
    count: float


def heat_of(record: FrictionRecord) -> Heat:
    """The log in steps; DataError where the joint never returns, or its torque does no work on it."""
    q, u, rate_hz = record.position, record.torque, record.rate_hz
    where = f"{record.place}: warm-up of joint {record.joint}"
    if abs(q[-1] - q[0]) > LIMITS.max_return * np.ptp(q):
        raise DataError(
            "friction/warm-up",
            f"it moves from {q[0]:.4g} to {q[-1]:.4g} {record.unit} and never returns, so that the work "
            "of gravity cannot be distinguished from heat; log a motion to and fro",
            where,
        )
    n = max(1, min(LIMITS.max_steps, int(len(q) / rate_hz / LIMITS.step_s)))
    edges = np.linspace(0, len(q) - 1, n + 1).round().astype(int)
    # A held torque acts until the next sample, a band-limited one changes on the way.
    acting = u[:-1] if record.hold == "zero-order" else (u[:-1] + u[1:]) / 2
    work = np.append(0.0, np.cumsum(acting * np.diff(q)))[edges]
    if work[-1] <= 0:
        raise DataError(
            "friction/warm-up",
            f"its torque takes {-work[-1]:.4g} J out of the motion: friction would drive the joint; correct "
            "the sign of torque or position",
            where,
        )
    T = record.temperature
    readings = np.full(n + 1, np.nan) if T is None else _means(T, edges)
    power = np.diff(work) / (np.diff(edges) / rate_hz)
    return Heat(record.start_s + edges / rate_hz, power, readings, 0.0 if T is None else step(T))


def _means(x: FloatArray, edges: np.ndarray) -> FloatArray:
    """Means (n + 1,) of the samples within half a step of each edge."""
    sums, middles = np.append(0.0, np.cumsum(x - x[0])), (edges[:-1] + edges[1:]) // 2 + 1
    low, high = np.append(0, middles), np.append(middles, len(x))
    return np.asarray(x[0] + (sums[high] - sums[low]) / (high - low))


def tests_in(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """Test passes: of each speed that is stated, or occurs throughout the log, the first pass in each of its parts."""
    least = 1 if record.speed is not None else LIMITS.min_groups
    passes = detect_passes(record, has_gravity)
    speeds = alike_speeds(np.array([each.speed for each in passes], dtype=np.float64)).tolist()
    length = max(record.duration_s / LIMITS.groups, 1e-9)
    firsts: dict[float, dict[int, FrictionRecord]] = {}
    for speed, each in zip(speeds, passes, strict=True):
        firsts.setdefault(speed, {}).setdefault(int((each.start_s - record.start_s) / length), each)
    usable = [each for groups in firsts.values() if len(groups) >= least for each in groups.values()]
    return tuple(replace(each, is_warm_up=True) for each in sorted(usable, key=lambda each: each.start_s))


def warm_up_log(
    records: Sequence[FrictionRecord], heats: Sequence[Heat], ambient: float | None, start: float | None
) -> WarmUpLog:
    """All logs of one joint's warm-up, at rest in between; ambient, start: degC as stated.

    DataError where they overlap, are too short for any gear, or a thermometer reads the same throughout.
    """
    joint, place = records[0].joint, f"{records[0].place}: warm-up of joint {records[0].joint}"
    room = float("nan") if ambient is None else ambient
    time_s, power, readings = heats[0].time_s, heats[0].power, heats[0].readings
    for record, heat in zip(records[1:], heats[1:], strict=True):
        pause = float(heat.time_s[0] - time_s[-1])
        if pause < -1.5 / record.rate_hz:
            raise DataError(
                "friction/warm-up",
                f"it starts at {heat.time_s[0]:.4g} s, and the log before it ends at {time_s[-1]:.4g} "
                "s; correct start, or the order of the files",
                record.place,
            )
        first = 0 if pause > 1.5 / record.rate_hz else 1
        power = np.concatenate([power, np.zeros(1 - first), heat.power])
        time_s, readings = np.append(time_s, heat.time_s[first:]), np.append(readings, heat.readings[first:])
    span = float(time_s[-1] - time_s[0])
    least = LIMITS.min_steps * LIMITS.step_s
    if span < least:
        raise DataError(
            "friction/warm-up",
            f"{span:.4g} s are no warm-up: gears take 10 to 60 minutes; log {least:g} s at least, better two "
            "hours, or take purpose: motion",
            place,
        )
    read, count = np.isfinite(readings), max(heat.count for heat in heats)
    if not read.any():
        return WarmUpLog(joint, time_s, power, readings, 0.0, room, room if start is None else start)
    if np.ptp(readings[read]) < max(count, 1e-9):
        raise DataError(
            "friction/warm-up",
            f"the thermometer reads {readings[read][0]:.4g} degC throughout, while {power.mean():.3g} W warm "
            "the joint; it is stuck or elsewhere: leave its channel out, test passes show the heat as well",
            place,
        )
    noise = float(np.std(np.diff(readings[read], 2)) / np.sqrt(6))  # of white noise on a slow signal
    std, at_start = max(noise, count / np.sqrt(12)), float(readings[read][0])
    if noise < count / np.sqrt(12):  # readings of one count have one error
        most = max(LIMITS.min_readings, int(LIMITS.per_count * np.ptp(readings[read]) / count))
        readings = np.where(np.cumsum(read) % max(1, read.sum() // most) == 0, readings, np.nan)
    return WarmUpLog(joint, time_s, power, readings, std, room, at_start, max(LIMITS.start_std, 3 * std))
