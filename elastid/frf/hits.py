"""Faults of hammer tests in records without a period: double hits, overloads, wrong triggers.

A channel is a hammer's where its force is far from 0 in a few samples only.  Pulses are runs of samples beyond a tenth
of the largest one; two within 0.15 s are one hit that bounced.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.display import percent
from elastid.base.errors import Note
from elastid.record import Record


@dataclass(frozen=True)
class HitLimits:
    """Judgement of hits."""

    beyond: float = 0.1  # of the largest sample, where a pulse begins
    share: float = 0.02  # of samples of a hammer's force in pulses, at most
    samples: int = 20_000  # evenly taken, of which twice as many in pulses are another force's
    bounce_s: float = 0.15  # between two pulses of one hit, at most
    run: int = 3  # samples at exactly the limit of a channel
    run_share: float = 0.08  # of a pulse


LIMITS = HitLimits()


@dataclass(frozen=True)
class Pulses:
    """first, last (n,): samples of each pulse of a force u (N,); size (n,): its largest |u|."""

    first: IntArray
    last: IntArray
    size: FloatArray

    @classmethod
    def of(cls, u: FloatArray) -> Pulses | None:
        """The pulses of a hammer; None for another force, which some samples show."""
        few = u[:: -(-len(u) // LIMITS.samples) or 1]
        middle = np.median(few)
        largest = max(u.max(initial=0.0) - middle, middle - u.min(initial=0.0))
        if np.mean(np.abs(few - middle) > LIMITS.beyond * largest) > 2 * LIMITS.share:
            return None
        x = np.abs(u - np.median(u))
        beyond = x > LIMITS.beyond * x.max(initial=0.0)
        if not beyond.any() or beyond.mean() > LIMITS.share:
            return None
        first, last = runs(beyond)
        size = [x[a : b + 1].max() for a, b in zip(first, last, strict=True)]
        return cls(first, last, np.array(size))


def runs(flags: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last index (n,) of each run of True.

    >>> [index.tolist() for index in runs(np.array([True, False, True, True]))]
    [[0, 2], [0, 3]]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return edges[::2], edges[1::2] - 1


def hit_notes(records: Sequence[Record]) -> tuple[Note, ...]:
    """Notes on records of hits; none where no input is a hammer's."""
    return tuple(note for record in records for note in _notes(record))


def _notes(record: Record) -> Iterator[Note]:
    place = f"configuration {record.configuration.name}, record {record.name}"
    forces = [(name, record.u[:, j], Pulses.of(record.u[:, j])) for j, name in enumerate(record.inputs)]
    hit = [(name, u, pulses) for name, u, pulses in forces if pulses is not None]
    for name, u, pulses in hit:
        if text := _double_hits(record, name, pulses):
            yield Note("frf/hits", text, place)
        if pulses.first[0] == 0 or pulses.last[-1] == len(u) - 1:
            text = (
                f"begins or ends within a hit of {name}, whose force or answer is cut: set a pretrigger of some "
                "milliseconds, and record until the answer has died out"
            )
            yield Note("frf/hits", text, place)
    overloads = [(name, _overloads_of_force(u, pulses)) for name, u, pulses in hit]
    overloads += [(name, _overloads_of_answer(y)) for name, y in zip(record.outputs, record.y.T, strict=True) if hit]
    if found := [f"{name} ({count} times)" for name, count in overloads if count]:
        text = (
            f"stays at the end of its range at {', '.join(found)}: overloaded, which makes responses too large or looks"
            " like damping; hit more softly, or take a wider range"
        )
        yield Note("frf/overload", text, place)


def _double_hits(record: Record, name: str, pulses: Pulses) -> str:
    # Pulses that follow another within a hit.
    bounces = np.flatnonzero(np.diff(pulses.first) / record.rate_hz < LIMITS.bounce_s) + 1
    if not len(bounces):
        return ""
    gap = (pulses.first[bounces] - pulses.first[bounces - 1]) / record.rate_hz
    strength = pulses.size[bounces] / pulses.size[bounces - 1]
    worst = int(np.argmax(strength))
    begins = pulses.first[bounces[worst] - 1] / record.rate_hz
    return (
        f"{len(bounces)} of {len(pulses.first) - len(bounces)} hits of {name} are double, one {begins:.4g} s into "
        f"the record with a second blow {1000 * gap[worst]:.3g} ms later and {percent(strength[worst], 2)} as "
        f"strong: the force has dips every {1 / gap[worst]:.3g} Hz, where the response is uncertain; leave that "
        "hit out of the record, or hit again with a lighter hammer"
    )


def _overloads_of_force(u: FloatArray, pulses: Pulses) -> int:
    """Hits that stay at the largest force for some samples."""
    top, flat = float(np.abs(u).max()), 0
    for a, b in zip(pulses.first, pulses.last, strict=True):
        first, last = runs(np.abs(u[a : b + 1]) == top)
        flat += int(np.max(last - first + 1, initial=0)) >= max(LIMITS.run, LIMITS.run_share * (b - a + 1))
    return flat


def _overloads_of_answer(y: FloatArray) -> int:
    """Visits of some samples to either end of what it reaches; 0 for a single one, and where it does not move."""
    visits = 0
    for limit in (y.max(), y.min()):
        first, last = runs(y == limit)
        visits += int(np.sum(last - first + 1 >= LIMITS.run))
    return visits if visits > 1 and np.ptp(y) > 0 else 0
