r"""A record replayed: the motion of the fitted model under the measured torque, compared with the measured motion.

.. math:: \hat Y(k) = G(j\omega_k)\, U(k), \qquad
          fit_i = 100\,\% \left(1 - \sqrt{\textstyle\sum_k |Y_i - \hat Y_i|^2 / \sum_k |Y_i|^2}\right)

at every line of the period, excited or not, between the lowest and the highest line of the response: motion below it
(drift, gravity, a slow carrier) is beyond a free model, and above it there is only noise. Outputs are compared in the
quantity of the response, accelerations as a rule. For a period of the steady state this is exact.

A record with one period that counts begins and ends in different states, so it is not periodic. To first order in the
leakage below and above the band,

.. math:: \hat Y(k) = G U + (j\omega)^m \left(C Z^{-1} [(j\omega M + D)\, \delta q + M\, \delta v]
          + c_0 + j\omega c_1\right)

with 2 n + 2 n_y real numbers from least squares: the difference of the states between the ends, and the aliases of that
of the outputs. (Pintelon and Schoukens, System Identification, 2nd ed., section 6.3; m = 2 for accelerations.)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.frf.period_selection import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, period_spectra, unit_scale
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.transfer import frequency_response
from elastid.record import MOTION_ORDER, Motion, Record, motion_unit
from elastid.validation.results import Replay


def replay(
    records: Iterable[Record], model: LinearModel, theta: FloatArray, band_hz: tuple[float, float], spec: EstimatorSpec
) -> Replay:
    """The records of one configuration through its model at theta (n_theta,); records are read one at a time.

    model: with the records' inputs and outputs in their order; model.quantity is compared.  spec: which periods count.
    Raises StudyError where band_hz holds no line.
    """

    @cache
    def response(is_half: bool, rate_hz: float, N: int) -> tuple[IntArray, ComplexArray]:
        lines = grid_lines("odd" if is_half else "full", band_hz, rate_hz, N)
        return lines, frequency_response(model, theta, line_frequencies(lines, rate_hz, N))

    pieces = [
        _replayed(record, model, theta, spec, *response(record.half_wave, record.rate_hz, record.period_samples))
        for record in records
    ]
    worst = min(pieces, key=lambda piece: float(piece.fit_percent.min()))
    return replace(
        worst,
        records=tuple(name for piece in pieces for name in piece.records),
        fit_percent=np.concatenate([piece.fit_percent for piece in pieces]),
        reachable_percent=np.concatenate([piece.reachable_percent for piece in pieces]),
    )


def describe_replays(replays: Sequence[Replay]) -> str:
    """Median and worst output of all configurations, as a sentence."""
    worst = min(replays, key=lambda each: each.worst)
    row, column = np.unravel_index(int(np.argmin(worst.fit_percent)), worst.fit_percent.shape)
    fits = np.concatenate([each.fit_percent.ravel() for each in replays])
    reachable = worst.reachable_percent[row, column]
    noise = f"; {reachable:.3g} % is reachable given the noise" if np.isfinite(reachable) else ""
    return (
        f"Replayed with the measured torque, the model explains {np.median(fits):.3g} % of the {worst.quantity} in the "
        "excited band (median of outputs and records; 100 % less the rms error over the rms motion), at worst "
        f"{worst.fit_percent[row, column]:.3g} % ({worst.outputs[column]}, record {worst.records[row]}{noise}). An "
        "unexplained part that repeats is friction, other nonlinearity, or an error of the model."
    )


def _replayed(
    record: Record, model: LinearModel, theta: FloatArray, spec: EstimatorSpec, lines: IntArray, G: ComplexArray
) -> Replay:
    """One record, through G (F, n_y, n_u) at lines (F,)."""
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    if settled_periods(record, spec) > 1:
        spectra = trusted(period_spectra(RecordSpectra(record), lines, model.quantity), spec)
        Y, U = spectra.Y, spectra.U
    else:
        Y, U = last_period(record, lines, model.quantity)
    Yhat, P = (G @ U[..., None])[..., 0], len(Y)
    if P == 1:
        Yhat = Yhat + _end_effects(Y[0] - Yhat[0], model, theta, freq_hz)
    E = Y - Yhat
    # The part that differs from period to period is not known of a single one.
    changing = (E - E.mean(axis=0)) * np.sqrt(P / (P - 1)) if P > 1 else np.full_like(E, np.nan)
    measured, error, noise = (_rms(X) for X in (Y, E, changing))
    scale, N = np.where(measured == 0, np.nan, measured), record.period_samples
    return Replay(
        configuration=record.configuration.name,
        records=(record.name,),
        outputs=record.outputs,
        quantity=model.quantity,
        units=tuple(motion_unit(model.quantity, place in record.sliding) for place in record.outputs),
        band_hz=(float(freq_hz[0]), float(freq_hz[-1])),
        fit_percent=np.nan_to_num(100 * (1 - error / scale))[None],
        reachable_percent=(100 * (1 - noise / scale))[None],
        shown=record.name,
        rate_hz=record.rate_hz,
        rate_is_known=record.rate_is_known,
        measured=signals_of(Y[-1], lines, N),
        replayed=signals_of(Yhat[-1], lines, N),
    )


def settled_periods(record: Record, spec: EstimatorSpec) -> int:
    """Number of periods that count: neither dropped by the study nor left out by the repair of the log."""
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    return len(set(range(dropped, record.n_samples // record.repeat_samples)) - set(record.left_out))


def last_period(record: Record, lines: IntArray, quantity: Motion) -> tuple[ComplexArray, ComplexArray]:
    """Y (1, F, n_y), U (1, F, n_u) of the last period of a record that was not left out."""
    periods = range(record.n_samples // record.repeat_samples)
    last = [max((p for p in periods if p not in record.left_out), default=len(periods) - 1)]
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    spectra, n_y = RecordSpectra(record), len(record.outputs)
    Y, U = (spectra.amplitudes(role, lines)[last] for role in ("y", "u"))
    scale = unit_scale(record, freq_hz, quantity)
    return Y * scale[:, :n_y], U * scale[:, n_y:]


def _end_effects(E: ComplexArray, model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    """The part of E (F, n_y) that states differing between the ends explain; zero where there are too few lines."""
    M, D, _ = model.matrices(theta)
    F, n_y = E.shape
    s = 2j * np.pi * freq_hz[:, None, None]
    states = [f"state {i}" for i in range(2 * model.n)]
    held = replace(model, B=np.hstack([M, D]), inputs=tuple(states), hold=None)
    T = frequency_response(held, theta, freq_hz)
    of_M, of_D = T[:, :, : model.n], T[:, :, model.n :]
    alias = np.broadcast_to(np.eye(n_y), (F, n_y, n_y)) * s ** MOTION_ORDER[model.quantity]
    terms = np.concatenate([s * of_M + of_D, of_M, alias, s * alias], axis=2)
    if 2 * F * n_y < 3 * terms.shape[2]:
        return np.zeros_like(E)
    A = terms.reshape(F * n_y, -1)
    A = np.concatenate([A.real, A.imag])
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    x = np.linalg.lstsq(A / size, np.concatenate([E.real.ravel(), E.imag.ravel()]), rcond=None)[0] / size
    return np.asarray(terms @ x)


def _rms(X: ComplexArray) -> FloatArray:
    """Root mean square (n_y,) over time of signals with the amplitudes X (P, F, n_y)."""
    return np.asarray(np.sqrt(np.sum(np.abs(X) ** 2, axis=1).mean(axis=0) / 2))


def signals_of(X: ComplexArray, lines: IntArray, N: int) -> FloatArray:
    """One period (N, n_y) in time of the amplitudes X (F, n_y) at DFT lines (F,)."""
    spectrum = np.zeros((N // 2 + 1, X.shape[1]), dtype=np.complex128)
    spectrum[lines] = X * N / 2
    return np.fft.irfft(spectrum, n=N, axis=0)
