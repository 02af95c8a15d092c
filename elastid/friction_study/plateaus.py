"""Plateaus of any motion, the parts in which it slides steadily, and passes: plateaus there and back at one speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.record import FrictionRecord

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


# A plateau is steady behind this filter, which is about as long as the shortest one.
STEADY_HZ = 15.0
# One in which the joint sticks and slips is steady only behind this one.
STICK_SLIP_HZ = 0.3
FILTER_ORDER = 4
# Of the speed that a log is of: plateaus at others are none of its passes.
OTHER_SPEED = 0.2
# Seconds beside a pair that the derivatives of its ends need.
BESIDE_S = 0.3


def detect_passes(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """A record of passes for each pair of plateaus of a motion, named after it with a number; none where it has none.

    has_gravity: there and back must then share positions.
    Of a log with a speed, its plateaus at that speed alone. Raises DataError where such a log has no pass there and
    back at it.
    """
    plateaus = _plateaus(record, STEADY_HZ)
    if record.speed is not None and not plateaus:
        plateaus = _plateaus(record, STICK_SLIP_HZ)
    pairs = _pairs(record, plateaus, has_gravity)
    if record.speed is not None and not pairs:
        raise DataError(_refusal(record, plateaus))
    return tuple(_cut(record, there, back, number) for number, (there, back) in enumerate(pairs, start=1))


def lone_plateaus(record: FrictionRecord, passes: Sequence[FrictionRecord]) -> tuple[Note, ...]:
    """A note on the speeds at which a motion slides without a way back."""
    known = [each.speed for each in passes if each.speed is not None]
    alone = [
        speed
        for speed in distinct_speeds(_plateaus(record, STEADY_HZ))
        if not any(abs(speed - other) <= SAME_SPEED * speed for other in known)
    ]
    if not alone:
        return ()
    listed = ", ".join(f"{speed:.3g}" for speed in alone)
    text = (
        f"it slides steadily at {listed} {record.unit}/s without the way back through the same positions: no level of "
        "friction there, since that tells it from gravity and offset; record both directions"
    )
    return (Note("one-direction", text, f"motion {record.name} of joint {record.joint}", "information"),)


def _plateaus(record: FrictionRecord, passband_hz: float) -> tuple[Plateau, ...]:
    """Those of the record's speed, or all."""
    velocity, acceleration = _smooth(record, passband_hz)
    found = find_plateaus(velocity, acceleration, record.rate_hz)
    if record.speed is None:
        return found
    return tuple(p for p in found if abs(abs(p.velocity) - record.speed) <= OTHER_SPEED * record.speed)


def _smooth(record: FrictionRecord, passband_hz: float) -> tuple[FloatArray, FloatArray]:
    sos = butter(FILTER_ORDER, min(passband_hz, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    velocity = np.gradient(sosfiltfilt(sos, record.position), 1 / record.rate_hz)
    return velocity, np.gradient(velocity, 1 / record.rate_hz)


def _pairs(record: FrictionRecord, plateaus: Sequence[Plateau], has_gravity: bool) -> list[tuple[Plateau, Plateau]]:
    """Each plateau with the next one back at the same speed, each used once."""
    pairs: list[tuple[Plateau, Plateau]] = []
    free = list(plateaus)
    while free:
        first = free.pop(0)
        partner = next((other for other in free if _belong(record, first, other, has_gravity)), None)
        if partner is not None:
            free.remove(partner)
            pairs.append((first, partner))
    return pairs


def _belong(record: FrictionRecord, one: Plateau, other: Plateau, has_gravity: bool) -> bool:
    if one.velocity * other.velocity >= 0 or abs(one.velocity + other.velocity) > SAME_SPEED * abs(one.velocity):
        return False
    first, second = (record.position[p.start : p.stop] for p in (one, other))
    return not has_gravity or bool(max(first.min(), second.min()) < min(first.max(), second.max()))


def _cut(record: FrictionRecord, there: Plateau, back: Plateau, number: int) -> FrictionRecord:
    beside = round(BESIDE_S * record.rate_hz)
    start, stop = max(0, there.start - beside), min(len(record.position), back.stop + beside)
    names = ("position", "torque", "velocity", "temperature", "reference", "link_position")
    logged = {name: getattr(record, name) for name in names}
    signals: dict[str, Any] = {name: None if log is None else log[start:stop] for name, log in logged.items()}
    return replace(
        record, **signals,
        name=f"{record.name}-{number}", purpose="passes", there=(there.start - start, there.stop - start),
        back=(back.start - start, back.stop - start), speed=(abs(there.velocity) + abs(back.velocity)) / 2,
        start_s=record.start_s + start / record.rate_hz, notes=(),
    )  # fmt: skip


def _refusal(record: FrictionRecord, plateaus: Sequence[Plateau]) -> str:
    where = f"{record.place}: joint {record.joint}, passes at {record.speed:.4g} {record.unit}/s"
    ways = {float(np.sign(plateau.velocity)) for plateau in plateaus}
    if len(ways) == 1:
        word = "positive" if 1.0 in ways else "negative"
        return (
            f"{where}: they have {word} velocity only; friction cannot be told from gravity and offset without the way "
            "back; record both directions"
        )
    if ways:
        return f"{where}: the ways there and back cover no common positions; record both through the same window"
    velocity, _ = _smooth(record, STEADY_HZ)
    return (
        f"{where}: no plateau was found (travel {np.ptp(record.position):.4g} {record.unit}, fastest "
        f"{np.abs(velocity).max():.4g} {record.unit}/s): the window is too short for ramps, settling and a plateau, or "
        "the speed is another; record a longer travel, or correct speed"
    )
