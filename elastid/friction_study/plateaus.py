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


@dataclass(frozen=True)
class PlateauLimits:
    """Limits of the judgement of plateaus and of their pairs; false alarms are not measured."""

    steady_share: float = 0.05  # change of a steady velocity in the shortest plateau, as a share of itself
    shortest_s: float = 0.15
    rest_share: float = 0.005  # of the highest speed, below which a joint is at rest
    same_speed: float = 0.05  # speeds closer than this share are the same
    other_speed: float = 0.2  # relative distance to the stated speed of a log, beyond which a plateau is no pass of it
    steady_hz: float = 15.0  # band in which a plateau is steady, about as long as the shortest one
    stick_slip_hz: float = 0.3  # band in which one with stick-slip is steady
    margin_s: float = 0.3  # around a pair, for the derivatives at its ends


PLATEAUS = PlateauLimits()


@dataclass(frozen=True)
class Plateau:
    """Samples start to stop of steady sliding at a mean velocity, rad/s or m/s with its sign."""

    start: int
    stop: int
    velocity: float


def find_plateaus(velocity: FloatArray, acceleration: FloatArray, rate_hz: float) -> tuple[Plateau, ...]:
    """The plateaus of a smooth motion (n,), in their order."""
    speed = np.abs(velocity)
    steady = speed > PLATEAUS.rest_share * speed.max(initial=0.0)
    steady &= np.abs(acceleration) * PLATEAUS.shortest_s < PLATEAUS.steady_share * speed
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(np.int8)))
    return tuple(
        Plateau(int(start), int(stop), float(velocity[start:stop].mean()))
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
        if stop - start >= PLATEAUS.shortest_s * rate_hz
    )


def alike_speeds(speeds: FloatArray) -> FloatArray:
    """Each speed (n,) as the mean of those that are the same."""
    groups = np.array(distinct_speeds([Plateau(0, 0, speed) for speed in speeds.tolist()]))
    return groups[np.argmin(np.abs(speeds[:, None] - groups), axis=1)] if len(groups) else speeds


def distinct_speeds(plateaus: Sequence[Plateau]) -> tuple[float, ...]:
    """The speeds without sign, each once, lowest first: the mean of those that are the same."""
    groups: list[list[float]] = []
    for speed in sorted(abs(plateau.velocity) for plateau in plateaus):
        if groups and speed < groups[-1][0] * (1 + PLATEAUS.same_speed):
            groups[-1].append(speed)
        else:
            groups.append([speed])
    return tuple(float(np.mean(group)) for group in groups)


def detect_passes(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """A record of passes for each pair of plateaus of a motion, named after it with a number; none where it has none.

    has_gravity: there and back must then share positions.
    Of a log with a speed, its plateaus at that speed alone. Raises DataError where such a log has no pass there and
    back at it.
    """
    plateaus = _plateaus(record, PLATEAUS.steady_hz)
    if record.speed is not None and not plateaus:
        plateaus = _plateaus(record, PLATEAUS.stick_slip_hz)
    pairs = _pairs(record, plateaus, has_gravity)
    if record.speed is not None and not pairs:
        raise DataError(_refusal(record, plateaus))
    return tuple(_cut(record, *pair, number) for number, pair in enumerate(pairs, start=1))


def lone_plateaus(record: FrictionRecord, passes: Sequence[FrictionRecord]) -> tuple[Note, ...]:
    """A note on the speeds at which a motion slides without a way back."""
    known = [each.speed for each in passes if each.speed is not None]
    alone = [
        speed
        for speed in distinct_speeds(_plateaus(record, PLATEAUS.steady_hz))
        if not any(abs(speed - other) <= PLATEAUS.same_speed * speed for other in known)
    ]
    if not alone:
        return ()
    listed = ", ".join(f"{speed:.3g}" for speed in alone)
    text = (
        f"it slides steadily at {listed} {record.unit}/s without the way back through the same positions: no level of "
        "friction at these speeds, since both directions distinguish it from gravity and offset; record both directions"
    )
    return (Note("one-direction", text, f"motion {record.name} of joint {record.joint}", "information"),)


def _plateaus(record: FrictionRecord, passband_hz: float) -> tuple[Plateau, ...]:
    """Those of the record's speed, or all."""
    velocity, acceleration = _smooth(record, passband_hz)
    plateaus = find_plateaus(velocity, acceleration, record.rate_hz)
    if record.speed is None:
        return plateaus
    return tuple(p for p in plateaus if abs(abs(p.velocity) - record.speed) <= PLATEAUS.other_speed * record.speed)


def _smooth(record: FrictionRecord, passband_hz: float) -> tuple[FloatArray, FloatArray]:
    sos = butter(4, min(passband_hz, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    velocity = np.gradient(sosfiltfilt(sos, record.position), 1 / record.rate_hz)
    return velocity, np.gradient(velocity, 1 / record.rate_hz)


def _pairs(record: FrictionRecord, plateaus: Sequence[Plateau], has_gravity: bool) -> list[tuple[Plateau, Plateau]]:
    """Each plateau with the next one back at the same speed, each used once."""

    def is_way_back(first: Plateau, other: Plateau) -> bool:
        limit = PLATEAUS.same_speed * abs(first.velocity)
        if first.velocity * other.velocity >= 0 or abs(first.velocity + other.velocity) > limit:
            return False
        q, q_back = (record.position[p.start : p.stop] for p in (first, other))
        return not has_gravity or bool(max(q.min(), q_back.min()) < min(q.max(), q_back.max()))

    pairs: list[tuple[Plateau, Plateau]] = []
    free = list(plateaus)
    while free:
        first = free.pop(0)
        if (partner := next((other for other in free if is_way_back(first, other)), None)) is not None:
            free.remove(partner)
            pairs.append((first, partner))
    return pairs


def _cut(record: FrictionRecord, forth: Plateau, back: Plateau, number: int) -> FrictionRecord:
    margin = round(PLATEAUS.margin_s * record.rate_hz)
    start, stop = max(0, forth.start - margin), min(len(record.position), back.stop + margin)
    names = ("position", "torque", "velocity", "temperature", "reference", "link_position")
    logged = {name: getattr(record, name) for name in names}
    signals: dict[str, Any] = {name: None if log is None else log[start:stop] for name, log in logged.items()}
    return replace(
        record, **signals,
        name=f"{record.name}-{number}", purpose="passes", there=(forth.start - start, forth.stop - start),
        back=(back.start - start, back.stop - start), speed=(abs(forth.velocity) + abs(back.velocity)) / 2,
        start_s=record.start_s + start / record.rate_hz, notes=(),
    )  # fmt: skip


def _refusal(record: FrictionRecord, plateaus: Sequence[Plateau]) -> str:
    where = f"{record.place}: joint {record.joint}, passes at {record.speed:.4g} {record.unit}/s"
    ways = {float(np.sign(plateau.velocity)) for plateau in plateaus}
    if len(ways) == 1:
        word = "positive" if 1.0 in ways else "negative"
        return (
            f"{where}: they have {word} velocity only; friction cannot be distinguished from gravity and offset "
            "without the way back; record both directions"
        )
    if ways:
        return f"{where}: the ways there and back cover no common positions; record both through the same window"
    velocity, _ = _smooth(record, PLATEAUS.steady_hz)
    return (
        f"{where}: no plateau was found (travel {np.ptp(record.position):.4g} {record.unit}, fastest "
        f"{np.abs(velocity).max():.4g} {record.unit}/s): the window is too short for ramps, settling and a plateau, or "
        "the speed is another; record a longer travel, or correct speed"
    )
