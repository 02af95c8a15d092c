"""From a record to the complex amplitudes of its inputs and outputs, period by period.

    X_p(k) = 2 / N sum_n x(n + p N) exp(-2 pi j k n / N),   velocity = j omega position, ...

With this sign a delay turns the phase of Y / U down, and y = Re Y exp(j omega t) like every phasor of the model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import rfft

from elastid.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.record import MOTION_ORDER, Motion, Record

# Around the ends of a period its drift is averaged over this part of it: long enough that encoder noise does not
# enter, short enough that the drift is straight.
_END_WINDOW = 1 / 50


@dataclass(frozen=True)
class PeriodSpectra:
    """Z = [Y, U] (P, F, n_y + n_u) of the periods of one record that are used, by their index (P,) in it.

    Torques in Nm as they act between the samples; outputs all in one quantity.
    """

    record: Record
    periods: IntArray
    Z: ComplexArray
    notes: tuple[str, ...] = ()

    @property
    def Y(self) -> ComplexArray:
        """Outputs (P, F, n_y)."""
        return self.Z[:, :, : len(self.record.outputs)]

    @property
    def U(self) -> ComplexArray:
        """Inputs (P, F, n_u)."""
        return self.Z[:, :, len(self.record.outputs) :]

    def on(self, lines: BoolArray) -> PeriodSpectra:
        """The same on some of its lines (F,)."""
        if lines.all():
            return self
        return replace(self, Z=self.Z[:, lines])


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
    Z = np.empty((P, len(lines), n_y + len(record.inputs)), dtype=np.complex128)
    line_spectra(record, record.y, lines, j_omega**order, out=Z[:, :, :n_y])
    line_spectra(record, record.u, lines, record.hold_response(freq_hz)[:, None], out=Z[:, :, n_y:])
    if not np.isfinite(Z[:, 0]).all():
        refuse_missing(record)
    if drifts.any():
        Z[:, :, np.flatnonzero(drifts)] -= _drift_spectra(record, lines, drifts) * j_omega ** order[drifts]
    return PeriodSpectra(record, np.arange(P), Z)


def reference_spectrum(record: Record, lines: IntArray) -> ComplexArray | None:
    """R (F, n_u) of the injected torque, which is known and without noise; None where it was not recorded."""
    if record.r is None:
        return None
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    R: ComplexArray = line_spectra(record, record.r, lines, record.hold_response(freq_hz)[:, None]).mean(axis=0)
    return R


def line_spectra(
    record: Record,
    signals: FloatArray,
    lines: IntArray,
    factor: ComplexArray | float = 1.0,
    out: ComplexArray | None = None,
) -> ComplexArray:
    """factor times complex amplitudes (P, F, c) at lines (F,) of signals (n_samples, c), one for each repetition."""
    L = record.repeat_samples
    P = record.n_samples // L
    blocks = signals[: P * L].reshape(P, L, -1)
    if not record.half_wave:
        spectra: ComplexArray = np.multiply(rfft(blocks, axis=1)[:, _contiguous(lines)], factor * (2 / L), out=out)
        return spectra
    # The mean of all whole periods is no part of what changes sign; half a period would see it at every odd line.
    blocks = blocks - signals[: P // 2 * 2 * L].mean(axis=0)
    sign = (-1.0) ** np.arange(P)
    halves: ComplexArray = rfft(blocks, n=2 * L, axis=1)[:, lines] * (sign[:, None, None] * (2 / L))
    return np.multiply(halves, factor, out=out)


def _contiguous(lines: IntArray) -> slice | IntArray:
    """Lines as a slice where they are evenly spaced: a view instead of a copy."""
    step = int(lines[1] - lines[0]) if len(lines) > 1 else 1
    return slice(int(lines[0]), int(lines[-1]) + 1, step) if np.all(np.diff(lines) == step) else lines


def _drift_spectra(record: Record, lines: IntArray, drifts: BoolArray) -> ComplexArray:
    r"""Spectra (P, F, c) of the drift of those columns of y that drift.

    The DFT of the derivative over a period is j omega X + [x(T) - x(0)]: what x gains from end to end is drift, and a
    ramp g n / N of that height is all that has to go. (Half wave: [-x(T/2) - x(0)], a constant g / 2.) With
    theta = 2 pi k / N their sums are

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
    ramp = sign * (2 / L) / (np.exp(-2j * np.pi * lines / record.period_samples) - 1)
    parity = sign ** np.arange(P)
    spectra: ComplexArray = (parity[:, None] * gain)[:, None, :] * ramp[:, None]
    return spectra


def refuse_missing(record: Record) -> None:
    """DataError that names the first sample that is missing, where one is."""
    if np.isfinite(record.u).all() and np.isfinite(record.y).all():
        return
    in_u = not np.isfinite(record.u).all()
    role, names, signals = ("u", record.inputs, record.u) if in_u else ("y", record.outputs, record.y)
    sample, column = np.argwhere(~np.isfinite(signals))[0]
    raise DataError(
        f"record {record.name}: {role} at {names[column]} is NaN or infinite from sample {sample} on; "
        "leave that part out, or mend the record"
    )
