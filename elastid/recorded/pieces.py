"""A log that is too large for memory: measured in pieces of whole periods (without one, of any length), in step.

The first piece, and any that does not pass the screen, is read, repaired and checked as a log of its own.  Of the
others nothing is kept: the record reads them again from the log.  Where the pieces are not in step (lost samples, a
clock that differs, a piece that is refused) the log must be measured as a whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base import arrays
from elastid.base.arrays import FloatArray, LargeArray
from elastid.base.note import Note
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.record import Record
from elastid.recorded.files.formats import opened_log
from elastid.recorded.files.log import ArrayLog, Log
from elastid.recorded.link_side import UNWRAPPED, converted, largest_jump, to_joints
from elastid.recorded.repair.clock import CLOCK, RESAMPLED, delay
from elastid.recorded.repair.missing import DOUBLED, DROPPED
from elastid.recorded.screen import screen


@dataclass(frozen=True)
class LargeLog:
    """Channels of a log in a format that can be read in pieces; start: sample of the file that counts as the first."""

    path: Path
    text: TextFormatSpec
    channels: tuple[ChannelSpec, ...]
    robot: Places
    start: int

    def opened(self) -> AbstractContextManager[Log]:
        """The file, for `columns`."""
        return opened_log(self.path, self.text)

    def columns(self, log: Log, first: int, last: int) -> list[FloatArray]:
        """The samples (last - first,) of each channel as they stand in the file."""
        assert isinstance(log, ArrayLog)  # the only one with rows
        columns = log.columns(self.channels, slice(self.start + first, self.start + last))
        return [np.ascontiguousarray(x) for x in columns]

    def rows(self, wanted: Sequence[int], dtype: np.dtype[Any], first: int, last: int) -> NDArray[Any]:
        """Samples (last - first, len(wanted)) of some channels in SI, angles and torques of joints where gears mix."""
        T = to_joints(self.channels, self.robot)[list(wanted)]
        used = np.flatnonzero(np.any(T != 0, axis=0)).tolist()
        channels = [self.channels[i] for i in used]
        with self.opened() as log:
            assert isinstance(log, ArrayLog)
            columns = log.columns(channels, slice(self.start + first, self.start + last))
        signals = [converted(channel, x, self.robot) for channel, x in zip(channels, columns, strict=True)]
        result = np.empty((last - first, len(wanted)), dtype)
        for row, column in zip(T[:, used], result.T, strict=True):
            terms = [factor * x if factor != 1 else x for factor, x in zip(row, signals, strict=True) if factor != 0]
            column[:] = sum(terms[1:], start=terms[0])
        return result

    def jumps(self) -> list[float]:
        """The largest change of each channel from one sample to the next, as in the file, that is no turn."""
        return [largest_jump(channel, self.robot) for channel in self.channels]

    def dtypes(self, roles: Sequence[Sequence[int]]) -> list[np.dtype[Any]]:
        """Single precision for channels that are no finer in the file, by role; else double."""
        T = to_joints(self.channels, self.robot)
        with self.opened() as log:
            assert isinstance(log, ArrayLog)
            # A sum is rounded by the larger of its parts.
            is_single = [
                np.can_cast(log.stored(channel).dtype, np.float32)
                and channel.offset == 0
                and np.count_nonzero(row) == 1
                for channel, row in zip(self.channels, T, strict=True)
            ]
        return [np.dtype(np.float32 if all(is_single[i] for i in role) else np.float64) for role in roles]


# A log of fewer values is measured as a whole.
MIN_VALUES = 1 << 22
# A median over fewer periods cannot distinguish a spike from a signal.
_MIN_PERIODS = 8


def may_be_large(path: Path) -> bool:
    """True if its signals may be too many for memory: a value takes a byte of the file at least, unless compressed."""
    return path.stat().st_size >= MIN_VALUES


def pieces(n: int, N: int | None, n_channels: int) -> tuple[tuple[int, int], ...]:
    """First and last sample of pieces of whole periods N (None: of any length); none where the log fits into memory."""
    if n * n_channels < MIN_VALUES:
        return ()
    if N is None:
        count = -(-n * n_channels // arrays.PIECE_VALUES)
        return tuple(pairwise(i * n // count for i in range(count + 1)))
    # The first piece, which is repaired in full, is a short one.
    periods, rest = max(_MIN_PERIODS, arrays.PIECE_VALUES // (N * n_channels)), n // N - _MIN_PERIODS
    count = max(1, rest // periods)
    bounds = [0, *((_MIN_PERIODS + i * periods) * N for i in range(count)), n // N * N]
    return tuple(pairwise(bounds)) if rest >= _MIN_PERIODS else ()


@dataclass(frozen=True)
class _Repaired:
    """The pieces (first and last sample) of a log that were repaired; signals: of all pieces by role, in files."""

    bounds: tuple[tuple[int, int], ...]
    signals: Mapping[str, FloatArray]

    def rows(self, log: LargeLog, role: str, wanted: Sequence[int], first: int, last: int) -> NDArray[Any]:
        """Rows of one role: those of the log, but for the pieces that were repaired."""
        signal = self.signals[role]
        rows = log.rows(wanted, signal.dtype, first, last)
        for start, end in self.bounds:
            part = slice(max(start, first), min(end, last))
            if part.start < part.stop:
                rows[part.start - first : part.stop - first] = signal[part]
        arrays.release(signal)
        return rows


def joined(
    measure: Callable[[int, int], Record],
    bounds: Sequence[tuple[int, int]],
    log: LargeLog,
    roles: Mapping[str, Sequence[int]],
) -> Record | None:
    """The record of all pieces, its signals in files; None where they are not in step.

    measure: the record of the samples from a first to before a last one.  roles: the columns of r, u and y.
    """
    first, n = measure(*bounds[0]), bounds[-1][1]
    wanted = {role: columns for role, columns in roles.items() if columns}
    dtypes = log.dtypes(list(wanted.values()))
    signals = {
        role: arrays.empty_in_file((n, len(columns)), dtype)
        for (role, columns), dtype in zip(wanted.items(), dtypes, strict=True)
    }
    notes: dict[Note, None] = {}
    repairs: Counter[str] = Counter()
    left_out: list[int] = []
    repaired: list[tuple[int, int]] = []
    period = _mean_period(_driver(first), first.period_samples) if first.is_periodic else None
    for part, (start, end) in _repaired_pieces(measure, first, bounds, log, roles):
        if part.n_samples != end - start or not _is_in_step(part, period):
            return None
        for role, signal in signals.items():
            signal[start:end] = getattr(part, role)
            arrays.release(signal)
        notes |= dict.fromkeys(part.notes)
        repairs.update(part.repairs)
        left_out += [start // part.repeat_samples + p for p in part.left_out]
        repaired.append((start, end))
    rows = _Repaired(tuple(repaired), signals).rows
    large = {
        role: LargeArray((n, len(columns)), signals[role].dtype, partial(rows, log, role, columns))
        for role, columns in wanted.items()
    }
    period_samples = first.period_samples if first.is_periodic else n
    record = replace(first, **large, period_samples=period_samples)  # type: ignore[arg-type]
    return replace(record, notes=tuple(notes), repairs=dict(repairs), left_out=tuple(left_out))


def _repaired_pieces(
    measure: Callable[[int, int], Record],
    first: Record,
    bounds: Sequence[tuple[int, int]],
    log: LargeLog,
    roles: Mapping[str, Sequence[int]],
) -> Iterator[tuple[Record, tuple[int, int]]]:
    """The first piece and those that do not pass the screen, repaired, with their first and last sample."""
    yield first, bounds[0]
    repetition = (first.repeat_samples, -1 if first.half_wave else 1) if first.is_periodic else None
    with log.opened() as file:
        reference = log.columns(file, *bounds[0])
        test = screen(reference, repetition, roles["r"] or roles["u"], roles["u"], log.jumps())
        for piece in bounds[1:]:
            if not test.passes(log.columns(file, *piece)):
                yield measure(*piece), piece


def end_notes(lost: int, n: int, repeat: int, place: str) -> tuple[Note, ...]:
    """A note on the samples of a log of n that are lost after its last whole repetition, if there are any."""
    text = f"the last {lost} of {n} samples are no whole period of {repeat} samples and are left out"
    return (Note("incomplete-period", text, place),) if lost > 0 else ()


def _driver(record: Record) -> FloatArray:
    return record.u if record.r is None else record.r


def _is_in_step(part: Record, first: FloatArray | None) -> bool:
    """True if a piece joins the first one, whose mean period is `first` (None without a period)."""
    if first is None:
        # An angle whose turns were taken out of one piece does not continue in the next.
        return all(note.code != UNWRAPPED for note in part.notes)
    if {RESAMPLED, DROPPED, DOUBLED} & set(part.repairs):
        return False
    delays = [delay(a, b, len(first)) for a, b in zip(first.T, _mean_period(_driver(part), len(first)).T, strict=True)]
    # Pieces in step have excitations that lag that of the first by no more than 5 % of a sample.
    return all(abs(lag) <= 0.05 for lag, correlation in delays if correlation >= CLOCK.min_correlation)


def _mean_period(signals: FloatArray, N: int) -> FloatArray:
    return np.asarray(signals[: len(signals) // N * N].reshape(-1, N, signals.shape[1]).mean(axis=0))
