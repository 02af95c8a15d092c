"""Channels of two motors that hold the same samples: one signal was logged twice, or a column was named twice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.experiment.specs.channels import ChannelSpec

# Sine of the angle between two signals without their means, up to which they are one but for rounding.
_MAX_DIFFERENCE = 1e-9


def same_signal_notes(channels: Sequence[ChannelSpec], signals: FloatArray, where: str) -> list[Note]:
    """A note on each pair of torques, or of motions of motors, in signals (n, c) that are one up to a factor.

    Signals that do not move are left to other checks.
    """
    moving = signals - signals.mean(axis=0)
    size = np.linalg.norm(moving, axis=0)
    known = [i for i, c in enumerate(channels) if c.role in ("u", "y") and c.at.startswith("motor ") and size[i] > 0]
    notes = []
    for a, b in combinations(known, 2):
        if channels[a].role != channels[b].role:
            continue
        factor = moving[:, a] @ moving[:, b] / size[a] ** 2
        if np.linalg.norm(moving[:, b] - factor * moving[:, a]) <= _MAX_DIFFERENCE * size[b]:
            said = (
                f"{channels[b].full_name} holds the samples of {channels[a].full_name}: one of the two is not the "
                "signal of its motor; check channel and column in the study, and the wiring of the logger"
            )
            notes.append(Note("same-signal", said, where))
    return notes
