"""Plateaus: the parts of a motion in which it slides steadily, whatever the motion was made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray

# A velocity is steady where it changes by less than this share of itself in the shortest plateau.
STEADY_SHARE = 0.05
SHORTEST_S = 0.15
# Below this share of the highest speed a joint is at rest.
REST_SHARE = 0.005
# Speeds closer than this share are one.
SAME_SPEED = 0.05


@dataclass(frozen=True)
class Plateau:
    """Samples start to stop of steady sliding at a mean velocity, rad/s or m/s with its sign."""

    start: int
    stop: int
    velocity: float


def find_plateaus(velocity: FloatArray, acceleration: FloatArray, rate_hz: float) -> tuple[Plateau, ...]:
    """The plateaus of a smooth motion (n,), in their order."""
    speed = np.abs(velocity)
    steady = (speed > REST_SHARE * speed.max(initial=0.0)) & (np.abs(acceleration) * SHORTEST_S < STEADY_SHARE * speed)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(np.int8)))
    shortest = SHORTEST_S * rate_hz
    return tuple(
        Plateau(int(start), int(stop), float(velocity[start:stop].mean()))
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
        if stop - start >= shortest
    )


def alike_speeds(speeds: FloatArray) -> FloatArray:
    """Each speed (n,) as the mean of those that are alike."""
    found = np.array(distinct_speeds([Plateau(0, 0, speed) for speed in speeds.tolist()]))
    return found[np.argmin(np.abs(speeds[:, None] - found), axis=1)] if len(found) else speeds


def distinct_speeds(plateaus: Sequence[Plateau]) -> tuple[float, ...]:
    """The speeds without sign, each once, lowest first: the mean of those that are alike."""
    groups: list[list[float]] = []
    for speed in sorted(abs(plateau.velocity) for plateau in plateaus):
        if groups and speed < groups[-1][0] * (1 + SAME_SPEED):
            groups[-1].append(speed)
        else:
            groups.append([speed])
    return tuple(float(np.mean(group)) for group in groups)
