"""The channels of one experiment, from one log or several, in SI on the link side and on one grid of samples.

Logs that started at different times are shifted into step by the excitation that each of them holds; channels of
different rates are brought to the lowest. A start that all channels share does not matter: Y / U cancels it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.recorded import ChannelSpec, FileSpec, RecordedSpec
from elastid.recorded.files.logs import read_channels
from elastid.recorded.link_side import check_values, link_side, named
from elastid.recorded.repair.delay import LEAST_CORRELATION, delay
from elastid.recorded.repair.finding import Finding, Log
from elastid.recorded.repair.missing import filled
from elastid.recorded.repair.sample_times import at_times, on_grid
from elastid.robot import Robot

ALIGNED = "logs shifted"
RATE_CHANGED = "channels brought to another rate"
# Whole samples of a period, to this part of it.
_WHOLE = 1e-6


@dataclass(frozen=True)
class Gathered:
    """signals (n, c) of channels, samples that are missing being NaN, at rate_hz (1 where unknown)."""

    signals: FloatArray
    channels: tuple[ChannelSpec, ...]
    rate_hz: float
    period_samples: int
    first: int
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class _Part:
    """Some channels of one file with one rate: their places in the study's list, and signals (n, c)."""

    file: int
    rate_hz: float
    members: tuple[int, ...]
    signals: FloatArray


def gather(recorded: RecordedSpec, file: FileSpec, base: Path, robot: Robot) -> Gathered:
    """Read the logs of one experiment.

    Raises StudyError for rates that have no whole number of samples in a period, DataError for channels that cannot
    be read, never change, or of logs that have no excitation in common.
    """
    rate_hz = 1.0 if isinstance(recorded.rate_hz, str) else float(recorded.rate_hz)
    paths = [base / path for path in (file.path, *file.also)]
    findings: list[Finding] = []
    parts = [_read(recorded, file, paths, key, rate_hz, findings) for key in _keys(recorded, rate_hz)]
    columns = {i: column for part in parts for i, column in zip(part.members, part.signals.T, strict=True)}
    still = check_values(recorded.channels, [columns[i] for i in range(len(columns))], paths[0])
    words = [*still]
    converted = []
    for part in parts:
        pairs = [
            link_side(recorded.channels[i], column, robot)
            for i, column in zip(part.members, part.signals.T, strict=True)
        ]
        words += [word for _, word in pairs if word]
        signals = np.stack([signal for signal, _ in pairs], axis=1)
        converted.append(_Part(part.file, part.rate_hz, part.members, signals))
    period_s = period_samples(recorded, rate_hz) / rate_hz
    lowest = min(part.rate_hz for part in parts)
    N = whole_samples(period_s, lowest, recorded)
    at_rate = [_at_rate(part, lowest, period_s, recorded, paths, findings) for part in converted]
    aligned = _aligned(at_rate, N, recorded.channels, paths, findings)
    n = min(len(part.signals) for part in aligned)
    signals = np.full((n, len(recorded.channels)), np.nan)
    for part in aligned:
        signals[:, part.members] = part.signals[:n]
    keep = _first_of_each(recorded.channels)
    channels = tuple(recorded.channels[i] for i in keep)
    first = 0 if file.samples is None else file.samples[0]
    return Gathered(signals[:, keep], channels, lowest, N, first, tuple(words), tuple(findings))


def period_samples(recorded: RecordedSpec, rate_hz: float) -> int:
    """Samples of a period at the study's rate."""
    if recorded.period is not None:
        return round(recorded.period * rate_hz)
    assert recorded.period_samples is not None  # the section has exactly one of the two
    return recorded.period_samples


def whole_samples(period_s: float, rate_hz: float, recorded: RecordedSpec) -> int:
    """Samples of a period at a channel's own rate; StudyError where they are not whole."""
    samples = period_s * rate_hz
    if abs(samples - round(samples)) > _WHOLE * samples:
        raise StudyError(
            f"at {rate_hz:g} Hz the period of {period_s:g} s is {samples:.6g} samples, not a whole number, so that "
            f"its channels and those at {recorded.rate_hz} Hz have no grid in common; check rate_hz of the channels"
        )
    return round(samples)


def _keys(recorded: RecordedSpec, rate_hz: float) -> list[tuple[int, float]]:
    """File and rate of each part; the first one is the log's own."""
    keys = dict.fromkeys((c.file, float(c.rate_hz or rate_hz)) for c in recorded.channels)
    return sorted(keys, key=lambda key: (key[0], key[1] != rate_hz))


def _read(
    recorded: RecordedSpec,
    file: FileSpec,
    paths: Sequence[Path],
    key: tuple[int, float],
    rate_hz: float,
    findings: list[Finding],
) -> _Part:
    number, own_rate_hz = key
    members = tuple(
        i for i, c in enumerate(recorded.channels) if (c.file, float(c.rate_hz or rate_hz)) == (number, own_rate_hz)
    )
    channels, path = [recorded.channels[i] for i in members], paths[number - 1]
    has_time = bool(recorded.time) and key == (1, rate_hz)
    if has_time:
        channels = [*channels, ChannelSpec("y", "", recorded.time, quantity="position")]
    values = read_channels(path, channels, recorded.text)
    if number == 1:
        values = _cut(values, file, path, own_rate_hz / rate_hz)
    if has_time:
        log = Log(str(path), (), rate_hz, 0 if file.samples is None else file.samples[0])
        gridded = on_grid(values[:, -1], values[:, :-1], rate_hz, log)
        findings += gridded.findings
        values = gridded.signals
    return _Part(number, own_rate_hz, members, np.where(np.isfinite(values), values, np.nan))


def _cut(values: FloatArray, file: FileSpec, path: Path, ratio: float) -> FloatArray:
    if file.samples is None:
        return values
    first, last = (round(sample * ratio) for sample in file.samples)
    if not 0 <= first < last <= len(values):
        raise DataError(
            f"{path}: samples [{first}, {last}] do not lie in it; it has {len(values)} samples, the first is 0 and "
            "last is not included"
        )
    return values[first:last]


def _at_rate(
    part: _Part,
    rate_hz: float,
    period_s: float,
    recorded: RecordedSpec,
    paths: Sequence[Path],
    findings: list[Finding],
) -> _Part:
    """The part at the lowest of all rates, what that cannot hold kept out."""
    if part.rate_hz == rate_hz:
        return part
    names = tuple(named(recorded.channels[i]) for i in part.members)
    N, ratio = whole_samples(period_s, part.rate_hz, recorded), part.rate_hz / rate_hz
    signals = part.signals
    if not np.isfinite(signals).all():
        repaired = filled(signals, N, 1, Log(str(paths[part.file - 1]), names, part.rate_hz))
        findings += repaired.findings
        signals = repaired.signals
    times = np.arange(int(len(signals) / ratio), dtype=np.float64) * ratio
    word = f"{', '.join(names)}: brought from {part.rate_hz:g} to {rate_hz:g} Hz, right up to {0.45 * rate_hz:g} Hz"
    findings.append(Finding(RATE_CHANGED, len(names), word))
    return _Part(part.file, rate_hz, part.members, at_times(signals, times, N, 1 / ratio))


def _aligned(
    parts: Sequence[_Part],
    N: int,
    channels: Sequence[ChannelSpec],
    paths: Sequence[Path],
    findings: list[Finding],
) -> list[_Part]:
    """All parts in step with the first file; its start is cut where another log started later."""
    base = [part for part in parts if part.file == 1]
    n = min(len(part.signals) for part in base)
    shifts: dict[int, float] = {}
    for number in sorted({part.file for part in parts} - {1}):
        here = [part for part in parts if part.file == number]
        shifts[number] = _delay_of(base, here, N, channels, paths[number - 1])
        word = (
            f"{paths[number - 1].name} lags {paths[0].name} by {shifts[number]:.3f} samples (up to whole periods): "
            "shifted into step"
        )
        findings.append(Finding(ALIGNED, 1, word))
    start = max([0, *(int(np.ceil(-shift)) for shift in shifts.values())])
    result = [_Part(1, part.rate_hz, part.members, part.signals[start:]) for part in base]
    for part in (part for part in parts if part.file != 1):
        shift, signals = shifts[part.file], part.signals
        if _is_one_period(part, N, channels):
            signals = np.tile(signals[:N], (n // N + 3, 1))
        times = np.arange(start, n, dtype=np.float64) + shift
        inside = times[(times >= 0) & (times <= len(signals) - 1)]
        whole = np.allclose(inside, np.round(inside), atol=1e-3)
        moved = signals[np.round(inside).astype(int)] if whole else at_times(signals, inside, N)
        result.append(_Part(part.file, part.rate_hz, part.members, moved))
    return result


def _delay_of(
    base: Sequence[_Part], here: Sequence[_Part], N: int, channels: Sequence[ChannelSpec], path: Path
) -> float:
    """By how many samples a file lags the first one, from the motor whose excitation both hold and that agrees best."""

    sent = _by_motor(base, "r", N, channels)
    ours = _by_motor(base, "u", N, channels) | sent
    found = {at: delay(ours[at], r, N) for at, r in _by_motor(here, "r", N, channels).items() if at in ours}
    best = max(found, key=lambda at: found[at][1], default="")
    if not best or found[best][1] < LEAST_CORRELATION:
        agree = f"best correlation {found[best][1]:.2f} at {best}" if best else "it has no complete channel of role r"
        raise DataError(
            f"{path}: nothing tells when it started ({agree}); log the excitation r of a motor in it, or one period of "
            "that excitation alone"
        )
    shift = found[best][0]
    # Where u stands for r the loop's own phase is in the delay: whole samples are all that can be told.
    return shift if best in sent else float(round(shift))


def _by_motor(parts: Sequence[_Part], role: str, N: int, channels: Sequence[ChannelSpec]) -> dict[str, FloatArray]:
    """The complete signals of a role that hold a period, by their motor."""
    found = {
        channels[i].at: column
        for part in parts
        for i, column in zip(part.members, part.signals.T, strict=True)
        if channels[i].role == role
    }
    return {at: column for at, column in found.items() if len(column) >= N and np.isfinite(column).all()}


def _is_one_period(part: _Part, N: int, channels: Sequence[ChannelSpec]) -> bool:
    return len(part.signals) < 2 * N and all(channels[i].role == "r" for i in part.members)


def _first_of_each(channels: Sequence[ChannelSpec]) -> list[int]:
    """A signal that two files hold is taken from the first."""
    seen: dict[tuple[str, str], int] = {}
    for i in sorted(range(len(channels)), key=lambda i: (channels[i].file, i)):
        seen.setdefault((channels[i].role, channels[i].at), i)
    return sorted(seen.values())
