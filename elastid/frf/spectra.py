"""From a record to the complex amplitudes of its inputs and outputs, period by period.

    X_p(k) = 2 / N sum_n x(n + p N) exp(-2 pi j k n / N),   velocity = j omega position, ...

With this sign a delay turns the phase of Y / U down, and y = Re Y exp(j omega t) like every phasor of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import rfft

from elastid.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.excitation.grids import line_frequencies
from elastid.record import MOTION_ORDER, Motion, Record

# Around the ends of a period its drift is averaged over this part of it: long enough that encoder noise does not
# enter, short enough that the drift is straight.
_END_WINDOW = 1 / 50


@dataclass(frozen=True)
class PeriodSpectra:
    """U (P, F, n_u) and Y (P, F, n_y) of the periods of one record that are used, by their index (P,) in it.

    Torques in Nm as they act between the samples; outputs all in one quantity.
    """

    record: Record
    periods: IntArray
    U: ComplexArray
    Y: ComplexArray
    notes: tuple[str, ...] = ()


def period_spectra(record: Record, lines: IntArray, quantity: Motion) -> PeriodSpectra:
    """All periods of a record at DFT lines (F,), outputs as `quantity`: exact, by powers of j omega.

    A position or velocity that drifts is freed of what does not repeat.  Of a half-wave record each half period
    counts as a period, and lines must be odd.
    """
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    j_omega = 2j * np.pi * freq_hz[:, None]
    order = np.array([MOTION_ORDER[quantity] - MOTION_ORDER[each] for each in record.quantities])
    drifts = np.array([each != "acceleration" for each in record.quantities])
    U = line_spectra(record, record.u, lines) * record.hold_response(freq_hz)[:, None]
    Y = line_spectra(record, _without_drift(record, record.y, drifts), lines) * j_omega**order
    return PeriodSpectra(record, np.arange(len(U)), U, Y)


def line_spectra(record: Record, signals: FloatArray, lines: IntArray) -> ComplexArray:
    """Complex amplitudes (P, F, c) at lines (F,) of signals (n_samples, c), one for each repetition in the record."""
    L = record.repeat_samples
    P = record.n_samples // L
    blocks = signals[: P * L].reshape(P, L, -1)
    if not record.half_wave:
        spectra: ComplexArray = rfft(blocks, axis=1)[:, lines] * (2 / L)
        return spectra
    # The mean of all whole periods is no part of what changes sign; half a period would see it at every odd line.
    blocks = blocks - signals[: P // 2 * 2 * L].mean(axis=0)
    sign = (-1.0) ** np.arange(P)
    halves: ComplexArray = rfft(blocks, n=2 * L, axis=1)[:, lines] * sign[:, None, None] * (2 / L)
    return halves


def _without_drift(record: Record, signals: FloatArray, drifts: BoolArray) -> FloatArray:
    r"""Signals (n_samples, c) with the drift of each period taken out of those columns that drift.

    The DFT of the derivative over a period is j omega X + [x(T) - x(0)]: what x gains from end to end is drift, and a
    ramp of that height is all that has to go.  (Half wave: [-x(T/2) - x(0)], a constant.)
    """
    if not drifts.any():
        return signals
    L = record.repeat_samples
    P = record.n_samples // L
    x = signals[: P * L, drifts]
    sign = -1 if record.half_wave else 1
    gain = x[L:] - sign * x[:-L]
    window = max(1, round(_END_WINDOW / 2 * L))
    ends = np.array([gain[max(0, p * L - window) : p * L + window + 1].mean(axis=0) for p in range(P)])
    shape = np.full(L, 0.5) if record.half_wave else np.arange(L) / L
    result = signals[: P * L].copy()
    result[:, drifts] = x - (ends[:, None] * shape[:, None]).reshape(P * L, -1)
    return result
