r"""Frequency responses by local polynomial and local rational methods: one experiment of all inputs is enough.

Open loop (no reference in the records): the local model leads from U to Y.  Closed loop: from the reference R, which
is free of noise, to Z = [Y; U], and

.. math:: G = G_{yr} G_{ur}^{-1}, \qquad dG = [I, -G]\, dG_{zr}\, G_{ur}^{-1}

to first order, so that the noise that feedback brings into U causes no bias.  All experiments and realisations of a
configuration enter one regression.  Its residual holds noise and stochastic nonlinear distortion: their sum is
`total`; `noise` comes from the bins between the excited ones.
(Pintelon, Schoukens, Vandersteen and Barbe, MSSP 24, 2010, parts I and II.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.excitation.grids import line_frequencies
from elastid.frf.covariance import kronecker
from elastid.frf.lines import analysed_lines, described_lines
from elastid.frf.local.bandwidth import local_modes, wide_windows
from elastid.frf.local.least_squares import LocalFit
from elastid.frf.local.model_error import with_model_error
from elastid.frf.local.regression import local_fit
from elastid.frf.local.repeats import independent_excitations, merge_repeats
from elastid.frf.local.transient import SettledSpectra, settled_spectra
from elastid.frf.local.windows import Windows, WindowTerms, windows
from elastid.frf.matrices import adjoint, power
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra
from elastid.record import Record
from elastid.response import Covariance, FrequencyResponse

# Degrees of freedom of a useful variance, at least: its standard deviation is then 40 %.
_MIN_DOF = 6
# Condition of the regressors of a line, at most.
_MAX_CONDITION = 1e9
# An excited input is so far above its noise (power, 10 dB) at this part of the lines at least.
_MIN_INPUT_SNR = 10.0
_MIN_EXCITED_SHARE = 0.05


def local_response(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None
) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration with noise and total covariance, from one experiment of all inputs or more.

    Transients are removed where bins between the excited ones show them, else fitted along; `transient_periods` of the
    spec are left out in any case.  noise is None where only the excited lines are there.

    Raises DataError where the lines are too few or the experiments do not separate the inputs.
    """
    first = records[0]
    for record in records:
        _refuse_gaps(record)
    all_lines = analysed_lines([RecordSpectra(record) for record in records], spec, planned_lines)
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    spectra = [settled_spectra(record, all_lines, spec.quantity, dropped) for record in records]
    _refuse_dead_inputs(first, spectra)
    closed = all(each.R is not None for each in spectra)
    spectra, repeated = merge_repeats(spectra, closed), len(spectra)
    ladder = _ladder(spec, len(first.inputs), transient=not all(each.settled for each in spectra))
    Z, R = _signals(spectra, closed)
    where = _windows(all_lines, ladder[-1], spec, first, (Z, R))
    fit = local_fit(Z, R, where, ladder)
    usable = _usable_lines(fit, closed, spec, first)
    lines = all_lines[_every(_step(spec, first))]
    G, noise, total = _responses(fit, spectra, closed, usable)
    if ladder[-1].transient and spec.method == "local_polynomial":
        total = _with_model_error(G, total, spectra, (Z, R), all_lines, usable, spec, first)
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
    notes.append(_method_note(spec, ladder[-1], where, span_hz, fit, first))
    notes += wide_windows(local_modes(freq_hz, G, total.variance), freq_hz, span_hz, ladder[-1].poles)
    return FrequencyResponse(
        freq_hz=freq_hz,
        G=G,
        inputs=first.inputs,
        outputs=first.outputs,
        quantity=spec.quantity,
        configuration=first.configuration,
        noise=noise,
        total=total,
        rate_is_known=first.rate_is_known,
        sliding=first.sliding,
        input_units=first.input_units,
        notes=tuple(notes),
    )


def _with_model_error(
    G: ComplexArray,
    total: Covariance,
    spectra: Sequence[SettledSpectra],
    signals: tuple[ComplexArray, ComplexArray],
    lines: IntArray,
    usable: BoolArray,
    spec: EstimatorSpec,
    first: Record,
) -> Covariance:
    """The total covariance with the error of the polynomial model; as it is where lines are too few for a rational."""
    rational = replace(spec, method="local_rational", local_order="auto")
    ladder = _ladder(rational, len(first.inputs), transient=True)
    try:
        where = _windows(lines, ladder[-1], rational, first, signals)
    except DataError:
        return total
    fit = local_fit(*signals, where, ladder)
    if not np.all(fit.condition[usable] < _MAX_CONDITION):
        return total
    other, _, variance = _responses(fit, spectra, bool(signals[0].shape[2] > G.shape[1]), usable)
    return with_model_error(total, G - other, variance.variance)


def _windows(
    lines: IntArray, terms: WindowTerms, spec: EstimatorSpec, first: Record, signals: tuple[ComplexArray, ComplexArray]
) -> Windows:
    """The windows around the lines (F,) for Z (E, F, n_z) and R (E, F, n_u); DataError where there are too few lines.

    Where each experiment has a transient of its own, only different excitations tell the response from it.
    """
    Z, R = signals
    dof = max(len(first.outputs) + spec.local_margin, _MIN_DOF)
    E = independent_excitations(R, terms.width(dof, 1, Z.shape[2])) if terms.transient else len(Z)
    n_w = terms.width(dof, E, Z.shape[2])
    if n_w > len(lines):
        raise DataError(
            f"configuration {first.configuration.name}: {spec.method} needs {n_w} lines in a window, "
            f"{len(lines)} are excited; widen band_hz, measure more experiments, or take a longer period or record"
        )
    step = _step(spec, first)
    return windows(lines, lines[_every(step)], max(n_w, min(step, len(lines))))


def _step(spec: EstimatorSpec, first: Record) -> int:
    """DFT lines from one line of G to the next: 1 for records with a period."""
    if spec.resolution_hz is None or first.is_periodic:
        return 1
    return max(1, round(spec.resolution_hz * first.period_samples / first.rate_hz))


def _every(step: int) -> slice:
    """Every step-th line, each in the middle of its neighbours."""
    return slice((step - 1) // 2, None, step)


def _usable_lines(fit: LocalFit, closed: bool, spec: EstimatorSpec, first: Record) -> BoolArray:
    """Flags (F,) of the lines with separate inputs; DataError where there is none."""
    usable = fit.condition < _MAX_CONDITION
    if closed:
        usable &= _condition(fit.B[:, len(first.outputs) :]) < _MAX_CONDITION
    if not usable.any():
        raise DataError(
            f"configuration {first.configuration.name}: {spec.method} cannot separate the {len(first.inputs)} inputs "
            f"({', '.join(first.inputs)}) at any line: one of them was not excited, or two move in proportion; give "
            "each its own random phases"
        )
    return usable


def _method_note(
    spec: EstimatorSpec, terms: WindowTerms, where: Windows, span_hz: FloatArray, fit: LocalFit, first: Record
) -> Note:
    unit = "Hz" if first.rate_is_known else "of the sampling rate"
    text = (
        f"{spec.method} of order {terms.order} in windows of {where.index.shape[1]} lines ({np.median(span_hz):.3g} "
        f"{unit}), {fit.dof:.3g} degrees of freedom"
    )
    return Note("local-method", text, severity="information")


def _refuse_gaps(record: Record) -> None:
    """DataError for a record with periods that do not count: a local method takes it as one piece."""
    if record.left_out:
        periods = ", ".join(str(period + 1) for period in record.left_out)
        raise DataError(
            f"record {record.name}: too many samples of period {periods} are missing, and a local method takes a "
            "record as one piece; cut it with samples: [first, last], or take another estimator.method"
        )


def _refuse_dead_inputs(first: Record, spectra: Sequence[SettledSpectra]) -> None:
    """DataError where an input stands out of its noise at too few lines, whatever the reference was."""
    n_y = len(first.outputs)
    signal = np.sum([np.abs(each.U) ** 2 for each in spectra], axis=0)
    noise = np.sum([power(each.noise)[:, n_y:] for each in spectra], axis=0)
    clear = signal > _MIN_INPUT_SNR * noise
    for i in np.flatnonzero(clear.mean(axis=0) < _MIN_EXCITED_SHARE):
        raise DataError(
            f"configuration {first.configuration.name}: input {first.inputs[i]} is 10 dB above its noise at "
            f"{int(clear[:, i].sum())} of {len(clear)} lines only: it was not excited, so that its column of G cannot "
            "be estimated; check its channel, or raise its torque"
        )


def _condition(B: ComplexArray) -> FloatArray:
    """Condition (F,) of B (F, n, n), each row relative to its RMS over all lines."""
    rms = np.sqrt(np.mean(np.abs(B) ** 2, axis=(0, 2)))
    return np.asarray(np.linalg.cond(B / np.where(rms > 0, rms, 1.0)[:, None]))


def _ladder(spec: EstimatorSpec, n_u: int, transient: bool) -> list[WindowTerms]:
    """The models for a line: one polynomial; or polynomial and rational of one order less, and rational."""
    d = spec.local_order
    if spec.method == "local_polynomial":
        return [WindowTerms(n_u, 2 if d == "auto" else d, 0, transient)]
    d = 3 if d == "auto" else d
    orders = [(d - 1, 0), (d - 1, d - 1), (d, d)] if d > 1 else [(1, 0), (1, 1)]
    return [WindowTerms(n_u, order, poles, transient) for order, poles in orders]


def _signals(spectra: Sequence[SettledSpectra], closed: bool) -> tuple[ComplexArray, ComplexArray]:
    """Z (E, F, n_z) and R (E, F, n_u), each record times sqrt(P): then noise is that of one period in all of them."""
    Z, R = [], []
    for each in spectra:
        weight = np.sqrt(each.n_periods)
        Z.append(weight * (np.concatenate([each.Y, each.U], axis=1) if each.R is not None and closed else each.Y))
        R.append(weight * (each.R if each.R is not None and closed else each.U))
    return np.stack(Z), np.stack(R)


def _responses(
    fit: LocalFit, spectra: Sequence[SettledSpectra], closed: bool, usable: BoolArray
) -> tuple[ComplexArray, Covariance | None, Covariance]:
    """G at the usable lines, its covariance by noise, and the total one from the residual."""
    n_y = spectra[0].Y.shape[1]
    B = fit.B[usable]
    F, _, n_u = B.shape
    inverse = np.linalg.inv(B[:, n_y:]) if closed else np.broadcast_to(np.eye(n_u), (F, n_u, n_u))
    G = B[:, :n_y] @ inverse
    N = np.concatenate([np.broadcast_to(np.eye(n_y), (F, n_y, n_y)), -G], axis=2)
    left = np.swapaxes(inverse, 1, 2) @ fit.left[usable] @ inverse.conj()
    of_fit = N if closed else N[:, :, :n_y]
    M = of_fit[:, None] @ fit.M[usable] @ inverse[:, None]
    poles = (M, fit.A_cov[usable])
    C_total = of_fit @ (fit.scatter[usable] / fit.dof) @ adjoint(of_fit)
    total = _covariance(left, C_total, fit.dof, poles)
    if not all(each.settled for each in spectra):
        return G, None, total
    dof = sum(each.dof for each in spectra)
    C_Z = np.sum([each.noise[usable] * (each.dof * each.n_periods / dof) for each in spectra], axis=0)
    C_noise = N @ C_Z @ adjoint(N)
    # The part of cov(A) that noise explains, by its share in the total.
    share = np.einsum("fyy->f", C_noise).real / np.maximum(np.einsum("fyy->f", C_total).real, 1e-300)
    return G, _covariance(left, C_noise, dof, (M, fit.A_cov[usable] * share[:, None, None])), total


def _covariance(
    left: ComplexArray, right: ComplexArray, dof: float, poles: tuple[ComplexArray, ComplexArray]
) -> Covariance:
    r"""left (x) right plus the share of the uncertain poles, in Kronecker form: it is added to right.

    .. math:: right + \frac{1}{n_u} \sum_{pq} A_{pq} M_p\, left^{-T} M_q^H

    Exact for one input; for more the trace after whitening by left is kept.  The diagonal alone where there are fewer
    degrees of freedom than outputs.
    """
    M, A_cov = poles
    n_u = left.shape[1]
    if M.shape[1]:
        weighted = np.swapaxes(M, 1, 2).reshape(len(M), M.shape[2], -1)
        middle = np.einsum("fpq,fuv->fpuqv", A_cov, np.swapaxes(np.linalg.inv(left), 1, 2))
        d = A_cov.shape[1]
        right = right + weighted @ middle.reshape(len(M), d * n_u, d * n_u) @ adjoint(weighted) / n_u
    return kronecker(left, right, dof)
