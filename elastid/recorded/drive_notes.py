"""Torques of a log that contradict the study: measured twice, late, mirrored, or one channel under two names.

And the posture of another configuration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.experiment.specs.channels import ChannelSpec
from elastid.record import Configuration, Record
from elastid.recorded.repair import blocks
from elastid.recorded.repair.clock import CLOCK, delay


@dataclass(frozen=True)
class DriveLimits:
    """Limits of the notes on torques."""

    min_reported_lag: float = 0.75  # a lag of u behind r, in samples, from which on it is reported
    # The lines with this part of the power of r decide after which part of a period r repeats.
    main_power_share: float = 0.995
    # The other sign fits better where its correlation is so much higher, or as high with a shorter lag.
    min_correlation_gain: float = 0.02
    # A lag of a u that also moves with r at once leaves at most this part of what correlation at once leaves.
    max_left_by_lag: float = 0.1
    # Sine of the angle between two signals without their means, up to which they are one but for rounding.
    max_difference: float = 1e-9
    # Of the way between two configurations: the distance of the mean angles from the other one, at most, and the motion
    # (RMS) about it.
    from_other: float = 0.05
    motion: float = 0.2


MAX_SAMPLES = 1 << 18  # that show where the motors stand; a log may be larger than the memory

LIMITS = DriveLimits()


def drive_notes(channels: Sequence[ChannelSpec], signals: FloatArray, N: int | None, where: str) -> list[Note]:
    """Notes on each r of signals (n, c) and the u at its motor.  N: samples of the period, None without one."""
    u = {c.at: i for i, c in enumerate(channels) if c.role == "u"}
    drivers = [(c.at, signals[:, i], signals[:, u[c.at]]) for i, c in enumerate(channels) if c.role == "r"]
    return [Note(*code_and_text, where) for each in drivers if (code_and_text := _compared(*each, N))]


def posture_notes(
    record: Record, motors: Sequence[str], configurations: Sequence[Configuration], where: str
) -> list[Note]:
    """A note on a record that stands where another configuration of the study is, and not where its own is.

    motors: of the driven joints, in the order of the angles.  Angles that are all 0 are those of encoders that count
    from where they were switched on.
    """
    places = [i for i, _ in enumerate(record.configuration.angles) if motors[i] in record.outputs]
    columns = [record.outputs.index(motors[i]) for i in places]
    if not columns or any(record.quantities[column] != "position" for column in columns):
        return []
    y, own = record.y[:MAX_SAMPLES][:, columns], record.configuration
    mean, rms = y.mean(axis=0), float(y.std(axis=0).max())
    for other in configurations:
        there, here = other.angles[places], own.angles[places]
        way = float(np.abs(there - here).max())
        is_there = float(np.abs(mean - there).max()) < LIMITS.from_other * way
        if is_there and rms < LIMITS.motion * way and there.any():
            angles = ["(" + ", ".join(f"{angle:.3g}" for angle in of) + ")" for of in (mean, there, here)]
            text = (
                f"its motors stand at {angles[0]}, where configuration {other.name} is {angles[1]}, and not "
                f"{own.name}, {angles[2]}: the log may be one of {other.name}"
            )
            return [Note("records/other-posture", text, where)]
    return []


def _compared(place: str, r: FloatArray, u: FloatArray, N: int | None) -> tuple[str, str] | None:
    if np.ptp(r) > 0 and np.array_equal(r, u):
        return "records/same-signal", (
            f"u at {place} equals r to the last bit: the command was logged twice, so that feedback, the drive's "
            "limits and its delay are not in u; log the torque that acts, or leave the channel of role r out if "
            "nothing feeds back"
        )
    lag, correlation, at_once = _lag(r, u, N)
    turned, negative, _ = _lag(r, -u, N)
    is_better = negative > correlation + LIMITS.min_correlation_gain
    is_as_good = negative > correlation - LIMITS.min_correlation_gain and abs(turned) < abs(lag)
    # Feedback turns the phase of low lines; a long lag, or one with the other sign, does so for a sparse grid.
    is_at_once = abs(at_once) >= CLOCK.min_correlation
    is_lag = not is_at_once or 1 - correlation < LIMITS.max_left_by_lag * (1 - abs(at_once))
    is_lag_only = is_lag and correlation > abs(at_once) + LIMITS.min_correlation_gain
    is_turned = negative >= CLOCK.min_correlation and (is_better or is_as_good)
    if (at_once < 0 and not is_lag_only) if is_at_once else is_turned:
        return "records/torque", (
            f"u at {place} moves against r (correlation {-negative:.2f} after {turned:.1f} samples): the motor is "
            "mirrored or one of the two channels has the other sign; give that channel sign: -1"
        )
    if is_lag and correlation >= CLOCK.min_correlation and abs(lag) >= LIMITS.min_reported_lag:
        return "records/torque", (
            f"u at {place} lags r by {lag:.1f} samples; responses of y to u do not depend on it, those "
            "estimated with the reference only if it changes from experiment to experiment"
        )
    return None


def _lag(r: FloatArray, u: FloatArray, N: int | None) -> tuple[float, float, float]:
    """The shortest lag of u behind r in samples, and the correlations there and without a lag.

    Each line has the power that r has there: feedback makes u largest where it turns the phase most.
    """
    if N is None:
        first, second = (np.concatenate([x - x.mean(), np.zeros(len(x))]) for x in (r, u))
    else:
        first, second = (blocks(x, N).mean(axis=0) for x in (r, u))
    n, U = len(first), np.fft.rfft(second)
    phase = np.divide(U, np.abs(U), out=np.zeros_like(U), where=U != 0)
    even = np.fft.irfft(np.abs(np.fft.rfft(first)) * phase, n)
    lag, correlation = delay(first, even, n)
    size = float(np.linalg.norm(first - first.mean()) * np.linalg.norm(even - even.mean()))
    at_once = float((first - first.mean()) @ even) / size if size > 0 else 0.0
    if N is None:
        return lag, correlation, at_once
    after = N / _common_divisor(first)
    return lag - after * round(lag / after), correlation, at_once


def _common_divisor(period: FloatArray) -> int:
    """The common divisor of the lines with nearly all power of a period (N,): it repeats so often within itself."""
    power = np.abs(np.fft.rfft(period)) ** 2
    power[0] = 0.0
    order = np.argsort(power)[::-1]
    n_main = int(np.searchsorted(np.cumsum(power[order]), LIMITS.main_power_share * power.sum())) + 1
    return max(1, int(np.gcd.reduce(order[:n_main])))


def same_signal_notes(channels: Sequence[ChannelSpec], signals: FloatArray, where: str) -> list[Note]:
    """A note on each pair of torques, or of motors' motions, of signals (n, c) that move as one up to a factor."""
    moving = signals - signals.mean(axis=0)
    size = np.linalg.norm(moving, axis=0)
    known = [i for i, c in enumerate(channels) if c.role in ("u", "y") and c.at.startswith("motor ") and size[i] > 0]
    notes = []
    for a, b in combinations(known, 2):
        if channels[a].role != channels[b].role:
            continue
        factor = moving[:, a] @ moving[:, b] / size[a] ** 2
        if np.linalg.norm(moving[:, b] - factor * moving[:, a]) <= LIMITS.max_difference * size[b]:
            text = (
                f"{channels[b].full_name} holds the samples of {channels[a].full_name}: one of the two is not the "
                "signal of its motor; check channel and column in the study, and the wiring of the logger"
            )
            notes.append(Note("records/same-signal", text, where))
    return notes
