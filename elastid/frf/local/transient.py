r"""A record's spectra without its transient, and the noise in them, from the bins that are not excited.

The DFT of P whole periods has the excited lines at every P-th bin; the bins between hold transient and noise alone.
(In one period of a half-wave record the even bins do, where even nonlinear distortion then counts as noise.)

.. math:: Z(k) = G_{zr}(k) R(k) + T(k) + V(k), \quad A_k(r) T(k + r) = T_k(r)

T has the poles of the system and no others: near a bin a rational function of low order whatever the damping, where a
polynomial fails as soon as a mode is narrower than a window. All signals of a record share A. So no period is lost,
and a drift (a position that gains from end to end) is part of T.
(Transient removal of the robust method, Pintelon and Schoukens, 2nd ed., section 7.3, with a rational T.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.frf.local.least_squares import LocalFit
from elastid.frf.local.regression import fit_ladder
from elastid.frf.local.windows import WindowTerms, windows
from elastid.record import MOTION_ORDER, Motion, Record

# Degrees of freedom of the noise estimate beyond the number of outputs.
_DOF_MARGIN = 5
# Degree of the transient's numerator and denominator.
_ORDER = 2
_POLES = 2


@dataclass(frozen=True)
class SettledSpectra:
    """Y (F, n_y), U (F, n_u), R (F, n_u) or None: complex amplitudes of a record of P periods at its lines.

    noise (F, n_z, n_z): covariance of [Y; U] where settled, with its dof.  settled is False where no bin separates
    the transient from the response: then it is still in Y and U, and noise is 0.
    """

    Y: ComplexArray
    U: ComplexArray
    R: ComplexArray | None
    n_periods: float
    settled: bool
    noise: ComplexArray
    dof: float


def settled_spectra(record: Record, lines: IntArray, quantity: Motion, dropped: int = 0) -> SettledSpectra:
    """The spectra of a record at lines (F,) of its period without the transient; `dropped` periods are not used."""
    P = record.n_periods - dropped
    Z, R = _whole_spectra(record, quantity, dropped)
    n_y, bins = len(record.outputs), lines * P
    rest = _unexcited(len(Z), P, record.half_wave)
    settled = len(rest) > _ORDER + _POLES + 1
    at_lines = Z[bins]
    noise, dof = np.zeros((len(lines), Z.shape[1], Z.shape[1]), dtype=np.complex128), 0.0
    if settled:
        fit = _transient(Z[rest], rest, bins, n_y)
        at_lines = at_lines - fit.T[:, 0]
        noise, dof = fit.scatter / fit.dof * (1 + fit.T_left[:, 0, None, None]), fit.dof
    return SettledSpectra(
        Y=at_lines[:, :n_y],
        U=at_lines[:, n_y:],
        R=None if R is None else R[bins],
        n_periods=P,
        settled=settled,
        noise=noise,
        dof=dof,
    )


def _whole_spectra(record: Record, quantity: Motion, dropped: int) -> tuple[ComplexArray, ComplexArray | None]:
    """[Y, U] (B, n_y + n_u) and R (B, n_u) at all bins of the record: outputs as `quantity`, torque as it acts."""
    used = slice(dropped * record.period_samples, record.n_periods * record.period_samples)
    n = used.stop - used.start
    freq_hz = np.arange(n // 2 + 1) * record.rate_hz / n
    order = np.array([MOTION_ORDER[quantity] - MOTION_ORDER[each] for each in record.quantities])
    with np.errstate(divide="ignore", invalid="ignore"):
        Y = _spectra(record.y[used]) * (2j * np.pi * freq_hz[:, None]) ** order
    hold = record.hold_response(freq_hz)
    R = None if record.r is None else _spectra(record.r[used])
    return np.concatenate([Y, _spectra(record.u[used]) * hold], axis=1), R


def _spectra(signals: FloatArray) -> ComplexArray:
    return np.asarray(rfft(signals, axis=0) * (2 / len(signals)))


def _unexcited(n_bins: int, P: int, half_wave: bool) -> IntArray:
    """The bins between lines, 0 and the highest left out: no multiples of P; even ones of one period of odd lines."""
    bins: IntArray = np.arange(1, n_bins - 1)
    return np.asarray(bins[bins % 2 == 0] if half_wave and P == 1 else bins[bins % P != 0])


def _transient(Z: ComplexArray, rest: IntArray, bins: IntArray, n_y: int) -> LocalFit:
    """T at bins (F,) from Z (B, n_z) at the unexcited bins (B,)."""
    ladder = [WindowTerms(n_u=0, order=_ORDER, poles=poles, transient=True) for poles in (0, _POLES)]
    where = windows(rest, bins, ladder[-1].width(n_y + _DOF_MARGIN, 1, Z.shape[1]))
    return fit_ladder(Z[None], np.zeros((1, len(rest), 0), dtype=np.complex128), where, ladder).chosen
