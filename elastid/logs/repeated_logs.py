"""Several logs of one experiment as one record, each aligned with the first.

They hold further periods, or repeats, of one excitation. The record keeps where a log starts, since each has a
transient and a drift of its own.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, fold_periods
from elastid.base.errors import DataError, Note, notes_of
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR, estimate_delay
from elastid.logs.repair.resampling import resample_at
from elastid.record import Record

# Limits of the judgement that two logs hold one excitation. Of 300 pairs of clean logs with noise of up to 0.6 of the
# excitation none is refused (tests/logs/test_several_files.py).
# Fraction of an input's power that the first log does not explain, and amplitude over that of the first, less 1, since
# friction that warms up changes torques by a few per cent; how many times its noise the former must be.
MAX_CHANGE = 0.1
MIN_TIMES_NOISE = 4.0
MAX_LAG = 0.05  # samples: logs that are closer to step are left as they are
_ADVICE = "Give each log its own experiment (same phases) or realisation (other phases)"


def join_periods(records: Sequence[Record], paths: Sequence[str]) -> Record:
    """Join all periods of some records, each of one log, in step with the first.

    Raises DataError that names two logs where they do not hold the same excitation at the same rate.
    """
    first = _shift_periods(records[0], 0.0)
    claims = [f"{paths[0]} and {path} are both {first.name}" for path in paths[1:]]
    in_phase = [first, *(_align_record(first, *pair) for pair in zip(records[1:], claims, strict=True))]
    starts = np.cumsum([0, *(log.n_repeats for log in in_phase)]).tolist()
    r = [log.r for log in in_phase if log.r is not None]
    repairs = sum((Counter(log.repairs) for log in in_phase), Counter())
    counts = ", ".join(f"{log.n_periods} of {path}" for log, path in zip(in_phase, paths, strict=True))
    text = f"the periods of one excitation are from {len(in_phase)} logs: {counts}"
    note = Note("records/corrected", text, f"record {first.name}", severity="information")
    return replace(
        first, u=np.concatenate([log.u for log in in_phase]), y=np.concatenate([log.y for log in in_phase]),
        r=np.concatenate(r) if len(r) == len(in_phase) else None, starts=tuple(starts[1:-1]),
        notes=(*dict.fromkeys(notes_of(in_phase)), note), repairs=dict(repairs),
        discarded_periods=tuple(n + p for n, log in zip(starts, in_phase, strict=False) for p in log.discarded_periods),
    )  # fmt: skip


def _align_record(first: Record, record: Record, claim: str) -> Record:
    """Align a record with the phase and the means of the first; DataError for another excitation."""
    N = first.period_samples
    if record.period_samples != N or abs(record.rate_hz / first.rate_hz - 1) > MAX_CLOCK_ERROR:
        text = f"{claim}, with periods of {N} and {record.period_samples} samples at {first.rate_hz:g} and"
        raise DataError("records/inconsistent", f"{text} {record.rate_hz:g} Hz. {_ADVICE}")
    drivers = (first.u, record.u) if first.r is None or record.r is None else (first.r, record.r)
    (a, var_a), (b, var_b) = (_mean_with_variance(x, N) for x in drivers)
    delays = [estimate_delay(x, y, N) for x, y in zip(a.T, b.T, strict=True)]
    best = max(range(len(delays)), key=lambda i: delays[i][1])
    lag = delays[best][0]
    b = np.fft.irfft(np.fft.rfft(b, axis=0) * np.exp(2j * np.pi * np.fft.rfftfreq(N) * lag)[:, None], N, axis=0)
    for i, location in enumerate(first.inputs):
        noise = var_a[i] + var_b[i]
        # Of an input whose noise no log shows nothing is known, unless it is the one that excites.
        if refusal := _repetition_error(a[:, i], b[:, i], noise) if i == best or np.isfinite(noise) else "":
            raise DataError("records/inconsistent", f"{claim}, but at {location} {refusal}. {_ADVICE}")
    in_phase = _shift_periods(record, lag)
    u, y = (x.mean(axis=0) - back.mean(axis=0) for x, back in ((first.u, in_phase.u), (first.y, in_phase.y)))
    return replace(in_phase, u=in_phase.u + u, y=in_phase.y + y)


def _repetition_error(a: FloatArray, b: FloatArray, noise: float) -> str:
    """Return why b (N,) is no repetition of a (N,). noise: variance of their difference, NaN if unknown."""
    power, gain = float(b @ b), float(a @ b) / max(float(a @ a), 1e-300)
    error_power = float(np.sum((b - gain * a) ** 2))
    noise_power = MIN_TIMES_NOISE * len(a) * noise if np.isfinite(noise) else 0.5 * power
    if error_power > max(MAX_CHANGE * power, noise_power):
        return f"the excitations of the two logs differ in {error_power / power:.0%} of the power"
    if abs(gain - 1) > MAX_CHANGE and (gain - 1) ** 2 * float(a @ a) > noise_power:
        return f"the excitation of the second log is {gain:.3g} times that of the first"
    return ""


def _mean_with_variance(signals: FloatArray, N: int) -> tuple[FloatArray, FloatArray]:
    """Compute the mean period (N, c) of signals without its mean, and its variance (c,), NaN for one period."""
    X = fold_periods(signals, N)
    X = X[1:] if len(X) > 2 else X  # the first holds the transient
    P, mean = len(X), X.mean(axis=0)
    variance = np.mean((X - mean) ** 2, axis=(0, 1)) / (P - 1) if P > 1 else np.full(X.shape[2], np.nan)
    return mean - mean.mean(axis=0), np.asarray(variance)


def _shift_periods(record: Record, lag: float) -> Record:
    """Cut whole periods from a lag of samples on, no half ones; a lone period is continued by itself."""
    N, L = record.period_samples, record.repeat_samples
    is_whole = abs(lag - round(lag)) <= MAX_LAG
    start = float(round(lag) % N) if is_whole else lag % N
    periods = max(1, int((record.n_samples - start) // N))
    overlap = range(2) if start % L else range(1)
    pairs = {int(p - start // L) - i for p in record.discarded_periods for i in overlap}
    pairs = {p for p in pairs if 0 <= p < periods * N // L}
    times = np.arange(periods * N, dtype=np.float64) + start
    is_inside = is_whole and times[-1] < record.n_samples

    def shifted(x: FloatArray) -> FloatArray:
        return x[int(start) :][: len(times)] if is_inside else resample_at(x, times, float(N))

    r = None if record.r is None else shifted(record.r)
    return replace(record, u=shifted(record.u), y=shifted(record.y), r=r, discarded_periods=tuple(sorted(pairs)))
