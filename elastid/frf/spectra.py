"""From a record to the complex amplitudes of its inputs and outputs, period by period.

    X_p(k) = 2 / N sum_n x(n + p N) exp(-2 pi j k n / N),   velocity = j omega position, ...

With this sign a delay turns the phase of Y / U down, and y = Re Y exp(j omega t) like every phasor of the model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.record import MOTION_ORDER, Motion, Record

# Around the ends of a period its drift is averaged over this part of it: long enough that encoder noise does not
# enter, short enough that the drift is straight.
_END_WINDOW = 1 / 50
# Beyond these, squares and their products overflow or vanish.
_SMALLEST, _LARGEST = 1e-60, 1e60


@dataclass(frozen=True)
class PeriodSpectra:
    """Z = [Y, U] = scale [y, u] of the periods of one record that are used, by their index (P,) in it.

    y (P, F, n_y), u (P, F, n_u): DFT of the samples as they were logged.  scale (F, n_y + n_u): to amplitudes, torques
    in Nm as they act between the samples and outputs all in one quantity; means and scatters take it once, instead of
    every period.
    """

    record: Record
    periods: IntArray
    y: ComplexArray
    u: ComplexArray
    scale: ComplexArray
    notes: tuple[str, ...] = ()

    @property
    def Y(self) -> ComplexArray:
        """Outputs (P, F, n_y)."""
        return self.y * self.scale[:, : self.y.shape[2]]

    @property
    def U(self) -> ComplexArray:
        """Inputs (P, F, n_u)."""
        return self.u * self.scale[:, self.y.shape[2] :]

    def on(self, lines: BoolArray | slice) -> PeriodSpectra:
        """The same on some of its lines (F,)."""
        if not isinstance(lines, slice) and lines.all():
            return self
        return replace(self, y=self.y[:, lines], u=self.u[:, lines], scale=self.scale[lines])

    def only(self, keep: IntArray) -> PeriodSpectra:
        """The same of some of its periods."""
        if len(keep) == len(self.periods):
            return self
        return replace(self, periods=self.periods[keep], y=self.y[keep], u=self.u[keep])


def period_spectra(record: Record, lines: IntArray, quantity: Motion) -> PeriodSpectra:
    """All periods of a record at DFT lines (F,), outputs as `quantity`: exact, by powers of j omega.

    A position or velocity that drifts is freed of what does not repeat.  Of a half-wave record each half period
    counts as a period, and lines must be odd.  Raises DataError where a sample is missing: it would make every line
    of G missing.
    """
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    j_omega = 2j * np.pi * freq_hz[:, None]
    order = np.array([MOTION_ORDER[quantity] - MOTION_ORDER[each] for each in record.quantities])
    drifts = np.array([each != "acceleration" for each in record.quantities])
    P, n_y = record.n_samples // record.repeat_samples, len(record.outputs)
    scale = np.empty((len(lines), n_y + len(record.inputs)), dtype=np.complex128)
    scale[:, :n_y], scale[:, n_y:] = j_omega**order, record.hold_response(freq_hz)[:, None]
    scale *= 2 / record.repeat_samples
    y, u = _dft(record, record.y, lines), _dft(record, record.u, lines)
    # The samples themselves are looked at only where a line says that there is something to see.
    if not all(_computable(np.abs(x[:, 0])).all() for x in (y, u)):
        refuse_uncomputable(record)
    if drifts.any():
        y[:, :, np.flatnonzero(drifts)] -= _drift_spectra(record, lines, drifts)
    return PeriodSpectra(record, np.arange(P), y, u, scale)


def reference_spectrum(record: Record, lines: IntArray) -> ComplexArray | None:
    """R (F, n_u) of the injected torque, which is known and without noise; None where it was not recorded."""
    if record.r is None:
        return None
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    R: ComplexArray = line_spectra(record, record.r, lines).mean(axis=0) * record.hold_response(freq_hz)[:, None]
    return R


def line_spectra(record: Record, signals: FloatArray, lines: IntArray) -> ComplexArray:
    """Complex amplitudes (P, F, c) at lines (F,) of signals (n_samples, c), one for each repetition."""
    amplitudes: ComplexArray = _dft(record, signals, lines) * (2 / record.repeat_samples)
    return amplitudes


def _dft(record: Record, signals: FloatArray, lines: IntArray) -> ComplexArray:
    """DFT (P, F, c) at lines (F,) of signals (n_samples, c) in every repetition, maybe a view of all lines."""
    L = record.repeat_samples
    P = record.n_samples // L
    blocks = signals[: P * L].reshape(P, L, -1)
    if not record.half_wave:
        everywhere: ComplexArray = rfft(blocks, axis=1)
        return everywhere[:, _contiguous(lines)]
    # The mean of all whole periods is no part of what changes sign; half a period would see it at every odd line.
    blocks = blocks - signals[: P // 2 * 2 * L].mean(axis=0)
    sign = (-1.0) ** np.arange(P)
    halves: ComplexArray = rfft(blocks, n=2 * L, axis=1)[:, lines] * sign[:, None, None]
    return halves


def _contiguous(lines: IntArray) -> slice | IntArray:
    """Lines as a slice where none between them is left out: a view instead of a copy."""
    return slice(int(lines[0]), int(lines[-1]) + 1) if np.all(np.diff(lines) == 1) else lines


def _drift_spectra(record: Record, lines: IntArray, drifts: BoolArray) -> ComplexArray:
    r"""Spectra (P, F, c) of the drift of those columns of y that drift.

    As `_dft` has them. The DFT of the derivative over a period is j omega X + [x(T) - x(0)]: what x gains from end to
    end is drift, and a ramp g n / N of that height is all that has to go. (Half wave: [-x(T/2) - x(0)], a constant
    g / 2.) With theta = 2 pi k / N their sums are

    .. math:: \sum_{n<N} \frac{n}{N} e^{-j\theta n} = \frac{1}{e^{-j\theta} - 1}, \quad
              \sum_{n<N/2} \frac12 e^{-j\theta n} = \frac{1}{1 - e^{-j\theta}} \quad (k\ odd)
    """
    L = record.repeat_samples
    P = record.n_samples // L
    x = record.y[: P * L]
    window = max(1, round(_END_WINDOW / 2 * L))
    sign = -1.0 if record.half_wave else 1.0
    gain = np.empty((P, int(drifts.sum())))
    for p in range(P):
        first, last = max(0, p * L - window), min(p * L + window + 1, (P - 1) * L)
        gain[p] = (x[first + L : last + L].mean(axis=0) - sign * x[first:last].mean(axis=0))[drifts]
    if record.half_wave:  # the mean over whole periods is gone already
        gain -= gain[: P // 2 * 2].mean(axis=0)
    ramp = sign / (np.exp(-2j * np.pi * lines / record.period_samples) - 1)
    parity = sign ** np.arange(P)
    spectra: ComplexArray = (parity[:, None] * gain)[:, None, :] * ramp[:, None]
    return spectra


def refuse_uncomputable(record: Record) -> None:
    """DataError that names the first sample that is missing, and channels whose squares no computer holds."""
    for role, names, signals in (("u", record.inputs, record.u), ("y", record.outputs, record.y)):
        if not np.isfinite(signals).all():
            sample, column = np.argwhere(~np.isfinite(signals))[0]
            raise DataError(
                f"record {record.name}: {role} at {names[column]} is NaN or infinite from sample {sample} on; "
                "leave that part out, or mend the record"
            )
        largest = np.max(np.abs(signals), axis=0)
        for column in np.flatnonzero(~_computable(largest)):
            raise DataError(
                f"record {record.name}: {role} at {names[column]} reaches {largest[column]:.3g} in SI units, which "
                "nothing measures; check unit and scale of its channel, and what the log writes where it has no value"
            )


def _computable(size: FloatArray) -> BoolArray:
    computable: BoolArray = (size == 0) | ((size > _SMALLEST) & (size < _LARGEST))
    return computable
