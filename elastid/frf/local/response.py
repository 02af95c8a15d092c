r"""Frequency responses by local polynomial and local rational methods: one experiment of all inputs is enough.

Open loop (no reference in the records): the local model leads from U to Y.  Closed loop: from the reference R, which
is free of noise, to Z = [Y; U], and

.. math:: G = G_{yr} G_{ur}^{-1}, \qquad dG = [I, -G]\, dG_{zr}\, G_{ur}^{-1}

to first order, so that the noise that feedback brings into U does no harm.  All experiments and realisations of a
configuration enter one regression.  Its residual holds noise and stochastic nonlinear distortion: their sum is
`total`; `noise` is what the bins between the excited ones show.
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
from elastid.frf.lines import analysed_lines, described_lines
from elastid.frf.local.bandwidth import local_modes, wide_windows
from elastid.frf.local.least_squares import LocalFit
from elastid.frf.local.regression import local_fit
from elastid.frf.local.transient import SettledSpectra, settled_spectra
from elastid.frf.local.windows import WindowTerms, windows
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra
from elastid.record import Record
from elastid.response import Covariance, FrequencyResponse

# Degrees of freedom with which a variance is worth having: its standard deviation is 40 %.
_LEAST_DOF = 6
# The regressors of a line have no more digits in common than these.
_WORST_CONDITION = 1e9
# An input that is so far above its noise (power) at fewer lines than this part was not excited.
_CLEAR = 10.0
_LEAST_SHARE = 0.05


def local_response(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None
) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration with noise and total covariance, from one experiment of all inputs or more.

    Transients are removed where bins between the excited ones show them, else fitted along; `transient_periods` that
    a study states are left out all the same.  noise is None where only the excited lines are there.

    Raises DataError where the lines are too few or the experiments do not tell the inputs apart.
    """
    first = records[0]
    for record in records:
        _refuse_gaps(record)
    lines = analysed_lines([RecordSpectra(record) for record in records], spec, planned_lines)
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    spectra = [settled_spectra(record, lines, spec.quantity, dropped) for record in records]
    _refuse_dead_inputs(first, spectra)
    closed = all(each.R is not None for each in spectra)
    ladder = _ladder(spec, len(first.inputs), transient=not all(each.settled for each in spectra))
    terms = ladder[-1]
    Z, R = _signals(spectra, closed)
    dof = max(len(first.outputs) + spec.local_margin, _LEAST_DOF)
    n_w = terms.width(dof, len(records), Z.shape[2])
    if n_w > len(lines):
        raise DataError(
            f"configuration {first.configuration.name}: {spec.method} needs {n_w} lines in a window, "
            f"{len(lines)} are excited; measure more experiments or take a longer period"
        )
    where = windows(lines, lines, n_w)
    fit = local_fit(Z, R, where, ladder)
    usable = fit.condition < _WORST_CONDITION
    if closed:
        usable &= _condition(fit.B[:, len(first.outputs) :]) < _WORST_CONDITION
    notes = [note for record in records for note in record.notes]
    where_at = f"configuration {first.configuration.name}"
    if not usable.any():
        raise DataError(
            f"{where_at}: {spec.method} cannot tell the {terms.n_u} inputs ({', '.join(first.inputs)}) apart at any "
            "line; is one of them not excited, or do two move in proportion? Give each its own random phases"
        )
    if not usable.all():
        notes.append(
            Note(
                "lines-left-out",
                f"lines {described_lines(lines[~usable], first)} are left out: inputs move in proportion",
                where_at,
            )
        )
    G, noise, total = _responses(fit, spectra, closed, usable)
    freq_hz = line_frequencies(lines[usable], first.rate_hz, first.period_samples)
    span_hz = line_frequencies(where.span[usable], first.rate_hz, first.period_samples)
    notes.append(
        Note(
            "local-method",
            f"{spec.method} of order {terms.order} in windows of {n_w} lines ({np.median(span_hz):.3g} "
            f"{'Hz' if first.rate_is_known else 'of the sampling rate'}), {fit.dof:.3g} degrees of freedom",
            severity="information",
        )
    )
    notes += [
        replace(note, place=where_at)
        for note in wide_windows(local_modes(freq_hz, G, total.variance), freq_hz, span_hz, terms.poles)
    ]
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
        notes=tuple(notes),
    )


def _refuse_gaps(record: Record) -> None:
    """DataError for a record of which periods do not count: a local method takes it as one piece."""
    if record.left_out:
        periods = ", ".join(str(period + 1) for period in record.left_out)
        raise DataError(
            f"record {record.name}: of period {periods} too much is missing, and a local method takes a record as one "
            "piece; cut it with samples: [first, last], or take another estimator.method"
        )


def _refuse_dead_inputs(first: Record, spectra: Sequence[SettledSpectra]) -> None:
    """DataError where an input stands out of its noise at hardly any line, whatever the reference was."""
    n_y = len(first.outputs)
    power = np.sum([np.abs(each.U) ** 2 for each in spectra], axis=0)
    noise = np.sum([_diagonal(each.noise)[:, n_y:] for each in spectra], axis=0)
    clear = power > _CLEAR * noise
    for i in np.flatnonzero(clear.mean(axis=0) < _LEAST_SHARE):
        raise DataError(
            f"configuration {first.configuration.name}: input {first.inputs[i]} is 10 dB above its noise at "
            f"{int(clear[:, i].sum())} of {len(clear)} lines only: it was not excited, so that no column of G can be "
            "had for it; check its channel, or raise its torque"
        )


def _condition(B: ComplexArray) -> FloatArray:
    """Condition (F,) of B (F, n, n), each row relative to its RMS over all lines."""
    rms = np.sqrt(np.mean(np.abs(B) ** 2, axis=(0, 2)))
    condition: FloatArray = np.linalg.cond(B / np.where(rms > 0, rms, 1.0)[:, None])
    return condition


def _ladder(spec: EstimatorSpec, n_u: int, transient: bool) -> list[WindowTerms]:
    """The models that lines may take: one polynomial, or polynomial and rational of one order less, and rational."""
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
    """G at the usable lines, the covariance that noise explains, and the total one that the residual shows."""
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
    C_total = of_fit @ (fit.scatter[usable] / fit.dof) @ _H(of_fit)
    total = _covariance(left, C_total, fit.dof, poles)
    if not all(each.settled for each in spectra):
        return G, None, total
    dof = sum(each.dof for each in spectra)
    C_Z = np.sum([each.noise[usable] * (each.dof * each.n_periods / dof) for each in spectra], axis=0)
    C_noise = N @ C_Z @ _H(N)
    # The part of cov(A) that noise explains, by its share in the total.
    share = np.einsum("fyy->f", C_noise).real / np.maximum(np.einsum("fyy->f", C_total).real, 1e-300)
    return G, _covariance(left, C_noise, dof, (M, fit.A_cov[usable] * share[:, None, None])), total


def _covariance(
    left: ComplexArray, right: ComplexArray, dof: float, poles: tuple[ComplexArray, ComplexArray]
) -> Covariance:
    r"""left (x) right plus what the uncertain poles add, in Kronecker form: right takes it, seen through left.

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
        right = right + weighted @ middle.reshape(len(M), d * n_u, d * n_u) @ _H(weighted) / n_u
    variance = _diagonal(right)[:, :, None] * _diagonal(left)[:, None, :]
    return Covariance(variance, dof) if right.shape[1] > dof else Covariance(variance, dof, left, right)


def _diagonal(A: ComplexArray) -> FloatArray:
    diagonal: FloatArray = np.maximum(np.einsum("fii->fi", A).real, 0.0)
    return diagonal


def _H(A: ComplexArray) -> ComplexArray:
    adjoint: ComplexArray = np.swapaxes(A, -1, -2).conj()
    return adjoint
