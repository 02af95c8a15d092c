"""Passes in any motion: its plateaus, there and back at one speed, as pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_fit.plateaus import SAME_SPEED, Plateau, distinct_speeds, find_plateaus
from elastid.friction_record import FrictionRecord

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
    part = slice(start, stop)

    def cut(signal: FloatArray | None) -> FloatArray | None:
        return None if signal is None else signal[part]

    return replace(
        record,
        name=f"{record.name}-{number}",
        purpose="passes",
        position=record.position[part],
        torque=record.torque[part],
        velocity=cut(record.velocity),
        temperature=cut(record.temperature),
        reference=cut(record.reference),
        link_position=cut(record.link_position),
        there=(there.start - start, there.stop - start),
        back=(back.start - start, back.stop - start),
        speed=(abs(there.velocity) + abs(back.velocity)) / 2,
        start_s=record.start_s + start / record.rate_hz,
        notes=(),
    )


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
