"""Complex amplitudes of a record's signals, one set for each repetition.

    X_p(k) = 2 / N sum_n x(n + p N) exp(-2 pi j k n / N),   velocity = j omega position, ...

With this sign a delay decreases the phase of Y / U, and y = Re Y exp(j omega t) as for the phasors of the model.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, laplace_variable, quotient
from elastid.base.errors import DataError, Note
from elastid.base.fourier import real_dft
from elastid.base.large_arrays import MIN_LARGE_VALUES, PIECE_VALUES, mean_of_rows, release
from elastid.excitation.grids import line_frequencies
from elastid.record import MOTION_ORDER, Motion, Record

Role: TypeAlias = Literal["r", "u", "y"]

_MIN_COMPUTABLE, _MAX_COMPUTABLE = 1e-60, 1e60  # beyond, products of squares overflow or vanish
# Number of segments of a record, and largest fraction of them with the power of a line for sweeps and hits; noise:
# half.
_N_SEGMENTS, _MAX_SEGMENT_FRACTION = 16, 0.3


def single_logs(record: Record) -> tuple[Record, ...]:
    """Divide a record into its logs."""
    if not record.starts:
        return (record,)
    L = record.repeat_samples
    return tuple(
        record.part(
            slice(a * L, b * L), name=f"{record.name}, log {i}", starts=(), notes=record.notes if i == 1 else (),
            discarded_periods=tuple(p - a for p in record.discarded_periods if a <= p < b),
        )
        for i, (a, b) in enumerate(pairwise((0, *record.starts, record.n_repeats)), start=1)
    )  # fmt: skip


def undivided_logs(records: Sequence[Record]) -> list[Record]:
    """Return the record of each log, for methods without periods; DataError for discarded periods."""
    logs = [log for record in records for log in single_logs(record)]
    for log in logs:
        if log.discarded_periods:
            periods = ", ".join(str(period + 1) for period in log.discarded_periods)
            raise DataError(
                "records/missing-samples",
                f"too many samples of period {periods} are missing for a local method, which needs one piece. Cut the "
                "record by samples: [first, last], or set another estimator.method",
                f"record {log.name}",
            )
        check_values(log)
    return logs


@dataclass(frozen=True, eq=False)
class RecordSpectra:
    """DFTs of the P repetitions of a record's signals, computed on request.

    In a half-wave record, each half period is a repetition, and only the odd lines are meaningful.
    """

    record: Record

    @property
    def is_large(self) -> bool:
        """True if the record is processed in groups of periods to save memory."""
        return self.record.u.size + self.record.y.size >= MIN_LARGE_VALUES

    def dft_at(self, roles: Sequence[Role], lines: IntArray) -> Iterator[ComplexArray]:
        """Yield the DFT (p, F, c) of signals at lines (F,), in logged units: all periods, or groups of a large record.

        The memory order is channel by channel.
        """
        L, P = self.record.repeat_samples, self.record.n_repeats
        signals: list[FloatArray] = [getattr(self.record, role) for role in roles]
        ends = np.cumsum([0, *(signal.shape[1] for signal in signals)])
        at_once = max(1, PIECE_VALUES // (L * int(ends[-1]))) if self.is_large else P
        for first in range(0, P, at_once):
            periods = np.arange(first, min(P, first + at_once))
            # Padding avoids distances of a power of two between channels, which compete for the same cache lines.
            dft = np.empty((len(periods), ends[-1], len(lines) + 27), np.complex128)[:, :, : len(lines)]
            for signal, start, end in zip(signals, ends, ends[1:], strict=False):
                blocks = signal[first * L : (first + len(periods)) * L].reshape(len(periods), L, -1)
                if self.record.half_wave:
                    # The mean does not change sign and would leak into each half period.
                    blocks = blocks - mean_of_rows(signal, P // 2 * 2 * L)
                    halves = rfft(blocks, n=2 * L, axis=1)[:, lines].swapaxes(1, 2)
                    dft[:, start:end] = halves * (-1.0) ** periods[:, None, None]
                else:
                    real_dft(blocks, lines, dft[:, start:end])
                if self.is_large:
                    release(signal)
            yield dft.swapaxes(1, 2)

    def amplitudes(self, role: Role, lines: IntArray) -> ComplexArray:
        """Return complex amplitudes (P, F, c) of a signal at lines (F,)."""
        dft: ComplexArray = np.concatenate(list(self.dft_at((role,), lines)))
        return dft * (2 / self.record.repeat_samples)


@dataclass(frozen=True, eq=False)
class PeriodSpectra:
    """Z = [Y, U] = scale z of the used periods of one record; periods (P,): their indices.

    z (P, F, n_y + n_u): DFT of the logged samples of y and u.  scale (F, n_y + n_u): to amplitudes, torques as they act
    between the samples and outputs in one quantity; applied once to means and scatters instead of to every period.
    """

    record: Record
    periods: IntArray
    z: ComplexArray
    scale: ComplexArray
    notes: tuple[Note, ...] = ()

    @property
    def Y(self) -> ComplexArray:
        """Outputs (P, F, n_y)."""
        n_y = len(self.record.outputs)
        return self.z[:, :, :n_y] * self.scale[:, :n_y]

    @property
    def U(self) -> ComplexArray:
        """Inputs (P, F, n_u)."""
        n_y = len(self.record.outputs)
        return self.z[:, :, n_y:] * self.scale[:, n_y:]

    def on(self, lines: BoolArray | slice) -> "PeriodSpectra":
        """Return spectra on some of the lines (F,)."""
        index = lines if isinstance(lines, slice) else _line_index(np.flatnonzero(lines))
        return replace(self, z=self.z[:, index], scale=self.scale[index])

    def only(self, rows: IntArray) -> "PeriodSpectra":
        """Return spectra of some of the periods; rows (k,): their indices."""
        if len(rows) == len(self.periods):
            return self
        return replace(self, periods=self.periods[rows], z=self.z[rows])


def period_spectra(
    spectra: RecordSpectra, lines: IntArray, quantity: Motion, scale: ComplexArray | None = None
) -> PeriodSpectra:
    """Return all periods of a record at DFT lines (F,), outputs as `quantity`: exact, by powers of j omega.

    The drift of a position or velocity over a period is removed.  Each half period of a half-wave record counts as a
    period; lines must then be odd.  scale: of all records.  Raises DataError for a missing sample.
    """
    groups = list(period_groups(spectra, lines, quantity, scale))
    if len(groups) == 1:
        return groups[0]
    periods, z = (np.concatenate([getattr(group, name) for group in groups]) for name in ("periods", "z"))
    return replace(groups[0], periods=periods, z=z)


def period_groups(
    spectra: RecordSpectra, lines: IntArray, quantity: Motion, scale: ComplexArray | None = None
) -> Iterator[PeriodSpectra]:
    """Yield spectra of all periods at lines (F,), scale (F, n_z); a large record comes in pieces to save memory.

    DataError for samples without a computable spectrum.
    """
    record = spectra.record
    scale = amplitude_scale(record, lines, quantity) if scale is None else scale
    drifts = np.array([own_quantity != "acceleration" for own_quantity in record.quantities])
    drift = _drift(record, lines, drifts) if drifts.any() else None
    first = 0
    for z in spectra.dft_at(("y", "u"), lines):
        # Search the samples only if a line is not computable.
        if not _computable(np.abs(z[:, 0])).all():
            check_values(record)
        periods = np.arange(first, first + len(z))
        if drift is not None:
            gain, ramp = drift
            z[:, :, np.flatnonzero(drifts)] -= gain[periods][:, None, :] * ramp[:, None]
        yield PeriodSpectra(record, periods, z, scale)
        first += len(z)


def amplitude_scale(record: Record, lines: IntArray, quantity: Motion) -> ComplexArray:
    r"""Return scale (F, n_y + n_u) from the DFT of [y, u] to amplitudes: (2 / L) [(j omega)^k, H]."""
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    return 2 / record.repeat_samples * unit_scale(record, freq_hz, quantity)


def unit_scale(record: Record, freq_hz: FloatArray, quantity: Motion) -> ComplexArray:
    r"""Return [(j omega)^k, H] (F, n_y + n_u): outputs to `quantity`, torques as they act between their samples."""
    order = np.array([MOTION_ORDER[quantity] - MOTION_ORDER[logged] for logged in record.quantities])
    return np.concatenate([laplace_variable(freq_hz[:, None]) ** order, record.hold_response(freq_hz)], axis=1)


def reference_spectrum(spectra: RecordSpectra, lines: IntArray) -> ComplexArray | None:
    """Return R (F, n_u) of the injected torque, known without noise; None if it was not recorded."""
    record = spectra.record
    if record.r is None:
        return None
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    scale = 2 / record.repeat_samples
    mean = sum((group * scale).sum(axis=0) for group in spectra.dft_at(("r",), lines)) / record.n_repeats
    return np.asarray(mean * record.hold_response(freq_hz))


def _drift(record: Record, lines: IntArray, drifts: BoolArray) -> tuple[FloatArray, ComplexArray]:
    r"""Return the drifts g (P, c) of the columns of y that can drift, and the DFT (F,) of a unit drift.

    The DFT of the derivative over a period is j omega X + [x(T) - x(0)]: g = x(T) - x(0) is drift, and a ramp g n / N
    removes it. (Half wave: g = -x(T/2) - x(0), a constant g / 2.) With theta = 2 pi k / N their DFTs are

    .. math:: \sum_{n<N} \frac{n}{N} e^{-j\theta n} = \frac{1}{e^{-j\theta} - 1}, \quad
              \sum_{n<N/2} \frac12 e^{-j\theta n} = \frac{1}{1 - e^{-j\theta}} \quad (k\ odd)
    """
    L, P = record.repeat_samples, record.n_repeats
    # Averages over a fiftieth of a period suppress encoder noise.
    window = max(1, round(1 / 50 / 2 * L))
    sign = -1.0 if record.half_wave else 1.0
    gain = np.zeros((P, int(drifts.sum())))
    logs = pairwise((0, *record.starts, P))
    # A log of one repetition has unknown drift.
    for p, start, end in ((p, a, b) for a, b in logs for p in range(a, b) if b - a > 1):
        first, last = max(start * L, p * L - window), min(p * L + window + 1, (end - 1) * L)
        start_mean, end_mean = (record.y[first + shift : last + shift].mean(axis=0) for shift in (0, L))
        gain[p] = (end_mean - sign * start_mean)[drifts]
        release(record.y)
    if record.half_wave:  # the mean over periods was already subtracted
        gain -= 2 * mean_of_rows(record.y, P // 2 * 2 * L)[drifts]
    return (sign ** np.arange(P))[:, None] * gain, sign / (np.exp(-2j * np.pi * lines / record.period_samples) - 1)


def check_values(record: Record) -> None:
    """Raise DataError for the first missing sample, or for a channel with implausibly large or small values."""
    for role, names, signals in (("u", record.inputs, record.u), ("y", record.outputs, record.y)):
        largest, step = np.zeros(len(names)), max(1, PIECE_VALUES // len(names))
        for start in range(0, len(signals), step):
            size = np.abs(signals[start : start + step])
            if not np.isfinite(size).all():
                sample, column = np.argwhere(~np.isfinite(size))[0]
                raise DataError(
                    "records/values",
                    f"{role} at {names[column]} is NaN or infinite from sample {start + sample} on. Exclude that "
                    "part, or correct the record",
                    f"record {record.name}",
                )
            largest = np.maximum(largest, size.max(axis=0))
            release(signals)
        for column in np.flatnonzero(~_computable(largest)):
            raise DataError(
                "records/missing-samples",
                f"{role} at {names[column]} reaches {largest[column]:.3g} in SI units, which is implausible. Check "
                "unit and scale of its channel, and the log's placeholder for missing values",
                f"record {record.name}",
            )


def _line_index(lines: IntArray) -> slice | IntArray:
    """Return increasing lines (F,) as an index: a slice, which avoids a copy, if they are evenly spaced."""
    steps = np.diff(lines)
    step = int(steps[0]) if len(steps) else 1
    return slice(lines[0], lines[-1] + 1, step) if len(lines) and np.all(steps == step) else lines


def _computable(size: FloatArray) -> BoolArray:
    """Flag values whose squares neither overflow nor vanish; 0 is allowed."""
    return np.asarray((size == 0) | ((size > _MIN_COMPUTABLE) & (size < _MAX_COMPUTABLE)))


def is_transient_excitation(records: Sequence[Record]) -> bool:
    r"""Return True for sweeps and hits: each line has its power in few of K segments; False for large records.

    .. math:: \frac{1}{K} \frac{(\sum_k P_k)^2}{\sum_k P_k^2}, \quad \text{averaged over lines by their power}
    """
    spreads = []
    for record in records:
        if RecordSpectra(record).is_large:
            return False
        L = record.n_samples // _N_SEGMENTS
        segments = record.u[: L * _N_SEGMENTS].reshape(_N_SEGMENTS, L, -1)
        P = np.abs(np.fft.rfft(segments - segments.mean(axis=1, keepdims=True), axis=1)) ** 2
        total, squares = P.sum(axis=0), (P**2).sum(axis=0)
        fractions = quotient(total**2, squares) / _N_SEGMENTS
        spreads.append((fractions * total).sum(axis=0) / np.maximum(total.sum(axis=0), 1e-300))
    return bool(np.min(spreads) < _MAX_SEGMENT_FRACTION)
