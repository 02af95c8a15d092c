"""The log of a warm-up and its test passes -> the data of the thermal model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.friction_fit.pass_regression import Pass
from elastid.friction_fit.plateaus import alike_speeds
from elastid.friction_fit.record_passes import passes_of
from elastid.friction_fit.warm_up import WarmUp
from elastid.friction_record import FrictionRecord, WarmUpLog


def warm_up_of(log: WarmUpLog, tests: Sequence[FrictionRecord]) -> WarmUp:
    """The log with the level of each test pass, half the difference of the means of its directions.

    Means are over the angles that both directions cover, so that gravity is alike in both.
    """
    pairs = [_common(sorted(passes_of(record), key=lambda each: -each.direction)) for record in tests]
    speeds = [(there.velocity.mean() - back.velocity.mean()) / 2 for there, back in pairs]
    levels = [(there.torque.mean() - back.torque.mean()) / 2 for there, back in pairs]
    stds = [np.hypot(*(np.std(each.torque) / np.sqrt(len(each.torque)) for each in pair)) / 2 for pair in pairs]
    at = np.searchsorted(log.time_s, [record.start_s for record in tests], side="right") - 1
    return WarmUp(
        log.time_s, log.power, log.ambient_degc, log.start_degc, log.temperature, log.temperature_std,
        np.clip(at, 0, len(log.time_s) - 1), alike_speeds(np.array(speeds)), np.array(levels), np.array(stds),
        np.array([record.load_torque for record in tests]),
    )  # fmt: skip


def _common(pair: Sequence[Pass]) -> list[Pass]:
    """There and back where both have been."""
    low = max(float(each.position.min()) for each in pair)
    high = min(float(each.position.max()) for each in pair)
    if high <= low:
        return list(pair)
    inside = [(each.position >= low) & (each.position <= high) for each in pair]
    return [
        replace(
            each, position=each.position[own], velocity=each.velocity[own], acceleration=each.acceleration[own],
            torque=each.torque[own],
        )
        for each, own in zip(pair, inside, strict=True)
    ]  # fmt: skip
