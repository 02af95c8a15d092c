r"""Frequency responses by local polynomial and local rational methods: one experiment of all inputs is enough.

Open loop (no reference in the records): the local model leads from U to Y.  Closed loop: from the reference R, which
is free of noise, to Z = [Y; U], and

.. math:: G = G_{yr} G_{ur}^{-1}, \qquad dG = [I, -G]\, dG_{zr}\, G_{ur}^{-1}

to first order, so that the noise that feedback brings into U causes no bias.  All experiments and realisations of a
configuration enter one regression.  Its residual holds noise and stochastic nonlinear distortion: their sum is
`total`; `noise` comes from the bins between the excited ones.
(Pintelon, Schoukens, Vandersteen and Barbe, MSSP 24, 2010, parts I and II.)

A model that is too simple for a window passes part of G off as transient, and its residual does not show it: a
polynomial in a window wider than a resonance, a rational function with too few poles beside one.  A richer model of
about the same data differs from it by noise alone where both are right.  With g the mean over neighbouring lines of

.. math:: \frac{|G - G_{richer}|^2}{\sigma^2 + \sigma^2_{richer}}

the squared error (g - 1)(sum of the variances) is added to the variance of G where g is clearly above 1; of several
richer models that with the largest error counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.excitation.grids import line_frequencies
from elastid.frf.lines import analysed_lines, described_lines
from elastid.frf.local.fitted_response import fitted_response, local_quality, separates_inputs, window_power
from elastid.frf.local.least_squares import LocalFit, Windows, WindowTerms, windows
from elastid.frf.local.regression import (
    LadderFit,
    SettledSpectra,
    driver_of,
    fit_ladder,
    independent_excitations,
    merge_repeats,
    settled_spectra,
)
from elastid.frf.matrices import power
from elastid.frf.quality import local_modes, measured_response, wide_windows
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, single_logs
from elastid.record import Record
from elastid.response import Covariance, FrequencyResponse


@dataclass(frozen=True)
class Limits:
    """Thresholds of the local methods.  False alarms of 300 clean logs: local-refused 0."""

    lines: int = 11  # over which a difference to a richer model is averaged
    ratio: float = 1.5  # of its mean square to its variance, above which a difference is more than noise
    variance_ratio: float = 400.0  # a richer model of a variance so many times that of G shows no error of G
    dof: int = 6  # of a useful variance, at least: its standard deviation is then 40 %
    margin_dof: int = 2  # beyond the number of outputs
    input_snr: float = 10.0  # power of an excited input over its noise (10 dB),
    excited_share: float = 0.05  # at this part of the lines at least


LIMITS = Limits()


def local_mean(x: FloatArray) -> FloatArray:
    """Mean (F, ...) over the neighbouring lines, fewer of them at the ends."""
    F = len(x)
    total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)])
    first = np.maximum(np.arange(F) - LIMITS.lines // 2, 0)
    last = np.minimum(np.arange(F) + LIMITS.lines // 2 + 1, F)
    return np.asarray((total[last] - total[first]) / (last - first).reshape(-1, *(1,) * (x.ndim - 1)))


def local_response(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None, most_lines: int | None = None
) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration with its covariances and quality, from one experiment of all inputs or more.

    Transients are removed where bins between the excited ones show them, else fitted along; `transient_periods` of the
    spec are left out in any case.  noise is None where there are only excited lines.  most_lines: of G at most, evenly
    taken from those that it would have, each from the same window.

    Raises DataError where the lines are too few or the experiments do not separate the inputs.
    """
    records = [log for record in records for log in single_logs(record)]
    first = records[0]
    _refuse_incomplete(records)
    all_lines = analysed_lines([RecordSpectra(record) for record in records], spec, planned_lines)
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    spectra = [settled_spectra(record, all_lines, spec.quantity, dropped) for record in records]
    _refuse_dead_inputs(first, spectra)
    closed = all(spectrum.R is not None for spectrum in spectra)
    spectra, repeated = merge_repeats(spectra, closed), len(spectra)
    ladder = _ladder(spec, len(first.inputs), transient=not all(spectrum.settled for spectrum in spectra))
    # Each record times sqrt(P): then noise is that of one period in all of them.
    root_P = np.sqrt([spectrum.n_periods for spectrum in spectra])[:, None, None]
    Z = root_P * np.stack([np.concatenate([each.Y, each.U], axis=1) if closed else each.Y for each in spectra])
    R = root_P * np.stack([driver_of(spectrum, closed) for spectrum in spectra])
    step = _step(spec, first)
    thinning = 1 if most_lines is None else max(1, -(-len(all_lines) // (step * most_lines)))
    every = slice((step - 1) // 2, None, step * thinning)  # each in the middle of its neighbours
    spectra = [replace(spectrum, noise=spectrum.noise[every]) for spectrum in spectra]
    where = _windows(all_lines, ladder[-1], spec, first, (Z, R), every)
    fits = fit_ladder(Z, R, where, ladder)
    fit = fits.chosen
    usable = separates_inputs(fit, closed, len(first.outputs))
    if not usable.any():
        raise DataError(
            f"configuration {first.configuration.name}: {spec.method} cannot separate the {len(first.inputs)} inputs "
            f"({', '.join(first.inputs)}) at any line: one of them was not excited, or two move in proportion; give "
            "each its own random phases"
        )
    lines = all_lines[every]
    of_lines = fitted_response(fit, spectra, closed, usable)
    G, total = of_lines.G, of_lines.total
    if ladder[-1].transient:
        richer = _richer_models(fits, all_lines, (Z, R), spec, first, every)
        total = _with_model_error(G, total, richer, spectra, closed, usable)
    freq_hz, span_hz = (line_frequencies(x[usable], first.rate_hz, first.period_samples) for x in (lines, where.span))
    notes = [note for record in records for note in record.notes]
    if not usable.all():
        left_out = described_lines(lines[~usable], first)
        notes.append(Note("lines-left-out", f"lines {left_out} are left out: inputs move in proportion"))
    if len(spectra) < repeated:
        text = (
            f"{repeated} records with {len(spectra)} different excitation{'s' if len(spectra) > 1 else ''}: repeats, "
            "whose inputs are the same up to a gain, are averaged first and count as one experiment"
        )
        notes.append(Note("repeats-averaged", text, severity="information"))
    unit = "Hz" if first.rate_is_known else "of the sampling rate"
    text = (
        f"{spec.method} of order {ladder[-1].order} in windows of {where.index.shape[1]} lines "
        f"({np.median(span_hz):.3g} {unit}), {fit.dof:.3g} degrees of freedom"
    )
    notes.append(Note("local-method", text, severity="information"))
    notes += wide_windows(local_modes(freq_hz, G, total.variance), freq_hz, span_hz, ladder[-1].poles)
    quality = local_quality(freq_hz, of_lines, spectra, window_power(R, where)[usable])
    response = measured_response(
        first, spec.quantity, freq_hz, G, noise=of_lines.noise, total=total, quality=quality, notes=tuple(notes)
    )
    # Errors of G are correlated over 1 / (n sum w^2) of a window: 4/9 for a local quadratic, less for more parameters.
    together = 4 / 9 * where.index.shape[1] / step
    return replace(response, correlated_lines=max(1.0, together) / thinning)


def _refuse_incomplete(records: Sequence[Record]) -> None:
    """DataError for a record of which periods are left out."""
    for record in records:
        if record.left_out:
            periods = ", ".join(str(period + 1) for period in record.left_out)
            raise DataError(
                f"record {record.name}: too many samples of period {periods} are missing, and a local method takes a "
                "record as one piece; cut it with samples: [first, last], or take another estimator.method"
            )


def _richer_models(
    fits: LadderFit,
    lines: IntArray,
    signals: tuple[ComplexArray, ComplexArray],
    spec: EstimatorSpec,
    first: Record,
    every: slice,
) -> list[tuple[LocalFit, BoolArray]]:
    """Fits with more poles than those taken, each with the lines (F,) where it has more.

    For a polynomial that is the rational fit as `auto` would take it; none where lines are too few for its windows.
    """
    if spec.method == "local_rational":
        return [(model, fits.taken < i) for i, model in enumerate(fits.models) if i]
    rational = replace(spec, method="local_rational", local_order="auto")
    ladder = _ladder(rational, len(first.inputs), transient=True)
    try:
        where = _windows(lines, ladder[-1], rational, first, signals, every)
    except DataError:
        return []
    return [(fit_ladder(*signals, where, ladder).chosen, np.ones(len(where.index), dtype=np.bool_))]


def _with_model_error(
    G: ComplexArray,
    total: Covariance,
    richer: Sequence[tuple[LocalFit, BoolArray]],
    spectra: Sequence[SettledSpectra],
    closed: bool,
    usable: BoolArray,
) -> Covariance:
    """The total covariance of G at the usable lines with the error of its model, as richer ones show it.

    A difference of 0 carries no information.  Outputs are widened as a whole, by the mean over their inputs, so that
    their correlations stay.
    """
    error = np.zeros(G.shape)
    for fit, has_more in richer:
        compared = usable & has_more & separates_inputs(fit, closed, G.shape[1])
        if not compared.any():
            continue
        on, other = compared[usable], fitted_response(fit, spectra, closed, compared)
        difference, variance = np.zeros(G.shape, dtype=np.complex128), np.zeros(G.shape)
        difference[on], variance[on] = G[on] - other.G, other.total.variance
        is_informative = variance <= LIMITS.variance_ratio * total.variance
        difference = np.where(is_informative, difference, 0.0)
        both = total.variance + np.where(is_informative, variance, 0.0)
        ratio = np.divide(np.abs(difference) ** 2, both, out=np.zeros(both.shape), where=both > 0)
        g = local_mean(ratio)
        error = np.maximum(error, np.where(g > LIMITS.ratio, (g - 1) * both, 0.0))
    relative = np.divide(error, total.variance, out=np.zeros(error.shape), where=total.variance > 0)
    factor = np.sqrt(1 + relative.mean(axis=2))
    right = None if total.right is None else factor[:, :, None] * total.right * factor[:, None, :]
    return replace(total, variance=total.variance * factor[:, :, None] ** 2, right=right)


def _windows(
    lines: IntArray,
    terms: WindowTerms,
    spec: EstimatorSpec,
    first: Record,
    signals: tuple[ComplexArray, ComplexArray],
    every: slice,
) -> Windows:
    """Windows around lines[every] for Z (E, F, n_z) and R (E, F, n_u) at lines (F,); DataError where these are too few.

    Where each experiment has a transient of its own, only different excitations separate the response from it.
    """
    Z, R = signals
    dof = max(len(first.outputs) + LIMITS.margin_dof, LIMITS.dof)
    E = independent_excitations(R, terms.width(dof, 1, Z.shape[2])) if terms.transient else len(Z)
    n_w = terms.width(dof, E, Z.shape[2])
    if n_w > len(lines):
        raise DataError(
            f"configuration {first.configuration.name}: {spec.method} needs {n_w} lines in a window, "
            f"{len(lines)} are excited; widen band_hz, measure more experiments, or take a longer period or record"
        )
    return windows(lines, lines[every], max(n_w, min(_step(spec, first), len(lines))))


def _step(spec: EstimatorSpec, first: Record) -> int:
    """DFT lines from one line of G to the next: 1 for records with a period."""
    if spec.resolution_hz is None or first.is_periodic:
        return 1
    return max(1, round(spec.resolution_hz * first.period_samples / first.rate_hz))


def _refuse_dead_inputs(first: Record, spectra: Sequence[SettledSpectra]) -> None:
    """DataError where an input stands out of its noise at too few lines, whatever the reference was."""
    n_y = len(first.outputs)
    signal = np.sum([np.abs(spectrum.U) ** 2 for spectrum in spectra], axis=0)
    noise = np.sum([power(spectrum.noise)[:, n_y:] for spectrum in spectra], axis=0)
    clear = signal > LIMITS.input_snr * noise
    for i in np.flatnonzero(clear.mean(axis=0) < LIMITS.excited_share):
        raise DataError(
            f"configuration {first.configuration.name}: input {first.inputs[i]} is 10 dB above its noise at "
            f"{int(clear[:, i].sum())} of {len(clear)} lines only: it was not excited, so that its column of G cannot "
            "be estimated; check its channel, or raise its torque"
        )


def _ladder(spec: EstimatorSpec, n_u: int, transient: bool) -> list[WindowTerms]:
    """The models for a line: one polynomial; or polynomial and rational of one order less, and rational."""
    d = spec.local_order
    if spec.method == "local_polynomial":
        return [WindowTerms(n_u, 2 if d == "auto" else d, 0, transient)]
    d = 3 if d == "auto" else d
    orders = [(d - 1, 0), (d - 1, d - 1), (d, d)] if d > 1 else [(1, 0), (1, 1)]
    return [WindowTerms(n_u, order, poles, transient) for order, poles in orders]
