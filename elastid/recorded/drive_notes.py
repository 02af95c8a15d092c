"""Torques of a log that contradict the study: measured twice, mirrored, or one channel under two names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.repair import blocks
from elastid.recorded.repair.clock import CLOCK


@dataclass(frozen=True)
class DriveLimits:
    """Limits of the notes on torques."""

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
        return "records/same-signal", (
            f"u at {place} equals r to the last bit: the command was logged twice, so that feedback, the drive's "
            "limits and its delay are not in u; log the torque that acts, or leave the channel of role r out if "
            "nothing feeds back"
        )
    correlation = _at_once(r, u, N)
    if correlation > -CLOCK.min_correlation:
        return None
    return "records/torque", (
        f"u at {place} moves against r (correlation {correlation:.2f}): the motor is mirrored or one of the two "
        "channels has the other sign; give that channel sign: -1"
    )


def _at_once(r: FloatArray, u: FloatArray, N: int | None) -> float:
    """The correlation of r and u (n,), each line with the power that r has there.

    Feedback makes u largest where it turns the phase most.
    """
    if N is None:
        first, second = (np.concatenate([x - x.mean(), np.zeros(len(x))]) for x in (r, u))
    else:
        first, second = (blocks(x, N).mean(axis=0) for x in (r, u))
    power, U = np.abs(np.fft.rfft(first)[1:]) ** 2, np.fft.rfft(second)[1:]
    turned = np.fft.rfft(first)[1:].conj() * U
    cosine = np.divide(turned.real, np.abs(turned), out=np.zeros_like(power), where=turned != 0)
    return float(power @ cosine / max(power.sum(), 1e-300))


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
