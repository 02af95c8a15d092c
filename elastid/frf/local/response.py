r"""Frequency responses by local polynomial and local rational methods, for one or more experiments.

In open loop (no reference in the records) the local model is from U to Y.  In closed loop it is from the reference R,
which has no noise, to Z = [Y; U], and

.. math:: G = G_{yr} G_{ur}^{-1}, \qquad dG = [I, -G]\, dG_{zr}\, G_{ur}^{-1}

to first order: noise that feedback adds to U causes no bias.  All experiments and realisations of a configuration are
in one regression.  Its residual contains noise and stochastic nonlinear distortion, which together are `total`; `noise`
is estimated from the bins between the excited ones. (Pintelon, Schoukens, Vandersteen and Barbe, MSSP 24, 2010, parts I
and II.)

The DFT of P periods has the excited lines at every P-th bin; the bins between them contain transient and noise only, as
do the even bins in one period of a half-wave record, where even nonlinear distortion counts as noise.

.. math:: Z(k) = G_{zr}(k) R(k) + T(k) + V(k), \quad A_k(r) T(k + r) = T_k(r)

T has the poles of the system. Near a bin it is a rational function of low order for any damping, whereas a polynomial
is accurate only for modes wider than a window. A is common to all signals of a record. No period is discarded, and a
drift of a position is part of T. (Transient removal of the robust method, Pintelon and Schoukens, 2nd ed., section 7.3,
with a rational T.)

For records with proportional inputs, R_e = c_e R, combinations with sum c_e a_e = 0 contain no input and give no
information on G. The combination with all of the input,

.. math:: \bar Z = \frac{\sum_e P_e c_e Z_e}{\sum_e P_e c_e^2}, \quad
          C_{\bar Z} = \frac{\sum_e P_e^2 c_e^2 C_{Z,e}}{(\sum_e P_e c_e^2)^2}

has the noise of a mean of sum P_e c_e^2 periods and one transient.  The windows are then as wide as for a single
experiment, so that the residual contains the errors of the local model.

A delayed repeat has R_e = exp(-j omega tau) R, which is not proportional, but dependent within a window.  Such records
are not merged; for the width of the windows they count as one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, quotient
from elastid.base.errors import DataError, Note, notes_of
from elastid.base.fourier import real_dft
from elastid.base.large_arrays import MIN_LARGE_VALUES
from elastid.base.matrices import power
from elastid.excitation.grids import line_frequencies
from elastid.frf.checks import REPEAT_DIFFERENCE
from elastid.frf.lines import analysed_lines
from elastid.frf.local.fitted_response import (
    Experiments,
    fitted_response,
    local_quality,
    separates_inputs,
    with_model_error,
)
from elastid.frf.local.least_squares import (
    LadderFit,
    LocalFit,
    WindowTerms,
    fit_ladder,
    fit_transient,
    transient_half_width,
    window_power,
    windows,
)
from elastid.frf.quality import discarded_lines_note, local_modes, measured_response, wide_window_notes
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, undivided_logs, unit_scale
from elastid.record import Motion, Record
from elastid.response import Response

# Thresholds of the local methods.
MIN_DOF = 6  # least degrees of freedom of a variance: its std is then 40 %
MARGIN_DOF = 2  # least degrees of freedom above the number of outputs
MIN_INPUT_SNR = 10.0  # least power of an excited input over its noise (10 dB)
EXCITED_FRACTION = 0.05  # least fraction of lines at which an input is excited
MAX_CORRELATION = 0.5  # of two inputs in a window, above which they are one excitation; random phases: 0.3


@dataclass(frozen=True)
class SteadySpectra:
    """Complex amplitudes Y (F, n_y), U (F, n_u) and R (F, n_u), or None, of a record at its lines.

    is_steady: True if the transient was estimated between the lines and subtracted.  noise (F, n_z, n_z): covariance of
    [Y; U] with `dof`; 0 if not steady.
    """

    Y: ComplexArray
    U: ComplexArray
    R: ComplexArray | None
    n_periods: float
    is_steady: bool
    noise: ComplexArray
    dof: float


@dataclass(frozen=True, eq=False)
class _Signals:
    """Z (E, F, n_z) and input R (E, F, n_u) of E experiments at lines (F,); G is at lines[response_lines]."""

    Z: ComplexArray
    R: ComplexArray
    lines: IntArray
    response_lines: slice
    step: int


def local_response(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None, max_lines: int | None = None
) -> Response:
    """Estimate G (F, n_y, n_u) of one configuration with covariances and quality, from one experiment or more.

    Transients are estimated from bins between the excited ones, or, without such bins, together with G; then noise is
    None.  `transient_periods` of the spec are discarded.  max_lines: largest number of lines of G, evenly spaced.
    Raises DataError for a missing sample or period, too few lines, or dependent inputs.
    """
    records, cut_records = _cut_to_one_length(records)
    logs = undivided_logs(records)
    first = logs[0]
    all_lines = analysed_lines([RecordSpectra(log) for log in logs], spec, planned_lines)
    n_discarded = 0 if spec.transient_periods == "auto" else spec.transient_periods
    spectra = [steady_spectra(log, all_lines, spec.quantity, n_discarded) for log in logs]
    _check_excitation(first, spectra)
    closed = all(spectrum.R is not None for spectrum in spectra)
    spectra = merge_repeats(spectra, closed)
    signals = _signals(spectra, closed, all_lines, _step(spec, first), max_lines)
    experiments = _experiments(spectra, closed, signals.response_lines)
    fits, richer = _fits(signals, spec, first, transient=experiments.C_Z is None)
    S_rr = window_power(signals.R, fits.window)
    usable = separates_inputs(fits.selected, experiments)
    if not usable.any():
        raise DataError(
            "frf/inputs-not-separable",
            f"{spec.method} cannot separate the {len(first.inputs)} inputs ({', '.join(first.inputs)}) at any line, "
            "since one was not excited or two are proportional. Give each its own random phases",
            f"configuration {first.configuration.name}",
        )
    fitted = fitted_response(fits.selected, experiments, usable)
    total = with_model_error(fitted, richer, experiments, usable)
    lines, span = all_lines[signals.response_lines], fits.window.span
    freq_hz, span_hz = (line_frequencies(x[usable], first.rate_hz, first.period_samples) for x in (lines, span))
    quality = local_quality(freq_hz, fitted, experiments.periods, S_rr[usable])
    notes = [*cut_records, *notes_of(logs)]
    if not usable.all():
        notes.append(discarded_lines_note(lines[~usable], first, "inputs move in proportion"))
    if len(spectra) < len(logs):
        text = (
            f"{len(logs)} records with {len(spectra)} different excitation{'s' if len(spectra) > 1 else ''}; records "
            "with proportional inputs are averaged and count as one experiment"
        )
        notes.append(Note("frf/window", text, severity="information"))
    unit, n_w = "Hz" if first.has_rate else "of the sampling rate", fits.window.index.shape[1]
    text = (
        f"{spec.method} of order {fits.terms.order} in windows of {n_w} lines ({np.median(span_hz):.3g} {unit}), "
        f"{fits.selected.dof:.3g} degrees of freedom"
    )
    notes.append(Note("frf/window", text, severity="information"))
    notes += wide_window_notes(local_modes(freq_hz, fitted.G, total.variance), freq_hz, span_hz, fits.terms.poles)
    response = measured_response(
        first, spec.quantity, freq_hz, fitted.G, noise=fitted.noise, total=total, quality=quality, notes=tuple(notes)
    )
    # Correlation length of the errors of G, 1 / (n sum w^2) of a window: 4/9 for a local quadratic.
    thinning = signals.response_lines.step // signals.step
    return replace(response, correlated_lines=max(1.0, 4 / 9 * n_w / signals.step) / thinning)


def _cut_to_one_length(records: Sequence[Record]) -> tuple[Sequence[Record], tuple[Note, ...]]:
    """Return aperiodic records cut to the shortest one, which gives them the same lines, and a note."""
    lengths = np.array([record.n_samples for record in records])
    n = int(lengths.min())
    if records[0].is_periodic or np.all(lengths == n):
        return records, ()
    first = records[0]
    place = f"configuration {first.configuration.name}"
    seconds = f"{n / first.rate_hz:g} to {lengths.max() / first.rate_hz:g} s"
    if n < 0.5 * lengths.max():
        raise DataError(
            "frf/records",
            f"its records last {seconds}; a local method needs one length. Cut them by samples: [first, last], or set "
            "estimator.method h1",
            place,
        )
    cut_records = [record.part(slice(n), period_samples=n) for record in records]
    text = f"records of {seconds} are cut to the shortest length, since a local method compares them line by line"
    return cut_records, (Note("frf/window", text, place),)


def spectra_at(signals: FloatArray, samples: slice, bins: IntArray) -> ComplexArray:
    """Return the complex amplitudes (B, c) of a range of samples of signals (n, c) at bins (B,)."""
    n, c = samples.stop - samples.start, signals.shape[1]
    at_once = c if signals.size < MIN_LARGE_VALUES else 1
    groups = [slice(i, i + at_once) for i in range(0, c, at_once)]
    every = [real_dft(signals[samples, columns][None], bins)[0] for columns in groups]
    return np.asarray(np.concatenate(every, axis=1) * (2 / n))


def steady_spectra(record: Record, lines: IntArray, quantity: Motion, n_discarded: int = 0) -> SteadySpectra:
    """Return the spectra of a record at lines (F,) of its period without the transient; skip `n_discarded` periods."""
    P = record.n_periods - n_discarded
    samples = slice(n_discarded * record.period_samples, record.n_periods * record.period_samples)
    n = samples.stop - samples.start
    n_y, bins = len(record.outputs), lines * P
    # Bins between the lines, without 0 and the highest: no multiples of P; even bins for one half-wave period.
    half_width = transient_half_width(n_y, n_y + len(record.inputs))
    if (2 * half_width + 1) * len(bins) < n // 2:
        inner = np.unique(np.clip(bins[:, None] + np.arange(-half_width, half_width + 1), 1, n // 2 - 1))
    else:
        inner = np.arange(1, n // 2)
    transient_bins = inner[inner % 2 == 0] if record.half_wave and P == 1 else inner[inner % P != 0]
    indices = np.concatenate([bins, transient_bins])
    Y, U, R = (None if x is None else spectra_at(x, samples, indices) for x in (record.y, record.u, record.r))
    with np.errstate(divide="ignore", invalid="ignore"):
        Z = np.concatenate([Y, U], axis=1) * unit_scale(record, indices * record.rate_hz / n, quantity)
    at_lines, between = np.split(Z, [len(bins)])
    fit = fit_transient(between, transient_bins, bins, n_y)
    noise, dof = np.zeros((len(lines), Z.shape[1], Z.shape[1]), np.complex128), 0.0
    if fit is not None:
        at_lines = at_lines - fit.T[:, 0]
        noise, dof = fit.scatter / fit.dof * (1 + fit.transient_factor[:, 0, None, None]), fit.dof
    Y, U, R = at_lines[:, :n_y], at_lines[:, n_y:], None if R is None else R[: len(bins)]
    return SteadySpectra(Y, U, R, n_periods=P, is_steady=fit is not None, noise=noise, dof=dof)


def _signals(
    spectra: Sequence[SteadySpectra], closed: bool, lines: IntArray, step: int, max_lines: int | None
) -> _Signals:
    """Return the records scaled by sqrt(P), which gives all of them the noise of one period."""
    root_P = np.sqrt([spectrum.n_periods for spectrum in spectra])[:, None, None]
    Z = root_P * np.stack([np.concatenate([X.Y, X.U], axis=1) if closed else X.Y for X in spectra])
    R = root_P * np.stack([driver_of(spectrum, closed) for spectrum in spectra])
    thinning = 1 if max_lines is None else max(1, -(-len(lines) // (step * max_lines)))
    every = slice((step - 1) // 2, None, step * thinning)  # centred
    return _Signals(Z, R, lines, every, step)


def _experiments(spectra: Sequence[SteadySpectra], closed: bool, every: slice) -> Experiments:
    """Return the experiments with the mean noise of one period, weighted by degrees of freedom."""
    dof, C_Z = sum(spectrum.dof for spectrum in spectra), None
    if all(spectrum.is_steady for spectrum in spectra):
        C_Z = np.sum([X.noise[every] * (X.dof * X.n_periods / dof) for X in spectra], axis=0)
    return Experiments(spectra[0].Y.shape[1], closed, np.array([spectrum.n_periods for spectrum in spectra]), C_Z, dof)


def _fits(
    signals: _Signals, spec: EstimatorSpec, first: Record, transient: bool
) -> tuple[LadderFit, list[tuple[LocalFit, BoolArray]]]:
    """Return the fit at each line of G; with a transient also richer fits, each with flags (F,) of their lines.

    The richer fit of a polynomial is the rational fit of `auto`, if there are enough lines for its windows.
    Raises DataError for too few lines.
    """
    n_u, n_lines = len(first.inputs), len(signals.lines)
    ladders = [_ladder(spec, n_u, transient)]
    if transient and spec.method == "local_polynomial":
        ladders.append(_ladder(replace(spec, method="local_rational", local_order="auto"), n_u, transient))
    widths = [_window_lines(signals, ladder[-1], len(first.outputs)) for ladder in ladders]
    if widths[0] > n_lines:
        raise DataError(
            "frf/lines",
            f"{spec.method} needs {widths[0]} lines per window; {n_lines} are excited. Widen band_hz, measure more "
            "experiments, or use a longer period or record",
            f"configuration {first.configuration.name}",
        )
    fits = []
    for ladder, n_w in zip(ladders, widths, strict=True):
        if n_w <= n_lines:
            window = windows(signals.lines, signals.lines[signals.response_lines], max(n_w, min(signals.step, n_lines)))
            fits.append(fit_ladder(signals.Z, signals.R, window, ladder))
    # Each at the lines with a simpler model.
    further = [(model, fits[0].selected_index < i) for i, model in enumerate(fits[0].models) if i]
    everywhere = np.ones(len(fits[0].selected_index), np.bool_)
    return fits[0], [*further, *((fit.selected, everywhere) for fit in fits[1:])] if transient else []


def _window_lines(signals: _Signals, terms: WindowTerms, n_y: int) -> int:
    """Return the number of lines per window.

    If each experiment has a separate transient, only independent excitations count.
    """
    n_z, dof = signals.Z.shape[2], max(n_y + MARGIN_DOF, MIN_DOF)
    E = independent_excitations(signals.R, terms.width(dof, 1, n_z)) if terms.transient else len(signals.Z)
    return terms.width(dof, E, n_z)


def _step(spec: EstimatorSpec, first: Record) -> int:
    """Return the number of DFT lines per line of G; 1 for records with a period."""
    if spec.resolution_hz is None or first.is_periodic:
        return 1
    return max(1, round(spec.resolution_hz * first.period_samples / first.rate_hz))


def _check_excitation(first: Record, spectra: Sequence[SteadySpectra]) -> None:
    """Raise DataError for an input that exceeds its noise at too few lines."""
    n_y = len(first.outputs)
    signal = np.sum([np.abs(spectrum.U) ** 2 for spectrum in spectra], axis=0)
    clear = signal > MIN_INPUT_SNR * np.sum([power(spectrum.noise)[:, n_y:] for spectrum in spectra], axis=0)
    for i in np.flatnonzero(clear.mean(axis=0) < EXCITED_FRACTION):
        raise DataError(
            "frf/lines",
            f"input {first.inputs[i]} was not excited: only {int(clear[:, i].sum())} of {len(clear)} lines are 10 dB "
            "above its noise, and its column of G is not identifiable. Check its channel, or raise its torque",
            f"configuration {first.configuration.name}",
        )


def _ladder(spec: EstimatorSpec, n_u: int, transient: bool) -> list[WindowTerms]:
    """Return the models for a line: one polynomial; or polynomial and rational of one order less, and rational."""
    d = spec.local_order
    if spec.method == "local_polynomial":
        return [WindowTerms(n_u, 2 if d == "auto" else d, 0, transient)]
    d = 3 if d == "auto" else d
    orders = [(d - 1, 0), (d - 1, d - 1), (d, d)] if d > 1 else [(1, 0), (1, 1)]
    return [WindowTerms(n_u, order, poles, transient) for order, poles in orders]


def independent_excitations(R: ComplexArray, n_w: int) -> int:
    """Return the number of inputs R (E, F, n_u) that are not proportional within windows of n_w lines."""
    E, F, _ = R.shape
    if E == 1:
        return 1
    bands = np.array_split(R, max(1, F // n_w), axis=1)
    grams = np.array([np.einsum("efu,gfu->eg", band, band.conj()) for band in bands])
    powers = np.einsum("cee->ce", grams).real
    # Weighted by the power of the inputs.
    correlation = quotient(np.abs(grams).sum(axis=0), np.sum(np.sqrt(powers[:, :, None] * powers[:, None, :]), axis=0))
    leaders: list[int] = []
    for e in range(E):
        if all(correlation[e, leader] < MAX_CORRELATION for leader in leaders):
            leaders.append(e)
    return len(leaders)


def merge_repeats(spectra: Sequence[SteadySpectra], closed: bool) -> list[SteadySpectra]:
    """Return one experiment for each excitation, in order; the reference excites if closed, otherwise the inputs do."""
    groups: list[list[SteadySpectra]] = []
    for spectrum in spectra:
        driver = driver_of(spectrum, closed)
        repeats = next((group for group in groups if _gain(driver_of(group[0], closed), driver) is not None), [])
        if not repeats:
            groups.append(repeats)
        repeats.append(spectrum)
    return [group[0] if len(group) == 1 else _merge(group, closed) for group in groups]


def driver_of(spectra: SteadySpectra, closed: bool) -> ComplexArray:
    """Return the reference in closed loop, else the inputs, (F, n_u)."""
    return spectra.R if closed and spectra.R is not None else spectra.U


def _gain(R: ComplexArray, R_other: ComplexArray) -> float | None:
    """Return c with R_other = c R up to a small difference, both (F, n_u); None without such a factor."""
    power, power_other = np.sum(np.abs(R) ** 2), np.sum(np.abs(R_other) ** 2)
    if power == 0 or power_other == 0:
        return None
    c = float(np.sum(R.conj() * R_other).real / power)
    return c if np.sum(np.abs(R_other - c * R) ** 2) < REPEAT_DIFFERENCE**2 * power_other else None


def _merge(group: Sequence[SteadySpectra], closed: bool) -> SteadySpectra:
    gains = [_gain(driver_of(group[0], closed), driver_of(spectrum, closed)) or 1.0 for spectrum in group]
    pairs = [(spectrum.n_periods * c, spectrum) for c, spectrum in zip(gains, group, strict=True)]
    total = sum(weight * c for (weight, _), c in zip(pairs, gains, strict=True))
    references = [weight * spectrum.R for weight, spectrum in pairs if spectrum.R is not None]
    return SteadySpectra(
        Y=np.sum([weight * spectrum.Y for weight, spectrum in pairs], axis=0) / total,
        U=np.sum([weight * spectrum.U for weight, spectrum in pairs], axis=0) / total,
        R=np.sum(references, axis=0) / total if len(references) == len(group) else None,
        n_periods=total,
        is_steady=all(spectrum.is_steady for spectrum in group),
        noise=np.sum([weight**2 * spectrum.noise for weight, spectrum in pairs], axis=0) / total**2,
        dof=sum(spectrum.dof for spectrum in group),
    )
