"""Frequency responses from records, with or without a period: G (F, n_y, n_u) with its covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, IntArray
from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.frf.checks import (
    channel_notes,
    left_out_note,
    refuse_few_experiments,
    refuse_mismatch,
    refuse_single_period,
    same_phases_notes,
    separated_lines,
)
from elastid.frf.covariance import (
    distortion_covariance,
    equation_error,
    form_notes,
    kronecker,
    noise_covariance,
    total_covariance,
    total_error,
)
from elastid.frf.distortion import Detected, detect, detection_lines, fast_total_error
from elastid.frf.experiment_blocks import MeanSpectra, gather_spectra
from elastid.frf.friction_bias import friction_bias
from elastid.frf.lines import analysed_lines, lines_are_known
from elastid.frf.local.response import local_response
from elastid.frf.matrices import power
from elastid.frf.methods import METHODS, Estimate
from elastid.frf.period_selection import TRANSIENT_LEFT_OUT, TotalError
from elastid.frf.quality import input_notes, measured_quality, measured_response, output_notes
from elastid.frf.spec import EstimatorSpec, Method
from elastid.frf.spectra import RecordSpectra, refuse_uncomputable
from elastid.frf.welch import welch_response
from elastid.record import Record
from elastid.response import FrequencyResponse

WELCH = ("h1", "h2", "hv")
LOCAL = ("local_polynomial", "local_rational")


def response_without_period(records: Sequence[Record], spec: EstimatorSpec) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration from its records without a period, each a realisation.

    Raises StudyError where the spec asks for periods, DataError where the records do not suffice.
    """
    _refuse_periods(records, spec)
    for record in records:
        refuse_uncomputable(record)
    method, notes = choose_without_period(records, spec)
    spec = replace(spec, method=method, transient_periods="auto")
    if method in WELCH:
        response = welch_response(records, spec)
    else:
        records, cut = _of_one_length(records)
        notes = (*notes, *cut)
        response = local_response(records, replace(spec, lines="full"))
    return replace(response, notes=(*notes, *response.notes, *channel_notes(response)))


def choose_without_period(records: Sequence[Record], spec: EstimatorSpec) -> tuple[Method, tuple[Note, ...]]:
    """The method that the spec names; for `auto` a local one, or h1 for long records, with the reason as a note."""
    if spec.method != "auto":
        return spec.method, ()
    first = records[0]
    shortest = min(record.n_samples for record in records)
    band_hz = spec.band_hz or (0.0, first.rate_hz / 2)
    count = len(grid_lines("full", band_hz, first.rate_hz, shortest))
    known = all(record.r is not None for record in records)
    method: Method
    # More lines take a local method over half a minute for one input.
    if count > 50_000 and spec.resolution_hz is None and not known:
        method = "h1"
        reason = f"a local method would fit {count} lines, and records so long leave many segments"
    else:
        method = "local_rational"
        reason = "it needs no period, and a start from rest is part of its model, which segments take for noise"
        if known:
            reason += "; by the reference r, so that noise in the loop biases nothing"
    text = f"estimator.method auto takes {method}: the records have no period; {reason}"
    return method, (Note("method-chosen", text, severity="information"),)


def _refuse_periods(records: Sequence[Record], spec: EstimatorSpec) -> None:
    """StudyError for a method, lines or a transient that only records with a period have."""
    name = records[0].name
    if spec.method not in ("auto", *LOCAL, *WELCH):
        raise StudyError(
            f"record {name} has no period, which estimator.method {spec.method} needs; take auto, local_rational, "
            "local_polynomial, h1, h2 or hv, or state the period of the record where it has one"
        )
    if spec.lines in ("odd", "excited"):
        raise StudyError(
            f"record {name} has no period, and so no lines that are {spec.lines}; take estimator.lines full, and "
            "band_hz for the band that was excited"
        )
    if spec.transient_periods not in ("auto", 0):
        raise StudyError(
            f"record {name} has no period, so that transient_periods {spec.transient_periods} has no meaning; leave "
            "the key out, and cut the start of the file with samples: [first, last]"
        )


def _of_one_length(records: Sequence[Record]) -> tuple[Sequence[Record], tuple[Note, ...]]:
    """The records cut to the shortest, since a local method compares them line by line, and a note on it."""
    lengths = np.array([record.n_samples for record in records])
    n = int(lengths.min())
    if np.all(lengths == n):
        return records, ()
    first = records[0]
    where = f"configuration {first.configuration.name}"
    seconds = f"{n / first.rate_hz:g} to {lengths.max() / first.rate_hz:g} s"
    if n < 0.5 * lengths.max():
        raise DataError(
            f"{where}: its records last {seconds}, and a local method needs one length: cut them with "
            "samples: [first, last], or take estimator.method h1"
        )
    text = f"records of {seconds} are cut to the shortest, since a local method compares them line by line"
    return [_cut(record, n) for record in records], (Note("records-cut", text, where),)


def _cut(record: Record, n: int) -> Record:
    r = None if record.r is None else record.r[:n]
    return replace(record, u=record.u[:n], y=record.y[:n], r=r, period_samples=n)


def estimate(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None
) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration with its covariances and quality, from all of its records.

    Records are grouped by realisation; a mean over realisations needs as many experiments of each as there are inputs,
    other methods as many in all, local ones a single one.  planned_lines: the excited DFT lines where a plan states
    them.  total is None for one realisation, unless odd lines were left out on purpose.  Notes report the periods and
    lines left out, and signs of a faulty measurement.  Records without a period: `without_period`.

    Raises DataError where the records do not fit together, the experiments do not separate the inputs, or no line is
    excited.
    """
    refuse_mismatch(records)
    if not records[0].is_periodic:
        return _placed(response_without_period(records, spec))
    groups = _realisations(records)
    method, reason = choose_method(spec, groups)
    if method in LOCAL:
        for record in records:
            refuse_uncomputable(record)
        response = local_response(records, replace(spec, method=method), planned_lines)
        return _placed(replace(response, notes=(*reason, *response.notes)))
    refuse_single_period(records, method)
    refuse_few_experiments(groups, method)
    return _placed(_from_periods(groups, spec, method, reason, planned_lines))


def _placed(response: FrequencyResponse) -> FrequencyResponse:
    """The same with the configuration as the place of every note that has none."""
    place = f"configuration {response.configuration.name}"
    return replace(response, notes=tuple(note if note.place else replace(note, place=place) for note in response.notes))


def _from_periods(
    groups: Sequence[Sequence[Record]],
    spec: EstimatorSpec,
    method: str,
    reason: tuple[Note, ...],
    planned_lines: IntArray | None,
) -> FrequencyResponse:
    """By a mean over realisations, or a method that pools them: each line on its own, from its periods."""
    first = groups[0][0]
    known = lines_are_known(spec, planned_lines)
    spectra = [[RecordSpectra(r) if known else RecordSpectra(r).with_driver() for r in group] for group in groups]
    lines = analysed_lines([record_spectra for group in spectra for record_spectra in group], spec, planned_lines)
    detection = detection_lines(lines, first.half_wave)
    everything = _gathered(spectra, lines, detection, spec, method)
    excited = np.isin(np.union1d(lines, detection), lines)
    data = everything.on(excited)
    notes = [*reason, *(note for group in groups for record in group for note in record.notes), *data.notes]
    usable = separated_lines(data.blocks, groups, method)
    if not usable.all():
        notes.append(left_out_note(lines[~usable], usable.any(), first))
    data = data.on(usable)
    notes += same_phases_notes(data.blocks, groups)
    fitted = _estimate(method, data, first)
    freq_hz = line_frequencies(lines[usable], first.rate_hz, first.period_samples)
    quality = measured_quality(freq_hz, data, fitted.G)
    response = measured_response(first, spec.quantity, freq_hz, fitted.G, quality=quality)
    lines = lines[usable]
    inside, levels = (detection > lines[0]) & (detection < lines[-1]), None
    if inside.any():
        unexcited = everything.on(~excited).on(inside)
        levels = detect(detection[inside], lines, freq_hz[0] / lines[0], fitted.G, unexcited)
    response, of_form = _with_covariances(response, data, fitted, levels, lines, spectra)
    notes += [*fitted.notes, *of_form, *input_notes(first.inputs, data, quality), *output_notes(first.outputs, quality)]
    return replace(response, notes=(*notes, *channel_notes(response)))


def _gathered(
    spectra: Sequence[Sequence[RecordSpectra]], lines: IntArray, detection: IntArray, spec: EstimatorSpec, method: str
) -> MeanSpectra:
    """Mean spectra; where transients were left out and realisations scatter, again with those that do not matter."""

    def gather(total: TotalError | None) -> MeanSpectra:
        return gather_spectra(spectra, lines, detection, spec, with_reference=method == "joint", total=total)

    everything = gather(None)
    if len(spectra) < 2 or not any(note.code == TRANSIENT_LEFT_OUT for note in everything.notes):
        return everything
    groups = [[record_spectra.record for record_spectra in group] for group in spectra]
    data = everything.on(np.isin(np.union1d(lines, detection), lines))
    usable = separated_lines(data.blocks, groups, method)
    if not usable.any():
        return everything
    data = data.on(usable)
    fitted = _estimate(method, data, groups[0][0])
    error = total_error(data, fitted)
    if error is None:
        return everything
    return gather(TotalError(fitted.G, power(error[0]) / len(groups), usable))


def _estimate(method: str, data: MeanSpectra, first: Record) -> Estimate:
    """G by the method and its weights; DataError where it must invert a singular matrix."""
    try:
        return METHODS[method](data.blocks, data.scatter)
    except np.linalg.LinAlgError as error:
        raise DataError(
            f"configuration {first.configuration.name}: estimator.method {method} finds a singular matrix at some "
            f"line: an output of {', '.join(first.outputs)} does not move on its own, or the units of inputs and "
            "outputs are too far apart; check these channels, or take arithmetic"
        ) from error


def choose_method(spec: EstimatorSpec, groups: Sequence[Sequence[Record]]) -> tuple[Method, tuple[Note, ...]]:
    """The method that the spec names; for `auto` the one for closed-loop robot data, with the reason as a note."""
    if spec.method != "auto":
        return spec.method, ()
    n_u, total = len(groups[0][0].inputs), sum(map(len, groups))
    method: Method
    if total < n_u:
        method = "local_rational"
        reason = f"{total} experiments separate {n_u} inputs only with the help of neighbouring lines"
    elif any(len(group) < n_u for group in groups):
        known = all(record.r is not None for group in groups for record in group)
        method = "joint" if known else "errors_in_variables"
        reason = (
            "over all realisations together, since a single one has fewer experiments than inputs and so no response "
            "to be averaged, and h1 is biased by the noise and friction that feedback brings into u"
        )
    else:
        method = "arithmetic"
        reason = (
            "each realisation keeps its pairing of torque and motion, while noise and friction in the loop bias h1; "
            "the harmonic mean fails where friction sticks, and the logarithmic one agrees with the arithmetic one"
        )
    text = f"estimator.method auto takes {method}: {reason}"
    return method, (Note("method-chosen", text, severity="information"),)


def _realisations(records: Sequence[Record]) -> list[list[Record]]:
    """Records by realisation, in the order of their experiments."""
    groups: dict[int, list[Record]] = {}
    for record in sorted(records, key=lambda record: (record.realisation, record.experiment)):
        groups.setdefault(record.realisation, []).append(record)
    return list(groups.values())


def _with_covariances(
    response: FrequencyResponse,
    data: MeanSpectra,
    fitted: Estimate,
    levels: Detected | None,
    lines: IntArray,
    spectra: Sequence[Sequence[RecordSpectra]],
) -> tuple[FrequencyResponse, list[Note]]:
    """Noise, total, distortion and bias of G, and the nonlinear levels in the outputs."""
    blocks, C_V = data.blocks, equation_error(data.scatter, fitted.G)
    noise = noise_covariance(blocks, fitted, C_V, data.scatter.dof)
    of_noise = C_V * np.mean(1 / data.periods)
    error: tuple[ComplexArray, float] | None = total_error(data, fitted)
    total, distortion, stochastic, bias = None, None, None, None
    if error is not None:
        total = total_covariance(blocks, fitted, *error)
    elif levels is not None:
        error = fast_total_error(levels, lines, of_noise, data.scatter.dof)
        total = None if error is None else kronecker(fitted.left, *error)
    if total is not None and error is not None:
        bias = friction_bias(spectra, lines, fitted.G, response.quantity, error[0], of_noise, error[1])
        distortion = distortion_covariance(noise, total, len(blocks))
        stochastic = np.sqrt(power(error[0] - of_noise))
    assert response.quality is not None
    even, odd = (None, None) if levels is None else (levels.even, levels.odd)
    quality = replace(response.quality, stochastic=stochastic, even=even, odd=odd)
    covariances = replace(response, noise=noise, total=total, distortion=distortion, quality=quality, bias=bias)
    return covariances, form_notes(noise, total)
