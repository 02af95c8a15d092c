"""Torques of a log that contradict the study: measured twice, late, mirrored, or one channel under two names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.repair import blocks
from elastid.recorded.repair.clock import CLOCK, delay


@dataclass(frozen=True)
class DriveLimits:
    """Limits of the notes on torques; their false-alarm rates are not measured."""

    min_reported_lag: float = 0.75  # a lag of u behind r, in samples, from which on it is reported
    # The lines with this part of the power of r decide after which part of a period r repeats.
    main_power_share: float = 0.995
    # The other sign fits better where its correlation is so much higher, or as high with a shorter lag.
    min_correlation_gain: float = 0.02
    # Sine of the angle between two signals without their means, up to which they are one but for rounding.
    max_difference: float = 1e-9


LIMITS = DriveLimits()


def drive_notes(channels: Sequence[ChannelSpec], signals: FloatArray, N: int | None, where: str) -> list[Note]:
    """Notes on each r of signals (n, c) and the u at its motor.  N: samples of the period, None without one."""
    u = {c.at: i for i, c in enumerate(channels) if c.role == "u"}
    drivers = [(c.at, signals[:, i], signals[:, u[c.at]]) for i, c in enumerate(channels) if c.role == "r"]
    return [Note(*code_and_text, where) for each in drivers if (code_and_text := _compared(*each, N))]


def _compared(place: str, r: FloatArray, u: FloatArray, N: int | None) -> tuple[str, str] | None:
    if np.ptp(r) > 0 and np.array_equal(r, u):
        return "same-signal", (
            f"u at {place} equals r to the last bit: the command was logged twice, so that feedback, the drive's "
            "limits and its delay are not in u; log the torque that acts, or leave the channel of role r out if "
            "nothing feeds back"
        )
    lag, correlation = _lag(r, u, N)
    turned, negative = _lag(r, -u, N)
    is_better = negative > correlation + LIMITS.min_correlation_gain
    is_as_good = negative > correlation - LIMITS.min_correlation_gain and abs(turned) < abs(lag)
    if negative >= CLOCK.min_correlation and (is_better or is_as_good):
        return "mirrored-torque", (
            f"u at {place} moves against r (correlation {-negative:.2f} after {turned:.1f} samples): the motor is "
            "mirrored or one of the two channels has the other sign; give that channel sign: -1"
        )
    if correlation >= CLOCK.min_correlation and abs(lag) >= LIMITS.min_reported_lag:
        return "late-torque", (
            f"u at {place} lags r by {lag:.1f} samples; responses of y to u do not depend on it, those "
            "estimated with the reference only if it changes from experiment to experiment"
        )
    return None


def _lag(r: FloatArray, u: FloatArray, N: int | None) -> tuple[float, float]:
    """The shortest lag of u behind r in samples, and the correlation there."""
    lag, correlation = delay(r, u, N)
    if N is None:
        return lag, correlation
    power = np.abs(np.fft.rfft(blocks(r, N).mean(axis=0))) ** 2
    power[0] = 0.0
    order = np.argsort(power)[::-1]
    n_main = int(np.searchsorted(np.cumsum(power[order]), LIMITS.main_power_share * power.sum())) + 1
    # A period repeats within itself as often as the common divisor of the lines with nearly all power.
    after = N / max(1, int(np.gcd.reduce(order[:n_main])))
    return lag - after * round(lag / after), correlation


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
            notes.append(Note("same-signal", text, where))
    return notes
