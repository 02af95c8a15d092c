r"""Logs of a warm-up as heat: power and temperature in steps of seconds, and the test passes that the motion contains.

.. math:: P_k = \frac{1}{\Delta t} \int_k^{k+1} u\, dq

The work of the torque over a step is kept whatever its length: inertia and gravity store energy and give it back, so
that over a motion to and fro friction alone is left, and of hours a few hundred steps say all that a joint feels.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.logs import FileSpec
from elastid.friction_record import FrictionRecord, WarmUpLog
from elastid.friction_study.motion_signals import alike_speeds, detect_passes
from elastid.logs.repair.masks import step

STEP_S = 10.0  # of constant power, at least: several cycles of a motion
MAX_STEPS = 500  # of one log
MIN_STEPS = 30  # of all logs together; five minutes warm no gear
GROUPS = 24  # of test passes, as of a designed warm-up of two hours with tests each five minutes
MIN_GROUPS = 6  # in which a speed must occur: a level's course has three numbers
MAX_RETURN = 0.99  # fraction of the travel from the first to the last position: above, no way back
PER_COUNT = 2.0  # readings for each count of a coarse thermometer: within one they are no noise
MIN_READINGS = 10
START_STD = 1.0  # prior std of the initial temperature, K


def heating_history(record: FrictionRecord) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the heat of a log: times (n + 1,) in s, power (n,) between them in W, temperatures (n + 1,) in degC.

    Raises DataError if the joint does not return to its start, or if its torque does no positive work.
    """
    q, u, rate_hz = record.position, record.torque, record.rate_hz
    n = max(1, min(MAX_STEPS, int(len(q) / rate_hz / STEP_S)))
    edges = np.linspace(0, len(q) - 1, n + 1).round().astype(int)
    # A zero-order-hold torque is constant until the next sample; a band-limited torque changes linearly.
    acting = u[:-1] if record.hold == "zero-order" else (u[:-1] + u[1:]) / 2
    work = np.append(0.0, np.cumsum(acting * np.diff(q)))[edges]
    if abs(q[-1] - q[0]) > MAX_RETURN * np.ptp(q):
        text = f"it moves from {q[0]:.4g} to {q[-1]:.4g} {record.unit} without return, so that the work of gravity and"
        raise _warm_up_error(record, text + " the heat are confounded. Log a motion to and fro")
    if work[-1] <= 0:
        text = f"its torque extracts {-work[-1]:.4g} J from the motion, so that friction would accelerate the joint"
        raise _warm_up_error(record, text + ". Correct the sign of torque or position")
    T = record.temperature
    temperature = np.full(n + 1, np.nan) if T is None else _edge_means(T, edges)
    return record.start_s + edges / rate_hz, np.diff(work) / (np.diff(edges) / rate_hz), temperature


def _warm_up_error(record: FrictionRecord, text: str) -> DataError:
    return DataError("friction/warm-up", text, f"{record.place}: warm-up of joint {record.joint}")


def _edge_means(x: FloatArray, edges: np.ndarray) -> FloatArray:
    """Compute means (n + 1,) of the samples within half a step of each edge."""
    sums, middles = np.append(0.0, np.cumsum(x - x[0])), (edges[:-1] + edges[1:]) // 2 + 1
    low, high = np.append(0, middles), np.append(middles, len(x))
    return np.asarray(x[0] + (sums[high] - sums[low]) / (high - low))


def find_test_passes(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """Find constant-velocity test runs: for each stated or recurring speed, the first run in each part of the log."""
    min_count = 1 if record.speed is not None else MIN_GROUPS
    passes = detect_passes(record, has_gravity)
    speeds = alike_speeds(np.array([p.speed for p in passes], np.float64)).tolist()
    length = max(record.duration_s / GROUPS, 1e-9)
    firsts: dict[float, dict[int, FrictionRecord]] = {}
    for speed, test in zip(speeds, passes, strict=True):
        firsts.setdefault(speed, {}).setdefault(int((test.start_s - record.start_s) / length), test)
    usable = [p for groups in firsts.values() if len(groups) >= min_count for p in groups.values()]
    return tuple(replace(p, is_warm_up=True) for p in sorted(usable, key=lambda p: p.start_s))


def join_warm_up_logs(records: Sequence[FrictionRecord], files: Sequence[FileSpec]) -> WarmUpLog:
    """Join all logs of the warm-up of one joint, with zero power in the pauses, and with the temperatures of `files`.

    Raises DataError if logs overlap, are too short for any gear, or have a constant temperature.
    """
    joint, start = records[0].joint, files[0].temperature
    heats = [heating_history(record) for record in records]
    ambient = next((float(file.ambient) for file in files if file.ambient is not None), float("nan"))
    time_s, power, temperature = heats[0]
    for record, (next_s, next_power, next_readings) in zip(records[1:], heats[1:], strict=True):
        pause = float(next_s[0] - time_s[-1])
        if pause < -1.5 / record.rate_hz:
            text = f"it starts at {next_s[0]:.4g} s, before the end of the previous log at {time_s[-1]:.4g} s"
            raise DataError("friction/warm-up", text + ". Correct start, or the order of the files", record.place)
        first = 0 if pause > 1.5 / record.rate_hz else 1
        power = np.concatenate([power, np.zeros(1 - first), next_power])
        time_s, temperature = np.append(time_s, next_s[first:]), np.append(temperature, next_readings[first:])
    span, min_span, valid = float(time_s[-1] - time_s[0]), MIN_STEPS * STEP_S, np.isfinite(temperature)
    count = max(0.0 if record.temperature is None else step(record.temperature) for record in records)
    if span < min_span:
        text = f"{span:.4g} s are too short for a warm-up; gears need 10 to 60 minutes. Log at least {min_span:g} s"
        raise _warm_up_error(records[0], text + ", better two hours, or set purpose: motion")
    if not valid.any():
        return WarmUpLog(joint, time_s, power, temperature, 0.0, ambient, ambient if start is None else start)
    if np.ptp(temperature[valid]) < max(count, 1e-9):
        text = f"the thermometer reads {temperature[valid][0]:.4g} degC throughout while {power.mean():.3g} W heat the"
        advice = "Omit its channel (test runs show the heat as well), or mount the sensor at the joint"
        raise _warm_up_error(records[0], f"{text} joint. {advice}")
    noise = float(np.std(np.diff(temperature[valid], 2)) / np.sqrt(6))  # of white noise on a slow signal
    std, at_start = max(noise, count / np.sqrt(12)), float(temperature[valid][0])
    if noise < count / np.sqrt(12):  # readings of one count have one error
        max_count = max(MIN_READINGS, int(PER_COUNT * np.ptp(temperature[valid]) / count))
        temperature = np.where(np.cumsum(valid) % max(1, valid.sum() // max_count) == 0, temperature, np.nan)
    return WarmUpLog(joint, time_s, power, temperature, std, ambient, at_start, max(START_STD, 3 * std))
