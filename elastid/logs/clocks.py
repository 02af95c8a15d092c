"""Clock of a log: the channel of its times by name or by steps, with wrong stamps, unit and rate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, ElastidError
from elastid.experiment.specs.channels import MOTIONS, ChannelSpec
from elastid.logs.channel_names import DRIVES, guess_by_name
from elastid.logs.files.log import Log
from elastid.logs.files.text import TextLog
from elastid.logs.headings import is_time
from elastid.logs.repair import MAX_WRONG_FRACTION
from elastid.logs.repair.masks import MAX_FRACTION, MAX_MISSING_FRACTION
from elastid.logs.repair.time_stamps import MAX_RATE_RATIO, MIN_GAP, even_grid, stamp_line, without_jumps

# Largest number of samples that are read, and least number in a log.
MAX_SAMPLES, MIN_SAMPLES = 1 << 17, 100
_RATES = ("fs", "f_s", "rate_hz", "sample_rate", "samplerate")
_PERIODS = ("ts", "t_s", "sample_time", "sampletime")  # in s
RUNS_BACKWARDS = "runs backwards: it falls from sample to sample"
TIME_UNITS = {unit: 10.0 ** (-3 * i) for i, unit in enumerate(("s", "ms", "us", "ns"))}
MAX_RATE_LOG = 0.26  # largest |log| of the ratio between the rate of stamps (in ms, us or ns) and of the study
_MAX_WRONG_DISTANCE = 5.0  # largest distance of a stamp from the median of its neighbours, in steps of the clock


@dataclass(frozen=True)
class Clock:
    """Rate of a log in Hz, None if unknown, and the name of its time channel.

    is_even: True if the samples need no resampling.
    """

    rate_hz: float | None
    why: str
    name: str = ""
    is_even: bool = True


def is_clock(x: FloatArray) -> bool:
    """Return True for a signal (n,) that rises in equal steps, apart from a few gaps, as time stamps do."""
    steps = np.diff(x)
    if len(x) < 20 or not np.isfinite(x).all() or not steps.min() > 0:
        return False
    return even_grid(x) is not None or float(np.mean(steps > MIN_GAP * np.median(steps))) < MAX_FRACTION


def read_stamps(log: Log, name: str) -> tuple[FloatArray, IntArray]:
    """Read the stamps (n,) of a time channel, and interpolate wrong ones. Also return the indices of wrong stamps.

    Wrong stamps are missing, or far from the median of their neighbours.  Empty for a channel that is no time.
    """
    none = np.zeros(0), np.zeros(0, np.int64)
    alike = log.column_numbers(name) if isinstance(log, TextLog) else []
    column = alike[0] if len(alike) > 1 else None
    try:
        t = log.values([ChannelSpec("y", "time", name, column, quantity="position")], slice(0, MAX_SAMPLES))[:, 0]
    except ElastidError:
        return none
    return correct_stamps(t) if len(t) > 2 else none


def correct_stamps(t: FloatArray) -> tuple[FloatArray, IntArray]:
    """Interpolate missing and wrong stamps (n,). Also return their indices; no stamps if too many are missing."""
    from scipy.ndimage import median_filter

    none, rows, half = np.zeros(0, np.int64), np.arange(len(t)), len(t) // 2
    is_wrong = ~np.isfinite(t)
    if is_wrong.mean() > MAX_MISSING_FRACTION:
        return t[:0], none
    step, finite = float(np.nanmedian(t[half:] - t[: len(t) - half])) / half, t[~is_wrong]
    limit = _MAX_WRONG_DISTANCE * max(abs(step), float(np.median(np.abs(np.diff(finite)))))
    is_far = np.abs(finite - median_filter(finite, 5, mode="mirror")) > limit
    if is_far.mean() > MAX_WRONG_FRACTION:
        return (t[:0] if is_wrong.any() else t), none
    is_wrong[~is_wrong] = is_far
    late = np.interp(rows, rows[~is_wrong], (t - step * rows)[~is_wrong])
    return np.where(is_wrong, step * rows + late, t), np.flatnonzero(is_wrong)


def time_units(t: FloatArray) -> dict[str, float]:
    """Return units of stamps (n,) and their sizes in s, the typical one first; Windows counts 100 ns since 1601."""
    return {"100 ns": 1e-7} if len(t) and 1e17 < t[0] < 1e18 else TIME_UNITS


def stamp_size(t: FloatArray, rate_hz: float) -> tuple[str, float]:
    """Return the unit of stamps (n,) and its size in s: the typical unit, or another unit if only it fits the rate."""
    steps, units = np.diff(t), time_units(t)
    unit = next(iter(units))
    if np.any(steps > 0):
        far = {name: abs(np.log(np.median(steps[steps > 0]) * size * rate_hz)) for name, size in units.items()}
        nearest = min(far, key=far.__getitem__)
        unit = nearest if far[nearest] < MAX_RATE_LOG and far[unit] > np.log(MAX_RATE_RATIO) else unit
    return unit, units[unit]


def channel_rates(log: Log) -> list[tuple[str, str, float]]:
    """Return name, unit, sample time in ms of channels of a log with several sample times; empty for others.

    For logs with several time channels: empty if one of them belongs to all drives and motions.
    """
    signals = [(n, a) for n, a in log.arrays.items() if a.is_signal]
    rates = [(n, a.units, 1e3 / a.rate_hz) for n, a in signals if a.rate_hz]
    stamped = [(n, a) for n, a in signals if a.time and guess_by_name(n, None, a.units).quantity in (*MOTIONS, *DRIVES)]
    if times := {a.time: read_stamps(log, a.time)[0] for _, a in stamped}:
        steps_ms = {
            name: float(f"{1e3 / clock_rate(t)[1]:.3g}")
            for name, t in times.items()
            if len(t) > MIN_SAMPLES and np.ptp(t) > 0
        }
        rates = [(n, a.units, steps_ms[a.time]) for n, a in stamped if a.time in steps_ms]
        return rates if len(steps_ms) > 1 else []
    return rates if len({ms for *_, ms in rates}) > 1 else []


def common_step_ms(channels: Sequence[tuple[str, str, float]]) -> float:
    """Return the shortest sample time that a drive and a motion reach, else the longest sample time."""
    quantities = [(guess_by_name(name, None, unit).quantity, ms) for name, unit, ms in channels]
    fastest = [min((ms for name, ms in quantities if name in kinds), default=0.0) for kinds in (DRIVES, MOTIONS)]
    return max(fastest) if all(fastest) else max(ms for *_, ms in channels)


def stamp_rate(t: FloatArray) -> float:
    """Return the rate of stamps (n,) of an even sampling, else 1 / mean step without gaps."""
    if (line := stamp_line(t)) is not None:
        return line.rate_hz
    rises = np.diff(t)
    rises = rises[rises > 0]
    return 1 / float(np.mean(rises[rises < MIN_GAP * np.median(rises)]))


def clock_rate(t: FloatArray) -> tuple[str, float]:
    """Return the unit in which stamps (n,) have the rate of a log of a machine, and the rate in Hz."""
    rate, low, high, units = stamp_rate(t), 20.0, 200e3, time_units(t)
    unit = next((u for u, s in units.items() if low <= rate / s <= high), next(iter(units)))
    return unit, rate / units[unit]


def common_span(spans: Mapping[str, tuple[float, float]], place: Path | str) -> tuple[float, float]:
    """Return first and last time in s at which all signals with the names and spans were logged; DataError without."""
    begin, end = max(first for first, _ in spans.values()), min(last for _, last in spans.values())
    if not begin < end:
        text = ", ".join(f"{name} {first:.3f} to {last:.3f} s" for name, (first, last) in spans.items())
        raise DataError("records/clock", f"signals have no time in common: {text}. Log them with one clock", place)
    return begin, end


def find_clock(log: Log) -> Clock:
    """Find the clock of a log by a time channel, a rate that its format states, or a number with a typical name.

    Raises DataError for a time that runs backwards.
    """
    stamps, shapes = set[str](), log.shapes()
    if channels := channel_rates(log):
        slowest = common_step_ms(channels)
        stamps = {log.arrays[name].time for name, _, ms in channels if name in log.arrays and ms <= slowest} - {""}
        if len(stamps) != 1:
            rate_hz = float(f"{1e3 / slowest:.6g}")
            return Clock(rate_hz, "highest rate at which both a drive and a motion were logged")
    candidates, falling = [name for name in shapes if not guess_by_name(name, None).quantity], ""
    for name in (*stamps, *filter(is_time, shapes), *candidates):
        stamps_as_logged, _ = read_stamps(log, name)
        falling = falling or (name if is_time(name) and is_clock(-stamps_as_logged) else "")
        t, jumps = without_jumps(stamps_as_logged)
        steps = np.diff(t)
        is_late = len(t) > MIN_SAMPLES and stamp_line(t) is not None
        is_rising = len(jumps) <= MAX_WRONG_FRACTION * len(t) and (np.all(steps > 0) or is_late)
        is_clock_by_steps = not is_time(name) and is_clock(stamps_as_logged) and np.any(steps != 1)
        if len(t) > 2 and (is_clock_by_steps or (is_time(name) and is_rising)):
            (unit, rate_hz), grid = clock_rate(t), even_grid(t)
            is_even = not len(jumps) and grid is not None and len(grid[0]) > grid[0][-1]
            return Clock(float(f"{rate_hz:.6g}"), f"steps of {name}, which seems to be in {unit}", name, is_even)
    for name, array in log.arrays.items():
        if array.rate_hz:
            return Clock(array.rate_hz, "stated by the file")
        last = name.lower().rpartition(".")[2]
        is_number = array.dtype.kind in "fiu" and not array.is_signal and 0 not in array.shape
        number = float(np.squeeze(np.asarray(array))) if last in (*_RATES, *_PERIODS) and is_number else 0.0
        if number > 0:
            return Clock(number if last in _RATES else float(f"{1 / number:.6g}"), f"{name} in the file")
    if falling:
        raise DataError("records/clock", f"{falling} {RUNS_BACKWARDS}. Sort its rows by time", getattr(log, "path", ""))
    times = [name for name in shapes if is_time(name)]
    return Clock(None, f"time stamps of {times[0]} are missing or uneven" if times else "no time is in the log")
