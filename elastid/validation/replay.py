r"""A record replayed: the torque that was measured, through the fitted model, beside the motion that was measured.

.. math:: \hat Y(k) = G(j\omega_k)\, U(k), \qquad
          fit_i = 100\,\% \left(1 - \sqrt{\textstyle\sum_k |Y_i - \hat Y_i|^2 / \sum_k |Y_i|^2}\right)

at every line of the period, excited or not, between the lowest and the highest line of the response: what the robot
does below (drift, gravity, a slow carrier) no free model can follow, and above there is but noise. Outputs are
compared in the quantity of the response, accelerations as a rule. Within a period in the steady state this is exact.

A record of one period, or with one that counts, begins and ends in states of its own, and its samples do not go round.
To first order in what they leave below and above the band,

.. math:: \hat Y(k) = G U + (j\omega)^m \left(C Z^{-1} [(j\omega M + D)\, \delta q + M\, \delta v]
          + c_0 + j\omega c_1\right)

with 2 n + 2 n_y real numbers, found by least squares: the states' difference from end to end, and the aliases of the
outputs' own. (Pintelon and Schoukens, System Identification, 2nd ed., section 6.3; m = 2 for accelerations.)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.frf.period_selection import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, period_spectra
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.transfer import frequency_response
from elastid.record import MOTION_ORDER, Motion, Record, motion_unit


@dataclass(frozen=True)
class Replay:
    """How well the model moves as the robot did under the same torque, in one configuration.

    records: names.  units (n_y): of the outputs in `quantity`.  fit_percent (n_r, n_y): of each record and output; 100
    where nothing differs, 0 where no motion at all would be as good.  reachable_percent (n_r, n_y): of a true model, as
    far as what does not repeat from period to period tells; NaN of records of one period.  error_rms (n_r, n_y): in
    units.  shown: the record whose signals follow, that of the worst fit; measured, replayed (N, n_y): one period of it
    within band_hz, sampled at rate_hz.
    """

    configuration: str
    records: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion
    units: tuple[str, ...]
    band_hz: tuple[float, float]
    fit_percent: FloatArray
    reachable_percent: FloatArray
    error_rms: FloatArray
    shown: str
    rate_hz: float
    rate_is_known: bool
    measured: FloatArray
    replayed: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays and check shapes."""
        for name in ("fit_percent", "reachable_percent", "error_rms", "measured", "replayed"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        table, signals = (len(self.records), len(self.outputs)), (len(self.measured), len(self.outputs))
        for name in ("fit_percent", "reachable_percent", "error_rms"):
            if getattr(self, name).shape != table:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {table}")
        if self.measured.shape != signals or self.replayed.shape != signals:
            raise ValueError(f"signals have shapes {self.measured.shape} and {self.replayed.shape}")

    @property
    def worst(self) -> float:
        """The lowest fit of any record and output, in percent."""
        return float(self.fit_percent.min())

    @property
    def mean(self) -> FloatArray:
        """Fit (n_y,) of each output over the records, in percent."""
        mean: FloatArray = self.fit_percent.mean(axis=0)
        return mean

    @property
    def mean_reachable(self) -> FloatArray:
        """What a true model would reach (n_y,), in percent."""
        mean: FloatArray = self.reachable_percent.mean(axis=0)
        return mean


def replay(
    records: Iterable[Record],
    model: LinearModel,
    theta: FloatArray,
    band_hz: tuple[float, float],
    spec: EstimatorSpec,
) -> Replay:
    """The records of one configuration through its model at theta (n_theta,); records are read one at a time.

    model: with the records' inputs and outputs in their order; model.quantity is compared.  spec: which periods count.
    Raises StudyError where band_hz holds no line.
    """
    pieces = [_replayed(record, model, theta, band_hz, spec) for record in records]
    worst = min(pieces, key=lambda piece: float(piece.fit_percent.min()))
    return replace(
        worst,
        records=tuple(name for piece in pieces for name in piece.records),
        fit_percent=np.concatenate([piece.fit_percent for piece in pieces]),
        reachable_percent=np.concatenate([piece.reachable_percent for piece in pieces]),
        error_rms=np.concatenate([piece.error_rms for piece in pieces]),
    )


def replay_words(replays: Sequence[Replay]) -> str:
    """The worst output of all configurations, as a sentence."""
    worst = min(replays, key=lambda each: each.worst)
    row, column = np.unravel_index(int(np.argmin(worst.fit_percent)), worst.fit_percent.shape)
    fits = np.concatenate([each.fit_percent.ravel() for each in replays])
    reachable = worst.reachable_percent[row, column]
    noise = f"; {reachable:.3g} % were it only for noise" if np.isfinite(reachable) else ""
    return (
        f"Replayed with the torque that was measured, the model explains {np.median(fits):.3g} % of the "
        f"{worst.quantity} in the excited band (median of outputs and records; 100 % less the rms error over the rms "
        f"motion), at worst {worst.fit_percent[row, column]:.3g} % ({worst.outputs[column]}, record "
        f"{worst.records[row]}{noise}). What repeats and is not explained is friction, other nonlinearity, or an "
        "error of the model."
    )


def _replayed(
    record: Record, model: LinearModel, theta: FloatArray, band_hz: tuple[float, float], spec: EstimatorSpec
) -> Replay:
    """One record."""
    lines = grid_lines("odd" if record.half_wave else "full", band_hz, record.rate_hz, record.period_samples)
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    G = frequency_response(model, theta, freq_hz)
    if _settled_periods(record, spec) > 1:
        spectra = trusted(period_spectra(RecordSpectra(record), lines, model.quantity), spec)
        Y, U = spectra.Y, spectra.U
        Yhat = (G @ U[..., None])[..., 0]
    else:
        Y, U = _single(record, lines, model.quantity)
        Yhat = (G @ U[..., None])[..., 0]
        Yhat = Yhat + _end_effects(Y[0] - Yhat[0], model, theta, freq_hz)
    E = Y - Yhat
    measured, error, noise = (_rms(X) for X in (Y, E, _not_repeating(E)))
    still = measured == 0
    scale = np.where(still, np.nan, measured)
    N = record.period_samples
    return Replay(
        configuration=record.configuration.name,
        records=(record.name,),
        outputs=record.outputs,
        quantity=model.quantity,
        units=tuple(motion_unit(model.quantity, place in record.sliding) for place in record.outputs),
        band_hz=(float(freq_hz[0]), float(freq_hz[-1])),
        fit_percent=np.where(still, 0.0, 100 * (1 - error / scale))[None],
        reachable_percent=(100 * (1 - noise / scale))[None],
        error_rms=error[None],
        shown=record.name,
        rate_hz=record.rate_hz,
        rate_is_known=record.rate_is_known,
        measured=_signals(Y[-1], lines, N),
        replayed=_signals(Yhat[-1], lines, N),
    )


def _settled_periods(record: Record, spec: EstimatorSpec) -> int:
    """How many periods are left without those that the study or the repair of the log does not count."""
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    kept = set(range(dropped, record.n_samples // record.repeat_samples)) - set(record.left_out)
    return len(kept)


def _single(record: Record, lines: IntArray, quantity: Motion) -> tuple[ComplexArray, ComplexArray]:
    """Y (1, F, n_y), U (1, F, n_u) of the last good period of a record, as it is."""
    periods = range(record.n_samples // record.repeat_samples)
    last = [max((p for p in periods if p not in record.left_out), default=len(periods) - 1)]
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    order = np.array([MOTION_ORDER[quantity] - MOTION_ORDER[each] for each in record.quantities])
    spectra = RecordSpectra(record)
    Y = spectra.amplitudes("y", lines)[last] * (2j * np.pi * freq_hz[:, None]) ** order
    return Y, spectra.amplitudes("u", lines)[last] * record.hold_response(freq_hz)[:, None]


def _end_effects(E: ComplexArray, model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    """What of E (F, n_y) states that differ from end to end explain; nothing where there are too few lines to tell."""
    M, D, _ = model.matrices(theta)
    F, n_y = E.shape
    s = 2j * np.pi * freq_hz[:, None, None]
    states = [f"state {i}" for i in range(2 * model.n)]
    T = frequency_response(replace(model, B=np.hstack([M, D]), inputs=tuple(states)), theta, freq_hz)
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
    explained: ComplexArray = terms @ x
    return explained


def _not_repeating(E: ComplexArray) -> ComplexArray:
    """The part of E (P, F, n_y) that is another one in every period; NaN where there is but one."""
    P = len(E)
    if P < 2:
        return np.full_like(E, np.nan)
    scatter: ComplexArray = (E - E.mean(axis=0)) * np.sqrt(P / (P - 1))
    return scatter


def _rms(X: ComplexArray) -> FloatArray:
    """Root mean square (n_y,) over time of signals with the amplitudes X (P, F, n_y)."""
    rms: FloatArray = np.sqrt(np.sum(np.abs(X) ** 2, axis=1).mean(axis=0) / 2)
    return rms


def _signals(X: ComplexArray, lines: IntArray, N: int) -> FloatArray:
    """One period (N, n_y) in time of the amplitudes X (F, n_y) at DFT lines (F,)."""
    spectrum = np.zeros((N // 2 + 1, X.shape[1]), dtype=np.complex128)
    spectrum[lines] = X * N / 2
    signals: FloatArray = np.fft.irfft(spectrum, n=N, axis=0)
    return signals
