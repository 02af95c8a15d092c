"""Passes there and back in the log of any motion: ways at one speed on the whole, and steady parts of other ways.

A way is a part of the log between two turning points. Cogging makes the speed of a slow pass wander about its mean by
a fifth and more, so that its acceleration is nowhere small; its position stays close to a straight line all the same.
Such a way is one plateau, whose ends are where the line is left. Elsewhere, as in ways with several speeds, a plateau
is where the velocity is steady.

Faults of passes that would be taken for friction: clipped torques, and sticking.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError, Note
from elastid.friction_study.passes import PLATEAUS, Pass, Plateau, find_plateaus, one_way
from elastid.record import FrictionRecord


def detect_passes(record: FrictionRecord, has_gravity: bool) -> tuple[FrictionRecord, ...]:
    """A record of passes for each pair of plateaus of a motion, named after it with a number; none where it has none.

    has_gravity: there and back must then share positions.  Of a log with a speed, its plateaus at that speed alone;
    DataError where such a log has no pass there and back at it.
    """
    plateaus = _plateaus(record)
    pairs = _pairs(record, plateaus, has_gravity)
    if record.speed is not None and not pairs:
        raise DataError("friction/passes", _refusal(record, plateaus))
    return tuple(_cut(record, *pair, number) for number, pair in enumerate(pairs, start=1))


def _plateaus(record: FrictionRecord) -> tuple[Plateau, ...]:
    """In their order; of a log with a speed those at it alone."""
    position, velocity, acceleration = _smooth(record)
    of_ways = [_plateau_of_way(position, *way, record.rate_hz) for way in _ways(position)]
    ways = [plateau for plateau in of_ways if plateau is not None]
    steady = find_plateaus(velocity, acceleration, record.rate_hz)
    parts = [each for each in steady if not any(each.start < way.stop and way.start < each.stop for way in ways)]
    plateaus = [*ways, *parts]
    if record.speed is not None:
        reach = PLATEAUS.other_speed * record.speed
        plateaus = [each for each in plateaus if abs(abs(each.velocity) - record.speed) <= reach]
    return tuple(sorted(plateaus, key=lambda each: each.start))


def _smooth(record: FrictionRecord) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and acceleration (n,)."""
    sos = butter(4, min(PLATEAUS.steady_hz, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    position = np.asarray(sosfiltfilt(sos, record.position))
    velocity = np.gradient(position, 1 / record.rate_hz)
    return position, velocity, np.gradient(velocity, 1 / record.rate_hz)


def _ways(position: FloatArray) -> list[tuple[int, int]]:
    """First sample of each way and the one after its last: between turning points, from which it goes back far enough.

    What is not as far, stick-slip and noise at rest, turns no way.
    """
    far = PLATEAUS.turn_share * float(np.ptp(position))
    slope = np.sign(np.diff(position))
    peaks = [0, *(np.flatnonzero(slope[1:] != slope[:-1]) + 1).tolist(), len(position) - 1]
    turns, low, high, sign = list[int](), 0, 0, 0  # sign: of the way, 0 before the first
    for i in peaks:
        low, high = (i if position[i] < position[low] else low), (i if position[i] > position[high] else high)
        if sign >= 0 and position[high] - position[i] > far:
            turns.append(high)
            sign, low, high = -1, i, i
        elif sign <= 0 and position[i] - position[low] > far:
            turns.append(low)
            sign, low, high = 1, i, i
    return list(zip(turns, [*turns[1:], len(position)], strict=True))


def _plateau_of_way(position: FloatArray, start: int, stop: int, rate_hz: float) -> Plateau | None:
    """The plateau of a way of which half of the time at least is spent at one speed, if means over windows are."""
    way = position[start:stop]
    travelled = np.abs(way - way[0]) > PLATEAUS.end_share * np.ptp(way)
    ahead = np.abs(way - way[-1]) > PLATEAUS.end_share * np.ptp(way)
    first, last = int(np.argmax(travelled)), len(way) - int(np.argmax(ahead[::-1]))
    w = (last - first) // PLATEAUS.windows
    if PLATEAUS.windows * w < 2 * PLATEAUS.shortest_s * rate_hz:
        return None
    steps = way[first + w : last] - way[first : last - w]  # travels over one window
    change, travel = np.abs(steps[w:] - steps[:-w]), np.abs(steps[w:] + steps[:-w]) / 2
    run = _longest_run(change < PLATEAUS.steady_share * travel)
    if run.stop - run.start < w:
        return None
    # The outer windows may reach into ramps, by as much as their means allow.
    inner = slice(first + run.start + w // 2, first + run.stop + 2 * w - w // 2)
    t = np.arange(len(way)) / rate_hz
    speed, offset = np.polyfit(t[inner], way[inner], 1)
    away = np.abs(way - speed * t - offset)
    on_line = away <= PLATEAUS.line_share * away[inner].max()
    before, after = on_line[: inner.start][::-1], on_line[inner.stop :]
    begin = inner.start - int(np.argmin(np.append(before, False)))
    return Plateau(start + begin, start + inner.stop + int(np.argmin(np.append(after, False))), float(speed))


def _longest_run(samples: BoolArray) -> slice:
    """Of those that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], samples, [False]]).astype(np.int8)))
    runs = [slice(0, 0), *(slice(*pair) for pair in edges.reshape(-1, 2).tolist())]
    return max(runs, key=lambda run: int(run.stop - run.start))


def _pairs(record: FrictionRecord, plateaus: Sequence[Plateau], has_gravity: bool) -> list[tuple[Plateau, Plateau]]:
    """Each plateau with the next one back at the same speed, each used once."""

    def is_way_back(first: Plateau, other: Plateau) -> bool:
        limit = PLATEAUS.same_speed * abs(first.velocity)
        if first.velocity * other.velocity >= 0 or abs(first.velocity + other.velocity) > limit:
            return False
        return not has_gravity or _share_positions(record, first, other)

    pairs: list[tuple[Plateau, Plateau]] = []
    free = list(plateaus)
    while free:
        first = free.pop(0)
        if (partner := next((other for other in free if is_way_back(first, other)), None)) is not None:
            free.remove(partner)
            pairs.append((first, partner))
    return pairs


def _share_positions(record: FrictionRecord, first: Plateau, other: Plateau) -> bool:
    q, q_back = (record.position[each.start : each.stop] for each in (first, other))
    common = min(q.max(), q_back.max()) - max(q.min(), q_back.min())
    return bool(common > PLATEAUS.common_share * min(np.ptp(q), np.ptp(q_back)))


def _cut(record: FrictionRecord, forth: Plateau, back: Plateau, number: int) -> FrictionRecord:
    margin = round(PLATEAUS.margin_s * record.rate_hz)
    start, stop = max(0, forth.start - margin), min(len(record.position), back.stop + margin)
    names = ("position", "torque", "velocity", "temperature", "disturbance", "reference", "link_position")
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
        return f"{where}: they have {one_way(ways)}"
    speeds = ", ".join(f"{each.velocity:.4g}" for each in plateaus) or "none"
    return (
        f"{where}: of its plateaus (at {speeds} {record.unit}/s) none is there and back at one speed, within "
        f"{PLATEAUS.same_speed:.0%}, through common positions; record both directions through the same window, longer "
        "than ramps and settling, or correct speed"
    )


@dataclass(frozen=True)
class PassThresholds:
    """Thresholds of the judgement of passes; shares are of the quantity that is named."""

    clipped_share: float = 0.02  # of a pass, at the largest torque of all passes, from which on it is clipped
    min_values: int = 50  # different torques of a pass in a log of fine steps
    min_change: float = 0.03  # of friction with the angle, relative, that is worth a note
    min_counts: float = 3.0  # amplitude of a loop in counts, below which it is steps of the encoder


PASSES = PassThresholds()


def usable_passes(passes: Sequence[Pass]) -> tuple[list[Pass], list[Note]]:
    """The passes that slide below the drive's limit, and notes on the others, whole pairs; DataError where none is."""
    sticking = {
        each.pair: f"the joint stands or turns back within the pass (velocity {each.velocity.min():.3g} to "
        f"{each.velocity.max():.3g}): it sticks and slips at this speed, and its level does not count; raise the "
        "bandwidth of the controller, or measure faster"
        for each in passes
        if each.turns_back
    }
    faults = {pair: ("friction/passes", text) for pair, text in sticking.items()}
    faults |= {pair: ("friction/passes", text) for pair, text in _clipped(passes).items()}
    notes = [Note(code, text, f"pass {name}") for name, (code, text) in faults.items()]
    used = [each for each in passes if each.pair not in faults]
    if not used:
        place = passes[0].place if passes else "the joint"
        reason = f"; {notes[0]}" if notes else ""
        raise DataError(
            "friction/passes",
            f"none slides all the time; measure faster, or raise the bandwidth of the controller{reason}",
            f"passes of {place}",
        )
    return used, notes


def _clipped(passes: Sequence[Pass]) -> dict[str, str]:
    """Pairs in which a torque stands at the largest of all passes."""
    limit = max((float(np.abs(each.torque).max()) for each in passes), default=0.0)
    pairs: dict[str, str] = {}
    for each in passes:
        share = float(np.mean(np.abs(each.torque) == limit))
        # The steps of a coarse converter, or a torque without noise, are no limit.
        if share >= PASSES.clipped_share and len(np.unique(each.torque)) > PASSES.min_values:
            pairs[each.pair] = (
                f"{share:.0%} of its torques stand at the limit of {limit:.4g}: clipped there, so that its level is "
                "too low and does not count; measure slower, or raise the limit of the drive"
            )
    return pairs


def check_reversal(record: FrictionRecord) -> None:
    """DataError for loops without a way back."""
    if np.count_nonzero(np.diff(np.sign(record.torque - record.torque.mean()))) == 1:
        raise DataError(
            "friction/presliding",
            f"loops of joint {record.joint}: its torque never reverses, so that friction cannot be "
            "distinguished from a spring; log loops to and fro, or take purpose: motion",
            record.place,
        )
