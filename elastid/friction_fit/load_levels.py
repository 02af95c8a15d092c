"""Levels of passes under several loads: gravity, inertia and offset are those of each load, friction is one curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_fit.levels import Levels
from elastid.friction_fit.pass_levels import PassLevels, find_levels
from elastid.friction_fit.record_passes import passes_of
from elastid.friction_record import FrictionRecord


def levels_of_records(records: Sequence[FrictionRecord], has_gravity: bool, turn: float) -> PassLevels:
    """The levels of all records of passes of a joint; `shared` is that of the first load.

    Arguments and errors as `find_levels`.
    """
    loads = dict.fromkeys(record.load for record in records)
    found = [
        find_levels(
            [each for record in records if record.load == load for each in passes_of(record)], has_gravity, turn
        )
        for load in loads
    ]
    if len(found) == 1:
        return found[0]
    levels = [one.levels for one in found]
    if not all(each.direction.any() for each in levels):
        # Directions that differ under one load alone are chance, or that load's own.
        levels = [_of_both_ways(each) for each in levels]
    rms = float(np.sqrt(np.mean([one.residual_rms**2 for one in found])))
    notes = tuple(
        replace(note, place=f"{note.place}, load {load}")
        for one, load in zip(found, loads, strict=True)
        for note in one.notes
    )
    return replace(found[0], levels=_joined(levels), residual_rms=rms, notes=notes)


def _of_both_ways(levels: Levels) -> Levels:
    """The mean of both directions at each condition, the forward ones listed first."""
    if not levels.direction.any():
        return levels
    forward, backward = levels.select(levels.direction > 0), levels.select(levels.direction < 0)
    torque, std = (forward.torque + backward.torque) / 2, np.hypot(forward.std, backward.std) / 2
    return replace(forward, direction=np.zeros(forward.n_levels), torque=torque, std=std)


def _joined(levels: Sequence[Levels]) -> Levels:
    """All levels one after the other."""

    def column(name: str) -> FloatArray:
        return np.concatenate([getattr(one, name) for one in levels])

    return Levels(
        levels[0].place, column("speed"), column("direction"), column("torque"), column("std"), column("load"),
        column("temperature"), levels[0].slides,
    )  # fmt: skip
