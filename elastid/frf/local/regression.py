r"""The local regression at every line and its transient; repeats of one excitation as one experiment.

The DFT of P whole periods has the excited lines at every P-th bin; the bins between hold transient and noise alone.
(In one period of a half-wave record the even bins do, where even nonlinear distortion then counts as noise.)

.. math:: Z(k) = G_{zr}(k) R(k) + T(k) + V(k), \quad A_k(r) T(k + r) = T_k(r)

T has the poles of the system and no others: near a bin a rational function of low order whatever the damping, where a
polynomial fails as soon as a mode is narrower than a window. All signals of a record share A. So no period is lost,
and a drift (a position that gains from end to end) is part of T.
(Transient removal of the robust method, Pintelon and Schoukens, 2nd ed., section 7.3, with a rational T.)

Of records whose inputs are proportional, R_e = c_e R, every combination with sum c_e a_e = 0 has no input: it
determines a transient of its own and nothing else.  The one combination with all of the input,

.. math:: \bar Z = \frac{\sum_e P_e c_e Z_e}{\sum_e P_e c_e^2}, \quad
          C_{\bar Z} = \frac{\sum_e P_e^2 c_e^2 C_{Z,e}}{(\sum_e P_e c_e^2)^2}

has the noise of a mean of sum P_e c_e^2 periods and one transient, smooth as theirs.  So windows are as wide as for a
single experiment, and their residual holds the errors of the local model, which repeats would hide.

A repeat that starts a little later has R_e = exp(-j omega tau) R, which no common gain describes, but within a window
it is as dependent.  Such records stay apart, and do not count where windows are sized.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.frf.local.least_squares import LocalFit, Windows, WindowTerms, fit_block, windows
from elastid.frf.spectra import unit_scale
from elastid.record import Motion, Record

# Numbers in the arrays of one block of lines: 64 MB.
_BLOCK_NUMBERS = 4_000_000
# Degree of the transient's numerator and denominator.
_ORDER, _POLES = 2, 2


@dataclass(frozen=True)
class Limits:
    """Thresholds of the local regression.

    False alarms of 300 clean logs: local-false-peak 0, local-repeats-averaged 0.
    """

    # A model replaces a simpler one where dof ln(residual power of that / its own) exceeds this in an output; false
    # alarms, poles that fit mere noise: one in 100 lines.
    log_gain: float = 9.0
    # Inputs that differ by less than this part, after the best gain, are repeats.
    difference: float = 0.2
    # Correlation of two inputs within a window from which on they count as one excitation; random phases have 0.3.
    correlation: float = 0.5


LIMITS = Limits()
_ARRAYS = tuple(field.name for field in fields(LocalFit) if field.name != "dof")


@dataclass(frozen=True)
class LadderFit:
    """The fit of the model that each line takes, those of all models at all lines, and taken (F,): its index."""

    chosen: LocalFit
    models: tuple[LocalFit, ...]
    taken: IntArray


def fit_ladder(Z: ComplexArray, R: ComplexArray, where: Windows, ladder: Sequence[WindowTerms]) -> LadderFit:
    """The local model at every line, from Z (E, B, n_z) and the input R (E, B, n_u) at the available bins.

    ladder: models of rising complexity, of which each line takes the first; a further one only where it leaves clearly
    less in some output.  Poles found in mere noise would make the residual too small, and needless orders make the
    estimate worse, most at the ends of the band.  dof of the chosen fit is that of the last.
    """
    fits = tuple(_in_blocks(Z, R, where, terms) for terms in ladder)
    chosen, (dof, poles) = fits[0], (fits[-1].dof, ladder[-1].poles)
    power, taken = _power(chosen), np.zeros(len(where.index), dtype=np.int64)
    for i, fit in enumerate(fits[1:], 1):
        clear = np.max(fit.dof * np.log(power / _power(fit)), axis=1) > LIMITS.log_gain
        power, taken = np.where(clear[:, None], _power(fit), power), np.where(clear, i, taken)
        chosen = _chosen(clear, _grown(fit, poles, dof), _grown(chosen, poles, dof))
    return LadderFit(chosen, fits, taken)


def _power(fit: LocalFit) -> FloatArray:
    """Residual power (F, n_z) of each output."""
    return np.asarray(np.maximum(np.einsum("fzz->fz", fit.scatter).real, 1e-300) / fit.dof)


def _grown(fit: LocalFit, poles: int, dof: float) -> LocalFit:
    """The same fit with room for more poles, and a residual as if it had fewer degrees of freedom."""
    more = poles - fit.M.shape[1]
    return replace(
        fit,
        M=np.pad(fit.M, ((0, 0), (0, more), (0, 0), (0, 0))),
        A_cov=np.pad(fit.A_cov, ((0, 0), (0, more), (0, more))),
        scatter=fit.scatter * (dof / fit.dof),
        dof=dof,
    )


def _chosen(take: BoolArray, a: LocalFit, b: LocalFit) -> LocalFit:
    """a at the lines taken (F,), b elsewhere."""
    arrays = {name: getattr(b, name).copy() for name in _ARRAYS}
    for name, array in arrays.items():
        array[take] = getattr(a, name)[take]
    return LocalFit(dof=a.dof, **arrays)


def _in_blocks(Z: ComplexArray, R: ComplexArray, where: Windows, terms: WindowTerms) -> LocalFit:
    """One model at all lines, in blocks that bound the memory."""
    E, _, n_z = Z.shape
    F, n_w = where.index.shape
    numbers = E * n_w * (terms.columns + E * terms.transient_columns + 2 * (terms.poles + 2) * n_z)
    step = max(1, _BLOCK_NUMBERS // numbers)
    fits = [fit_block(Z, R, where.on(slice(i, i + step)), terms) for i in range(0, F, step)]
    return LocalFit(dof=fits[0].dof, **{name: np.concatenate([getattr(fit, name) for fit in fits]) for name in _ARRAYS})


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
    used = slice(dropped * record.period_samples, record.n_periods * record.period_samples)
    n = used.stop - used.start
    freq_hz = np.arange(n // 2 + 1) * record.rate_hz / n
    Y, U, R = (None if x is None else rfft(x[used], axis=0) * (2 / n) for x in (record.y, record.u, record.r))
    with np.errstate(divide="ignore", invalid="ignore"):
        Z = np.concatenate([Y, U], axis=1) * unit_scale(record, freq_hz, quantity)
    n_y, bins = len(record.outputs), lines * P
    # The bins between lines, 0 and the highest left out: no multiples of P; even ones of one period of odd lines.
    inner = np.arange(1, len(Z) - 1)
    rest = inner[inner % 2 == 0] if record.half_wave and P == 1 else inner[inner % P != 0]
    settled = len(rest) > _ORDER + _POLES + 1
    at_lines = Z[bins]
    noise, dof = np.zeros((len(lines), Z.shape[1], Z.shape[1]), dtype=np.complex128), 0.0
    if settled:
        fit = _transient(Z[rest], rest, bins, n_y)
        at_lines = at_lines - fit.T[:, 0]
        noise, dof = fit.scatter / fit.dof * (1 + fit.T_left[:, 0, None, None]), fit.dof
    R = None if R is None else R[bins]
    return SettledSpectra(at_lines[:, :n_y], at_lines[:, n_y:], R, n_periods=P, settled=settled, noise=noise, dof=dof)


def _transient(Z: ComplexArray, rest: IntArray, bins: IntArray, n_y: int) -> LocalFit:
    """T at bins (F,) from Z (B, n_z) at the unexcited bins (B,)."""
    ladder = [WindowTerms(n_u=0, order=_ORDER, poles=poles, transient=True) for poles in (0, _POLES)]
    # The noise estimate has five degrees of freedom more than there are outputs.
    where = windows(rest, bins, ladder[-1].width(n_y + 5, 1, Z.shape[1]))
    return fit_ladder(Z[None], np.zeros((1, len(rest), 0), dtype=np.complex128), where, ladder).chosen


def independent_excitations(R: ComplexArray, n_w: int) -> int:
    """Number of the inputs R (E, F, n_u) that differ within windows of n_w lines, by more than a complex factor."""
    E, F, _ = R.shape
    if E == 1:
        return 1
    parts = np.array_split(R, max(1, F // n_w), axis=1)
    grams = np.array([np.einsum("efu,gfu->eg", part, part.conj()) for part in parts])
    powers = np.einsum("cee->ce", grams).real
    both = np.sum(np.sqrt(powers[:, :, None] * powers[:, None, :]), axis=0)
    # Where the inputs are strong counts most.
    correlation = np.divide(np.abs(grams).sum(axis=0), both, out=np.zeros((E, E)), where=both > 0)
    leaders: list[int] = []
    for e in range(E):
        if all(correlation[e, leader] < LIMITS.correlation for leader in leaders):
            leaders.append(e)
    return len(leaders)


def merge_repeats(spectra: Sequence[SettledSpectra], closed: bool) -> list[SettledSpectra]:
    """One experiment for each excitation, in order; the reference excites if closed, otherwise the inputs do."""
    groups: list[list[SettledSpectra]] = []
    for spectrum in spectra:
        own = next((g for g in groups if _gain(driver_of(g[0], closed), driver_of(spectrum, closed)) is not None), None)
        if own is None:
            groups.append([spectrum])
        else:
            own.append(spectrum)
    return [group[0] if len(group) == 1 else _merged(group, closed) for group in groups]


def driver_of(spectra: SettledSpectra, closed: bool) -> ComplexArray:
    """The reference in closed loop, else the inputs."""
    return spectra.R if closed and spectra.R is not None else spectra.U


def _gain(R: ComplexArray, R_other: ComplexArray) -> float | None:
    """c with other = c of up to a small difference, both (F, n_u); None where there is none."""
    power, own = np.sum(np.abs(R) ** 2), np.sum(np.abs(R_other) ** 2)
    if power == 0 or own == 0:
        return None
    c = float(np.sum(R.conj() * R_other).real / power)
    return c if np.sum(np.abs(R_other - c * R) ** 2) < LIMITS.difference**2 * own else None


def _merged(group: Sequence[SettledSpectra], closed: bool) -> SettledSpectra:
    """The combination of records with proportional inputs that has all of the input."""
    gains = [_gain(driver_of(group[0], closed), driver_of(spectrum, closed)) or 1.0 for spectrum in group]
    pairs = [(spectrum.n_periods * c, spectrum) for c, spectrum in zip(gains, group, strict=True)]
    total = sum(weight * c for (weight, _), c in zip(pairs, gains, strict=True))
    known = [weight * spectrum.R for weight, spectrum in pairs if spectrum.R is not None]
    return SettledSpectra(
        Y=np.sum([weight * spectrum.Y for weight, spectrum in pairs], axis=0) / total,
        U=np.sum([weight * spectrum.U for weight, spectrum in pairs], axis=0) / total,
        R=np.sum(known, axis=0) / total if len(known) == len(group) else None,
        n_periods=total,
        settled=all(spectrum.settled for spectrum in group),
        noise=np.sum([weight**2 * spectrum.noise for weight, spectrum in pairs], axis=0) / total**2,
        dof=sum(spectrum.dof for spectrum in group),
    )
