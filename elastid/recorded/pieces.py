"""A log that is too large for memory: measured in pieces of whole periods (without one, of any length), in step.

A piece is read, repaired and checked as a log of its own, and its samples go to a file.  Where the pieces are not in
step (lost samples, a clock that differs, a piece that is refused) the log must be measured as a whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from elastid.base import arrays
from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.record import Record
from elastid.recorded.link_side import UNWRAPPED
from elastid.recorded.repair.clock import CLOCK, RESAMPLED, delay
from elastid.recorded.repair.missing import DOUBLED, DROPPED


def may_be_large(path: Path) -> bool:
    """True if its signals may be too many for memory: a value takes a byte of the file at least, unless compressed."""
    return path.stat().st_size >= arrays.MIN_LARGE_VALUES


def pieces(n: int, N: int | None, n_channels: int) -> tuple[tuple[int, int], ...]:
    """First and last sample of pieces of whole periods N (None: of any length); none where the log fits into memory."""
    if n * n_channels < arrays.MIN_LARGE_VALUES:
        return ()
    if N is None:
        count = -(-n * n_channels // arrays.PIECE_VALUES)
        return tuple(pairwise(i * n // count for i in range(count + 1)))
    # A median over fewer than eight periods cannot distinguish a spike from a signal.
    periods = max(8, arrays.PIECE_VALUES // (N * n_channels))
    count = n // N // periods
    bounds = [i * periods * N for i in range(count)] + [n // N * N]
    return tuple(pairwise(bounds)) if count > 1 else ()


def joined(parts: Iterable[Record], sizes: tuple[int, ...]) -> Record | None:
    """The record of all pieces, of so many samples each, its signals in files; None where they are not in step."""
    record: Record | None = None
    signals: dict[str, FloatArray] = {}
    first: FloatArray = np.zeros((0, 0))
    notes: dict[Note, None] = {}
    repairs: Counter[str] = Counter()
    left_out: list[int] = []
    done = 0
    for part, size in zip(parts, sizes, strict=True):
        driver = part.u if part.r is None else part.r
        if record is None:
            record, first = part, _mean_period(driver, part.period_samples) if part.is_periodic else first
            roles = {role: getattr(part, role) for role in ("u", "y", "r")}
            shapes = {role: (sum(sizes), x.shape[1]) for role, x in roles.items() if x is not None}
            signals = {role: arrays.empty_in_file(shape) for role, shape in shapes.items()}
        # Pieces without a period do not join where an angle lost its turns in one of them.
        is_unwrapped = any(note.code == UNWRAPPED for note in part.notes)
        if part.n_samples != size or not (_is_in_step(part, driver, first) if part.is_periodic else not is_unwrapped):
            return None
        for role, signal in signals.items():
            signal[done : done + size] = getattr(part, role)
            arrays.release(signal)
        notes |= dict.fromkeys(part.notes)
        repairs.update(part.repairs)
        left_out += [done // part.repeat_samples + p for p in part.left_out]
        done += size
    if record is None:
        return None
    in_files = {role: arrays.read_only(signal) for role, signal in signals.items()}
    period = record.period_samples if record.is_periodic else done
    record = replace(record, **in_files, period_samples=period)  # type: ignore[arg-type]
    return replace(record, notes=tuple(notes), repairs=dict(repairs), left_out=tuple(left_out))


def end_notes(lost: int, n: int, repeat: int, place: str) -> tuple[Note, ...]:
    """A note on the samples of a log of n that are lost after its last whole repetition, if there are any."""
    text = f"the last {lost} of {n} samples are no whole period of {repeat} samples and are left out"
    return (Note("incomplete-period", text, place),) if lost > 0 else ()


def _is_in_step(part: Record, driver: FloatArray, first: FloatArray) -> bool:
    if {RESAMPLED, DROPPED, DOUBLED} & set(part.repairs):
        return False
    delays = [delay(a, b, len(first)) for a, b in zip(first.T, _mean_period(driver, len(first)).T, strict=True)]
    # Pieces in step have excitations that lag that of the first by no more than 5 % of a sample.
    return all(abs(lag) <= 0.05 for lag, correlation in delays if correlation >= CLOCK.min_correlation)


def _mean_period(signals: FloatArray, N: int) -> FloatArray:
    return np.asarray(signals[: len(signals) // N * N].reshape(-1, N, signals.shape[1]).mean(axis=0))
