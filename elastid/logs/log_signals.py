"""The varying signals of a log, each with the guess of its channel by name, unit and values."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.channels import MOTIONS, ChannelSpec
from elastid.logs.channel_names import DRIVES, STANDARD_GRAVITY, ChannelGuess, guess_by_name, label_by_words
from elastid.logs.clocks import (
    MIN_SAMPLES,
    channel_rates,
    clock_rate,
    common_span,
    common_step_ms,
    read_stamps,
    time_units,
)
from elastid.logs.files.log import ArrayLog, Log
from elastid.logs.files.text import TextLog
from elastid.logs.repair import LogReport, interpolate_linearly
from elastid.logs.repair.masks import MAX_MISSING_FRACTION, far_outside
from elastid.logs.repair.outliers import without_lone_spikes
from elastid.logs.units_and_sides import MAX_COMPUTABLE

_MAX_GRAVITY_ERROR = 0.1  # of an accelerometer, relative
_MIN_COUNTS = 50  # minimum range of whole numbers that may be counts


def read_signals(log: Log, max_samples: int, with_constant: bool = False) -> list[tuple[ChannelGuess, FloatArray]]:
    """Return varying signals (n,) of the most frequent length, matrices by column, each with the guess by its name.

    with_constant: include constant signals.
    """
    if channels_ms := channel_rates(log):
        return _resample_to_slowest(log, channels_ms, max_samples)
    shapes = {name: shape for name, shape in log.shapes().items() if max(shape) > 2}
    frequent = Counter(max(shape) for shape in shapes.values() if max(shape) > MIN_SAMPLES).most_common(1)
    units = dict(zip(log.headings, log.units, strict=False)) if isinstance(log, TextLog) else {}
    result = []
    for name, shape in shapes.items():
        count = min(shape) if len(shape) > 1 else 1
        columns = (log.column_numbers(name) if isinstance(log, TextLog) else []) or range(1, count + 1)
        for column in columns if frequent and max(shape) == frequent[0][0] else ():
            number = column if len(columns) > 1 else None
            try:
                spec = ChannelSpec("y", "any", name, number, quantity="position")
                x = log.values([spec], slice(0, max_samples))[:, 0]
            except DataError:  # words
                continue
            x = np.where(np.abs(x) < MAX_COMPUTABLE, x, np.nan)
            heading, unit = _heading(log, name, column) if isinstance(log, ArrayLog) else (name, units.get(name, ""))
            guess = guess_by_name(heading, number, unit)
            if guess.quantity == "position" and np.isfinite(x).any():
                x = np.where(far_outside(x), np.nan, x)
            if np.isfinite(x).all() and len(x) > MIN_SAMPLES:  # a wrong cell is missing
                are_motions = [True] if guess.quantity == "position" else []
                x = without_lone_spikes(x[:, None], LogReport("", ("",)), are_motions)[:, 0]
            is_measured = np.isnan(x).sum() < MAX_MISSING_FRACTION * len(x)
            if is_measured and (np.ptp(complete := interpolate_linearly(x)) > 0 or with_constant):
                result.append((replace(_with_counts(guess, complete), name=name), complete))
    return _with_gravity(_with_commands(result))


def _with_counts(guess: ChannelGuess, x: FloatArray) -> ChannelGuess:
    """Return the guess with a question if it has no unit and its values (n,) are whole numbers, as counts are."""
    is_whole = bool(np.all(x == np.round(x))) and float(np.ptp(x)) > _MIN_COUNTS
    if guess.unit or guess.quantity not in (*MOTIONS, *DRIVES) or not is_whole or guess.why.startswith("?"):
        return guess
    remedy = "scale = 360 / counts per turn, with unit: deg" if guess.quantity == "position" else "give unit and scale"
    return replace(guess, why=f"? whole numbers without a unit: {remedy}")


def cell_error(log: Log, names: Sequence[str], max_samples: int) -> str:
    """Return a message on the first cell of a text log that is no number; else an empty text.

    names: columns to read; all columns if the log has none of them.  max_samples: largest number of rows.
    """
    if not isinstance(log, TextLog):
        return ""
    columns = [i for i, (name, _) in enumerate(log.named_columns()) if name in names]
    return log.cell_error(columns or range(log.n_columns), slice(0, max_samples))


def _with_gravity(signals: list[tuple[ChannelGuess, FloatArray]]) -> list[tuple[ChannelGuess, FloatArray]]:
    """Set the unit, g or mm/s^2, of three axes of an accelerometer without one, whose mean is gravity."""
    accelerations = [(g, x) for g, x in signals if g.quantity == "acceleration" and not g.unit]
    axes = {g: np.mean(x) for g, x in accelerations if not g.why.startswith("?")}
    if len(axes) != 3 or len({g.family for g in axes}) > 1:
        return signals
    gravity = float(np.linalg.norm([*axes.values()]))
    cases = ("g", "m/s^2", STANDARD_GRAVITY, 1.0), ("mm/s^2", "mm/s^2", 1.0, 1e3 * STANDARD_GRAVITY)
    for name, unit, scale, size in cases:
        if abs(gravity / size - 1) < _MAX_GRAVITY_ERROR:
            why = f"unit {name}: the mean acceleration is {gravity:.4g}"
            return [(replace(g, unit=unit, scale=scale, why=why) if g in axes else g, x) for g, x in signals]
    return signals


def _resample_to_slowest(
    log: Log, channels: Sequence[tuple[str, str, float]], max_samples: int
) -> list[tuple[ChannelGuess, FloatArray]]:
    """Interpolate the signals that have a quantity at the times of the slowest one; DataError without a common time."""
    slowest, result = common_step_ms(channels), []
    for name, unit, ms in channels:
        shape, rate_hz = log.shapes()[name], None if ms == slowest else float(f"{1e3 / ms:.6g}")
        for column in range(1, 1 + min(shape)) if len(shape) > 1 else (None,):
            guess, spec = guess_by_name(name, column, unit), ChannelSpec("y", "any", name, column, quantity="position")
            if guess.quantity and ms <= slowest:
                x = log.values([spec], slice(0, int(max_samples * slowest / ms)))
                whole = interpolate_linearly(without_lone_spikes(x, LogReport("", ("",)))[:, 0])
                stamps = log.time_of(spec)
                t_ms = ms * np.arange(len(whole), dtype=np.float64)
                if stamps:
                    t, _ = read_stamps(log, stamps)
                    t_ms = 1e3 * time_units(t)[clock_rate(t)[0]] * t
                result.append((replace(guess, rate_hz=rate_hz), t_ms[: len(whole)], whole[: len(t_ms)]))
    if not result:
        return []
    spans = {guess.name: (1e-3 * t[0], 1e-3 * t[-1]) for guess, t, _ in result}
    begin, end = common_span(spans, getattr(log, "path", ""))
    at = np.arange(1e3 * begin, 1e3 * end + slowest / 2, slowest)
    signals = ((guess, np.interp(at, t, x)) for guess, t, x in result)
    return _with_commands([(guess, x) for guess, x in signals if np.ptp(x) > 0])


def _heading(log: Log, name: str, column: int) -> tuple[str, str]:
    """Return name and unit of a column by its array, or by cells InputName{1}, InputUnit{1} of an iddata struct."""
    side = re.fullmatch(r"(.*(?:Input|Output))Data", name)
    keys = [f"{side[1]}{key}{{{column}}}" if side else "" for key in ("Name", "Unit")]
    heading, unit = (log.arrays[key].text if key in log.arrays else "" for key in keys)
    return heading or name, unit or log.arrays[name].units


def _with_commands(signals: list[tuple[ChannelGuess, FloatArray]]) -> list[tuple[ChannelGuess, FloatArray]]:
    """Interpret signals named as commands, without a quantity, as positions if their joint's position follows them."""
    signals = [*zip(label_by_words([guess for guess, _ in signals]), (x for _, x in signals), strict=True)]
    positions = {g.joint_label: (g.name, x) for g, x in signals if g.quantity == "position" and g.rank >= 0}

    def interpret(guess: ChannelGuess, x: FloatArray) -> ChannelGuess:
        name, y = positions.get(guess.joint_label, ("", x))
        X, Y = (np.fft.rfft(signal - signal.mean()) for signal in (x, y))
        power = np.cumsum(np.abs(X) ** 2)
        slow = slice(0, np.searchsorted(power, power[-1] / 20) + 1)  # fast commands may be above the loop's corner
        is_near = 0 < np.linalg.norm((X - Y)[slow]) < np.linalg.norm(Y[slow]) / 2
        if guess.quantity or guess.rank >= 0 or not is_near:
            return guess
        return replace(guess, quantity="position", why=f"by its name, and since {name} follows it")

    return [(interpret(guess, x), x) for guess, x in signals]
