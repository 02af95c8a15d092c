"""Which shapes of friction are tried, on the scale of the motors' own motion, and when none can be found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.frf.friction.limits import torque_is_reference
from elastid.frf.friction.motion import Motion, motion_of
from elastid.frf.friction.shapes import Kind, Shape
from elastid.frf.spectra import RecordSpectra
from elastid.record import Record

# Speeds over which a sign turns, over the RMS speed.
_TURNING = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)
# Distances over which a bristle bends, over the median distance between reversals. A much longer one is a spring, which
# is part of the response. Steps of 2 instead of its root leave k up to four times as far off under LuGre.
_BENDING = tuple(0.025 * 2 ** (i / 2) for i in range(15))
_BRISTLES: tuple[Kind, ...] = ("stop", "bristle")
# The sign of a velocity with more noise than this, over its RMS, is noise.
_MAX_VELOCITY_NOISE = 0.03


def candidate_shapes(records: Sequence[Record], signs_alone: bool) -> tuple[Shape, ...]:
    """For every motor a sign, at once or gradual, and bristles."""
    shapes: list[Shape] = []
    for place in records[0].inputs:
        motions = [motion_of(record, place) for record in records]
        speed = float(np.sqrt(np.mean([motion.speed**2 for motion in motions])))
        shapes += [Shape(place, "sign", part * speed) for part in _TURNING]
        swing = _typical_swing(motions)
        if not signs_alone and swing > 0:
            shapes += [Shape(place, kind, part * swing) for kind in _BRISTLES for part in _BENDING]
    return tuple(shapes)


def refusal(records: Sequence[Record]) -> str:
    """Why friction cannot be found in the records of a configuration; empty where it can."""
    first = records[0]
    if not first.is_periodic:
        return "the records have no period; friction is found from differences between periodic experiments"
    missing = [place for place in first.inputs if place not in first.outputs]
    if missing:
        return (
            f"the angle of {', '.join(missing)} is not among the outputs; log the motor angles, since friction is a "
            "function of them"
        )
    if same := torque_is_reference(first):
        return (
            f"the torque of {', '.join(same)} equals the reference to the last bit, so that what the controller adds "
            "against friction is not in it and friction cannot be told; log the torque, or the current, that the "
            "drive is given"
        )
    if any(RecordSpectra(record).is_large for record in records):
        return "the records are worked on in pieces, since they are large; leave periods out, or lower their rate"
    n_u, K = len(first.inputs), len(records)
    if n_u > K:
        return f"{K} experiments do not separate {n_u} inputs; measure more, since friction is what responses leave"
    for place in first.inputs:
        noise, speed = _velocity(records, place)
        if noise > _MAX_VELOCITY_NOISE * speed:
            return (
                f"the velocity of {place} is {speed:.2g} RMS and its noise {noise:.2g}, so that its sign is not known; "
                "use an encoder of more counts, or excite slower or larger motions"
            )
    return ""


def _velocity(records: Sequence[Record], place: str) -> tuple[float, float]:
    """RMS noise and RMS of the velocity of a motor, in the first of the records."""
    motion = motion_of(records[0], place)
    return motion.velocity_noise, motion.speed


def _typical_swing(motions: Sequence[Motion]) -> float:
    swings = np.concatenate([motion.swings for motion in motions])
    return float(np.median(swings)) if swings.size else 0.0
