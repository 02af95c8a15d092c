"""Logs of one experiment that hold further periods, or repeats, of one excitation: a record of all their periods.

Each further log is brought into step by the excitation that it shares with the first one; the record keeps where a log
starts, since each has a transient and a drift of its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.record import Record
from elastid.recorded.repair.clock import CLOCK, at_times, delay


@dataclass(frozen=True)
class SameExcitationLimits:
    """Limits of the judgement that two logs hold one excitation.

    Of 300 pairs of clean logs with noise of up to 0.6 of the excitation none is refused
    (tests/recorded/test_several_files.py).
    """

    # Share of an input's power that the first log does not explain, and how many times its noise that must be.
    max_unexplained_share: float = 0.1
    min_times_noise: float = 4.0
    # Amplitude of a log over that of the first, less 1; friction that warms up changes torques by a few per cent.
    max_amplitude_change: float = 0.1
    max_lag: float = 0.05  # samples: logs that are closer to step are left as they are


LIMITS = SameExcitationLimits()
_ADVICE = "give each an experiment (same phases) or a realisation (other phases) of its own"


def joined_periods(records: Sequence[Record], paths: Sequence[str]) -> Record:
    """The record of all periods of some records, each of one log, in step with the first.

    Raises DataError that names two logs where they do not hold the same excitation at the same rate.
    """
    first = _moved(records[0], 0.0)
    both = [f"{paths[0]} and {path} are both {first.name}" for path in paths[1:]]
    every = [first, *(_in_step(first, *each) for each in zip(records[1:], both, strict=True))]
    starts = np.cumsum([0, *(each.n_repeats for each in every)]).tolist()
    r = [each.r for each in every if each.r is not None]
    repairs = sum((Counter(each.repairs) for each in every), Counter())
    counts = ", ".join(f"{each.n_periods} of {path}" for each, path in zip(every, paths, strict=True))
    text = f"the periods of one excitation are those of {len(every)} logs: {counts}"
    note = Note("logs-joined", text, f"record {first.name}", severity="information")
    return replace(
        first,
        u=np.concatenate([each.u for each in every]),
        y=np.concatenate([each.y for each in every]),
        r=np.concatenate(r) if len(r) == len(every) else None,
        starts=tuple(starts[1:-1]),
        notes=(*dict.fromkeys(note for each in every for note in each.notes), note),
        repairs=dict(repairs),
        left_out=tuple(start + p for start, each in zip(starts, every, strict=False) for p in each.left_out),
    )


def _in_step(first: Record, record: Record, both: str) -> Record:
    """A record that begins at the phase of the first, and has its means; DataError for another excitation."""
    N = first.period_samples
    if record.period_samples != N or abs(record.rate_hz / first.rate_hz - 1) > CLOCK.max_error:
        raise DataError(
            f"{both}, with periods of {N} and {record.period_samples} samples at {first.rate_hz:g} and "
            f"{record.rate_hz:g} Hz; {_ADVICE}"
        )
    is_known = first.r is not None and record.r is not None
    (a, of_a), (b, of_b) = (_mean_period(x.r if is_known and x.r is not None else x.u, N) for x in (first, record))
    delays = [delay(own, other, N) for own, other in zip(a.T, b.T, strict=True)]
    best = max(range(len(delays)), key=lambda i: delays[i][1])
    lag = delays[best][0]
    turns = np.exp(2j * np.pi * np.fft.rfftfreq(N) * lag)
    b = np.fft.irfft(np.fft.rfft(b, axis=0) * turns[:, None], N, axis=0)
    for i, place in enumerate(first.inputs):
        noise = of_a[i] + of_b[i]
        # Of an input whose noise no log shows nothing is known, unless it is the one that excites.
        if refused := _other_excitation(a[:, i], b[:, i], noise) if i == best or np.isfinite(noise) else "":
            raise DataError(f"{both}, but at {place} {refused}; {_ADVICE}")
    aligned = _moved(record, lag)
    u, y = (x.mean(axis=0) - own.mean(axis=0) for x, own in ((first.u, aligned.u), (first.y, aligned.y)))
    return replace(aligned, u=aligned.u + u, y=aligned.y + y)


def _other_excitation(a: FloatArray, b: FloatArray, noise: float) -> str:
    """Why b (N,) is no repetition of a (N,), of which noise is the variance of the difference, NaN if unknown."""
    power, gain = float(b @ b), float(a @ b) / max(float(a @ a), 1e-300)
    left = float(np.sum((b - gain * a) ** 2))
    least = LIMITS.min_times_noise * len(a) * noise if np.isfinite(noise) else 0.5 * power
    if left > max(LIMITS.max_unexplained_share * power, least):
        return f"{left / power:.0%} of the power of the second log is another excitation than that of the first"
    if abs(gain - 1) > LIMITS.max_amplitude_change and (gain - 1) ** 2 * float(a @ a) > least:
        return f"the excitation of the second log is {gain:.3g} times that of the first"
    return ""


def _mean_period(signals: FloatArray, N: int) -> tuple[FloatArray, FloatArray]:
    """Mean period (N, c) of signals, without the mean of it, and its variance (c,), NaN where there is one period."""
    X = signals[: len(signals) // N * N].reshape(-1, N, signals.shape[1])
    X = X[1:] if len(X) > 2 else X  # the first holds the transient
    P, mean = len(X), X.mean(axis=0)
    variance = np.mean((X - mean) ** 2, axis=(0, 1)) / (P - 1) if P > 1 else np.full(X.shape[2], np.nan)
    return mean - mean.mean(axis=0), np.asarray(variance)


def _moved(record: Record, lag: float) -> Record:
    """Whole periods from a lag of samples on, no half ones; a lone period is continued by itself."""
    N, L = record.period_samples, record.repeat_samples
    is_whole = abs(lag - round(lag)) <= LIMITS.max_lag
    start = float(round(lag) % N) if is_whole else lag % N
    periods = max(1, int((record.n_samples - start) // N))
    left_out = {int(p - start // L) - i for p in record.left_out for i in (range(2) if start % L else range(1))}
    left_out = {p for p in left_out if 0 <= p < periods * N // L}
    times = np.arange(periods * N, dtype=np.float64) + start
    is_inside = is_whole and times[-1] < record.n_samples

    def moved(x: FloatArray) -> FloatArray:
        return x[int(start) :][: len(times)] if is_inside else at_times(x, times, float(N))

    r = None if record.r is None else moved(record.r)
    return replace(record, u=moved(record.u), y=moved(record.y), r=r, left_out=tuple(sorted(left_out)))
