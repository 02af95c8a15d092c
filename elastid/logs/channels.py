"""Channels of one experiment, from one log or several, in SI on the link side and on one uniform grid.

Logs that started at different times are aligned by the excitation in each of them. Channels of different rates are
resampled to the lowest rate. A start time that all channels share has no effect: it cancels in Y / U.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.logs.clocks import common_span, correct_stamps, stamp_size
from elastid.logs.files.formats import contents, read_channels, time_channels
from elastid.logs.repair import Findings, LogReport
from elastid.logs.repair.clock_drift import (
    MAX_CLOCK_ERROR,
    MAX_GRID_DEVIATION,
    MAX_REMAINING_FRACTION,
    MIN_DELAY_CORRELATION,
    delay_by_torque,
    estimate_clock_drift,
    estimate_delay,
)
from elastid.logs.repair.masks import samples_before_motion
from elastid.logs.repair.missing import fill_gaps, resampled_with_gaps
from elastid.logs.repair.periodicity import check_complete, period_samples, round_samples
from elastid.logs.repair.resampling import PASSBAND, resample_at
from elastid.logs.repair.time_stamps import resample_to_rate, sampling_times
from elastid.logs.units_and_sides import check_values, link_side, without_placeholders
from elastid.record import MOTION_ORDER, Motion

Signals: TypeAlias = dict[tuple[str, str, str], FloatArray]
_Key: TypeAlias = tuple[int, float, str]  # file, rate in Hz, time channel


@dataclass(frozen=True)
class GatheredChannels:
    """Signals (n, c) of channels, NaN where missing, at rate_hz (1 where unknown); known disturbances stand last.

    period: in samples, not always whole; None without one.  log: names, numbers in the first file, and findings.
    """

    signals: FloatArray
    channels: tuple[ChannelSpec, ...]
    rate_hz: float
    period: float | None
    log: LogReport


@dataclass(frozen=True)
class _Group:
    """Channels of one file with the same rate and clock: indices in the study's list, signals (n, c), and rows.

    first_s: the first time stamp, None where none was logged.
    """

    file: int
    rate_hz: float
    members: tuple[int, ...]
    signals: FloatArray
    rows: IntArray | None = None
    first_s: float | None = None


@dataclass(frozen=True)
class _LogSet:
    recorded: RecordedSpec
    file: FileSpec
    paths: tuple[Path, ...]
    findings: Findings = field(default_factory=Findings)

    def log(self, number: int, names: Sequence[str] = (), rate_hz: float | None = None) -> LogReport:
        """Return names of a file, counted from 1, in messages."""
        first = 0 if self.file.samples is None or number > 1 else self.file.samples[0]
        scale = self.recorded.known_rate_hz / (rate_hz or self.recorded.known_rate_hz)
        return LogReport(str(self.paths[number - 1]), tuple(names), rate_hz, first, scale=scale, findings=self.findings)

    def range_at(self, rate_hz: float, n: int) -> slice:
        """Return the range of samples of the study among n at a rate; DataError where it is not in them."""
        scale = rate_hz / self.recorded.known_rate_hz
        first, last = (round(sample * scale) for sample in self.file.samples or (0, n / scale))
        if not 0 <= first < last <= n:
            text = f"samples [{first / scale:.0f}, {last / scale:.0f}] exceed the file; it has {n / scale:.0f} samples,"
            advice = "counted from 0, and last is exclusive. Correct samples"
            raise DataError("records/range", f"{text} {advice}", self.paths[0])
        return slice(first, last)

    def members(self) -> dict[_Key, list[int]]:
        """Return channels by file, rate and time channel: `time` of the study, or time stamps of each channel."""
        recorded, result = self.recorded, dict[_Key, list[int]]()
        for number, path in enumerate(self.paths, start=1):
            numbers = [i for i, channel in enumerate(recorded.channels) if channel.file == number]
            names = time_channels(path, [recorded.channels[i] for i in numbers], recorded.text)
            # Some loggers record no time stamps.
            has_time = recorded.time and (number == 1 or recorded.time in contents(path, recorded.text))
            for i, name in zip(numbers, names, strict=True):
                rate_hz = recorded.channels[i].rate_hz
                time = recorded.time if has_time and rate_hz in (None, recorded.rate_hz) else ""
                key = number, float(rate_hz or recorded.known_rate_hz), name if len({*names}) > 1 else time
                result.setdefault(key, []).append(i)
        return result


def excitation_columns(channels: Sequence[ChannelSpec]) -> list[int]:
    """Return the numbers of the channels of role r, else of role u, else of the references."""
    columns = ([i for i, c in enumerate(channels) if c.role == role] for role in ("r", "u", "reference"))
    return next(filter(None, columns), [])


def gather_channels(recorded: RecordedSpec, file: FileSpec, base: Path, robot: Places) -> GatheredChannels:
    """Read the logs of one experiment.

    Raises StudyError for rates without a whole number of samples in a period, DataError for channels that cannot be
    read, never change, or belong to logs without a common excitation, and for a period that is not found.
    """
    channels, rate_hz = recorded.channels, recorded.known_rate_hz
    experiment = _LogSet(recorded, file, tuple(base / path for path in (file.path, *file.also)))
    members = experiment.members()
    keys = sorted(members, key=lambda key: (key[0], key[1] != rate_hz))
    has_clocks = len({time for number, _, time in keys if number == 1}) > 1
    parts = {key: (members[key], _read(experiment, key, members[key], has_clocks)) for key in keys}
    groups = _resample_to_grids(experiment, parts)
    columns = {i: column for group in groups for i, column in zip(group.members, group.signals.T, strict=True)}
    may_rest = ("u",) if file.purpose == "coast_down" else ()
    check_values(channels, [columns[i] for i in range(len(columns))], experiment.log(1), may_rest)
    in_si = []
    for group in groups:
        signals = [link_side(channels[i], columns[i], robot, experiment.log(group.file)) for i in group.members]
        in_si.append(replace(group, signals=np.stack(signals).T))
    lowest = min(group.rate_hz for group in groups)
    period_s = _period_s(in_si, experiment)
    at_rate = [_resample_group(group, lowest, period_s, experiment) for group in in_si]
    period = None if period_s is None else period_samples_of_channel(period_s, lowest, recorded, file)
    known_hz = None if recorded.rate_hz == "unknown" else lowest
    if period is not None and recorded.period_of(file) == "find":
        seconds = "" if known_hz is None else f" ({period / known_hz:.8g} s)"
        text = f"the torques repeat every {period:.8g} samples{seconds}, which is used as the period"
        experiment.log(1).report("periods found", 1, text)
    in_step = _align_files(at_rate, period, experiment)
    n = min(len(group.signals) for group in in_step)
    columns = {i: x[:n] for group in in_step for i, x in zip(group.members, group.signals.T, strict=True)}
    # If two files contain a signal, the first file is used.
    by_file = sorted(range(len(channels)), key=lambda i: (channels[i].file, i), reverse=True)
    firsts = {(channels[i].role, channels[i].at): i for i in by_file}
    order = sorted(firsts.values(), key=lambda i: (channels[i].role == "d", i))
    selection = tuple(channels[i] for i in order)
    rows = groups[0].rows if len(groups) == 1 else None
    log = replace(experiment.log(1, [channel.full_name for channel in selection], known_hz), rows=rows)
    values = np.stack([columns[i] for i in order]).T
    begin = _first_excited_sample(values[:, excitation_columns(selection)], period, log)
    return GatheredChannels(values[begin:], selection, lowest, period, log.after(begin))


def report_unused_references(channels: Sequence[ChannelSpec], log: LogReport, log_channels: Sequence[int] = ()) -> None:
    """Report references that are not among the used channels."""
    names = [c.name_in_file for i, c in enumerate(channels) if c.role == "reference" and i not in log_channels]
    text = (
        f"{', '.join(names)}: reference not used. Give experiment.recorded.controller in a friction study, else one "
        "reference per input and no r"
    )
    if names:
        log.note("records/unused-reference", text, "information")


def _first_excited_sample(drivers: FloatArray, period: float | None, log: LogReport) -> int:
    """Return the first sample of the first period in which the excitation (n, d) is not zero throughout."""
    n_rest = samples_before_motion(drivers)
    if period is None or n_rest < period:
        return 0
    count = int(n_rest / period)
    periods = "period" if count == 1 else f"{count} periods"
    text = f"the excitation starts at {log.time_of(n_rest)}; {periods} before it, at zero velocity, are discarded"
    log.report("rest left out", count, text)
    return math.ceil(count * period)


def period_samples_of_channel(period_s: float, rate_hz: float, recorded: RecordedSpec, file: FileSpec) -> float:
    """Return samples of a period at a channel's rate; StudyError if only the study's rate gives a whole number."""
    samples, nominal = (round_samples(period_s * rate) for rate in (rate_hz, recorded.known_rate_hz))
    if not samples.is_integer() and nominal.is_integer() and recorded.period_of(file) != "find":
        text = f"at {rate_hz:g} Hz the period of {period_s:g} s is {samples:.6g} samples; a common grid with"
        advice = "Hz needs a whole number. Check rate_hz of the channels"
        raise StudyError("study/recorded", f"{text} {recorded.rate_hz} {advice}")
    return samples


def _period_s(groups: Sequence[_Group], experiment: _LogSet) -> float | None:
    """Return the period in s (samples if the rate is unknown), stated or detected in torques; None without one."""
    recorded, members = experiment.recorded, [i for group in groups if group.file == 1 for i in group.members]
    drivers = [members[j] for j in excitation_columns([recorded.channels[i] for i in members])]
    group = next(group for group in groups if drivers[0] in group.members)  # the first file has an acting torque
    signals = group.signals[:, [j for j, i in enumerate(group.members) if i in drivers]]
    if recorded.period_of(experiment.file) is not None:
        check_complete(signals, experiment.paths[0])
    signals = signals[samples_before_motion(signals) :]
    samples = period_samples(recorded, experiment.file, group.rate_hz, signals)
    return None if samples is None else samples / group.rate_hz


def _read(experiment: _LogSet, key: _Key, members: Sequence[int], has_clocks: bool) -> FloatArray:
    """Return values (n, c) of channels, and in the last column their time if they have one.

    has_clocks: the range of samples is that of the common clock of the first file.
    """
    number, file_rate_hz, time = key
    recorded, file, path = experiment.recorded, experiment.file, experiment.paths[number - 1]
    channels = [recorded.channels[i] for i in members]
    channels += [ChannelSpec("y", "time", time, quantity="position")] if time else []
    if number > 1 or file.samples is None or has_clocks:
        return read_channels(path, channels, recorded.text)
    first, last = (round(sample * file_rate_hz / recorded.known_rate_hz) for sample in file.samples)
    values = read_channels(path, channels, recorded.text, slice(first, last))
    if not 0 <= first < last or len(values) < last - first:
        experiment.range_at(file_rate_hz, len(read_channels(path, channels, recorded.text)))
    return values


def _resample_to_grids(experiment: _LogSet, parts: Mapping[_Key, tuple[list[int], FloatArray]]) -> list[_Group]:
    """Bring signals to their rates. If a file has several clocks, cut all signals to the start of the last one."""
    groups, time_series, file = [], dict[_Key, tuple[FloatArray, FloatArray]](), experiment.file
    full_names = [channel.full_name for channel in experiment.recorded.channels]
    clocks = {number: {name for k, _, name in parts if k == number} for number, *_ in parts}
    logs = {
        key: experiment.log(key[0], [full_names[i] for i in members], key[1]) for key, (members, _) in parts.items()
    }
    logs |= {key: replace(log, first=0, scale=1.0) for key, log in logs.items() if len(clocks[key[0]]) > 1}
    for key, (_, values) in parts.items():
        if key[2]:
            stamps_s = _stamps_s(values[:, -1], key[2], key[1], logs[key])
            time_series[key] = sampling_times(stamps_s, values[:, :-1], logs[key], len(clocks[key[0]]) > 1)
    for key, (members, values) in parts.items():
        (number, rate_hz, _), log, on_grid, rows, first_s = key, logs[key], values, None, None
        if key in time_series:
            time_s, on_grid = time_series[key]
            spans = {name: (float(t[0]), float(t[-1])) for (k, _, name), (t, _) in time_series.items() if k == number}
            begin_s = common_span(spans, experiment.paths[number - 1])[0] if len(spans) > 1 else None
            on_grid = resample_to_rate(time_s, on_grid, rate_hz, log, begin_s)
            first_s = float(time_s[0]) if begin_s is None else begin_s
            if begin_s is None:
                rows = log.first + np.searchsorted(time_s - first_s, (np.arange(len(on_grid)) - 0.5) / rate_hz)
            elif number == 1 and file.samples is not None:
                first_s += file.samples[0] / experiment.recorded.known_rate_hz
                on_grid = on_grid[experiment.range_at(rate_hz, len(on_grid))]
        signals = without_placeholders(np.where(np.isfinite(on_grid), on_grid, np.nan))
        groups.append(_Group(number, rate_hz, tuple(members), signals, rows, first_s))
    return groups


def _stamps_s(t: FloatArray, name: str, rate_hz: float, log: LogReport) -> FloatArray:
    """Return stamps (n,) in s, wrong ones interpolated."""
    stamps, wrong = correct_stamps(t) if len(t) > 2 else (t, np.zeros(0, np.int64))
    if len(wrong):
        text = f"wrong values of {name}: {len(wrong)}, the first at {log.time_of(wrong[0])}; interpolated"
        log.report("time stamps corrected", len(wrong), text)
    t = stamps if len(stamps) else t
    return t * stamp_size(t, rate_hz)[1]


def _resample_group(group: _Group, rate_hz: float, period_s: float | None, experiment: _LogSet) -> _Group:
    if group.rate_hz == rate_hz:
        return group
    names = [experiment.recorded.channels[i].full_name for i in group.members]
    ratio, signals, log = group.rate_hz / rate_hz, group.signals, experiment.log(group.file, names, group.rate_hz)
    times = np.arange(int(len(signals) / ratio), dtype=np.float64) * ratio
    text = f"{', '.join(names)} resampled from {group.rate_hz:g} to {rate_hz:g} Hz"
    log.report("channels brought to another rate", len(names), f"{text}, exact up to {PASSBAND * rate_hz:g} Hz")
    if period_s is None:
        signals = resampled_with_gaps(signals, times, 1 / ratio, log)
    else:
        period = period_samples_of_channel(period_s, group.rate_hz, experiment.recorded, experiment.file)
        complete = signals if np.isfinite(signals).all() else fill_gaps(signals, round(period), 1, log)
        signals = resample_at(complete, times, period, 1 / ratio)
    return replace(group, rate_hz=rate_hz, signals=signals, rows=None)


def _align_files(groups: Sequence[_Group], period: float | None, experiment: _LogSet) -> list[_Group]:
    """Align all parts with the first file, which is cut to the latest start of all logs."""
    paths, channels = experiment.paths, experiment.recorded.channels
    base = [group for group in groups if group.file == 1]
    n = min(len(group.signals) for group in base)
    N = None if period is None else round(period)
    shifts, other_logs, log, x_1 = {}, [], experiment.log(1), _complete_signals(base, N, channels)
    for number in sorted({group.file for group in groups} - {1}):
        name, members = paths[number - 1].name, [group for group in groups if group.file == number]
        ratio = 1.0 if N is None else _clock_ratio(x_1, _complete_signals(members, N, channels), N)
        if ratio != 1:
            for i, group in enumerate(members):
                times = np.arange(int((len(group.signals) - 1) / ratio) + 1, dtype=np.float64) * ratio
                period_at_rate = None if period is None else period * ratio
                members[i] = replace(group, signals=resample_at(group.signals, times, period_at_rate))
            text = f"the clocks of {name} and {paths[0].name} differ by {1e6 * (ratio - 1):.1f} ppm: resampled to that"
            log.report("logs at one clock", 1, f"{text} of {paths[0].name}")
        shift, clue = _file_delay(
            base[0], members[0], x_1, _complete_signals(members, N, channels), N, paths[number - 1]
        )
        shifts[number] = shift
        other_logs += members
        up_to = "" if N is None else " (up to whole periods)"
        log.report("logs shifted", 1, f"{name} lags {paths[0].name} by {shift:.3f} samples{up_to}; aligned by {clue}")
    start = max([0, *(math.ceil(-shift) for shift in shifts.values())])
    result = [replace(group, signals=group.signals[start:]) for group in base]
    for group in other_logs:
        shift, signals = shifts[group.file], group.signals
        if N is not None and len(signals) < 2 * N and all(channels[i].role == "r" for i in group.members):
            # One period of the excitation alone is repeated.
            signals = np.tile(signals[:N], (n // N + 3, 1))
        times = np.arange(start, n, dtype=np.float64) + shift
        inside = times[(times >= 0) & (times <= len(signals) - 1)]
        # A shift of whole samples needs no interpolation.
        is_whole = np.allclose(inside, np.round(inside), atol=1e-3)
        signals = signals[np.round(inside).astype(int)] if is_whole else resample_at(signals, inside, period)
        result.append(replace(group, signals=signals))
    return result


def _clock_ratio(base: Signals, file: Signals, N: int) -> float:
    """Return the ratio of the clocks of another file and the first, by periodic signals in both; 1 if they agree."""
    x_1, x_2 = _whole_periods(base, N), _whole_periods(file, N)
    if x_1 is None or x_2 is None:
        return 1.0
    first, second = estimate_clock_drift(x_1, N), estimate_clock_drift(x_2, N)
    excess, periods = second.excess - first.excess, len(x_2) / N
    repeats = [drift.corrected_unexplained <= MAX_REMAINING_FRACTION * drift.unexplained for drift in (first, second)]
    is_clock = abs(excess) * periods >= MAX_GRID_DEVIATION and abs(excess) <= MAX_CLOCK_ERROR * N and any(repeats)
    return (N + second.excess) / (N + first.excess) if is_clock else 1.0


def _whole_periods(signals: Signals, N: int) -> FloatArray | None:
    """Return whole periods (n, c) of the least noisy role that has two; None without."""
    for role in ("r", "reference", "u", "y"):
        if x := [x for key, x in signals.items() if key[0] == role and len(x) >= 2 * N]:
            return _stack_to_shortest(x)[: min(map(len, x)) // N * N]
    return None


def _stack_to_shortest(signals: Sequence[FloatArray]) -> FloatArray:
    """Return signals (n, c) of one file, some of which may be a sample longer."""
    return np.stack([x[: min(map(len, signals))] for x in signals], axis=1)


def _file_delay(
    first: _Group, second: _Group, x_1: Signals, x_2: Signals, N: int | None, path: Path
) -> tuple[float, str]:
    """Return samples by which a file lags the first one, and the clue in words.

    A signal in both files shows the lag. So do r and u, to whole samples, since the phase of the loop is part of it.
    Otherwise clock or rows do, unless torque and acceleration of the motors contradict them.
    """
    references = {place: x for place, x in x_2.items() if place[0] == "r"}
    torques = {("r", motor, quantity): x for (role, motor, quantity), x in x_1.items() if role == "u"}
    correlation = 0.0
    for x_k, candidates, is_exact in ((x_1, x_2, True), (torques, references, False)):
        delays = {place: estimate_delay(x_k[place], x, N) for place, x in candidates.items() if place in x_k}
        best = max(delays, key=lambda place: delays[place][1], default=None)
        correlation = 0.0 if best is None else delays[best][1]
        if best is not None and correlation >= MIN_DELAY_CORRELATION:
            whole = "" if is_exact else ", to whole samples: log r in both files, or name delay in fit.parameters"
            lag = delays[best][0]
            return lag if is_exact else float(round(lag)), f"{best[0]} at {best[1]}{whole}"
    shift = None if references else _clock_shift(first, second, any(place[0] == "r" for place in x_1))
    motions = {place: x for place, x in x_2.items() if place[0] == "y" and ("u", place[1], "") in x_1}
    if motions and not references:
        u, y = _stack_to_shortest([x_1["u", at, ""] for _, at, _ in motions]), _stack_to_shortest([*motions.values()])
        orders = np.array([2 - MOTION_ORDER[cast(Motion, quantity)] for *_, quantity in motions])
        lag, agreement, match = delay_by_torque(u, y, orders, N, shift or 0.0)
        if agreement > max(MIN_DELAY_CORRELATION, 0.0 if shift is None else 2 * abs(match)):
            return lag, "torques and accelerations, to about a millisecond: add delay to fit.parameters"
    if shift is None:
        text = "its start time is not identifiable: the two clocks have nothing in common (best correlation "
        advice = "Log r, reference or a motor position in both files, or give recorded.time if one clock stamps both"
        raise DataError("records/period-mismatch", f"{text}{correlation:.2f}). {advice}", path)
    return shift, f"{'row number' if second.first_s is None else 'time stamps'}, since no signal is in both"


def _clock_shift(first: _Group, second: _Group, has_excitation: bool) -> float | None:
    """Return the lag in samples of a log without excitation, by the clock that stamps both logs, or by their rows.

    None where their times do not overlap, or there are none and not as many samples, or where the first one has an
    excitation: what two loggers record of it has its own start in each, and every sample between them is phase.
    """
    if first.first_s is None or second.first_s is None:
        return 0.0 if not has_excitation and len(first.signals) == len(second.signals) else None
    shift = (first.first_s - second.first_s) * first.rate_hz
    return shift if -len(first.signals) < shift < len(second.signals) else None


def _complete_signals(groups: Sequence[_Group], N: int | None, channels: Sequence[ChannelSpec]) -> Signals:
    """Complete signals of at least a period, if there is one, by role, location and, for motions, quantity."""
    signals = {
        (channels[i].role, channels[i].at, channels[i].quantity if channels[i].is_motion else ""): column
        for group in groups
        for i, column in zip(group.members, group.signals.T, strict=True)
    }
    return {key: x for key, x in signals.items() if len(x) >= (N or 1) and np.isfinite(x).all()}
