r"""Frequency responses from records, with or without a period: G (F, n_y, n_u) with its covariances.

The response also contains the motion of the motors in these records, with the feedback of their controllers,

.. math:: u - r = -\Big( \frac{F_0}{s} + F_1 + F_2 s \Big) q_m

estimated by least squares at all lines with motion if r was recorded, else at lines between the excited ones, where r
is 0. The model covers PD and PID controllers and the cascades of robots.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError, Note, StudyError, notes_of
from elastid.base.fourier import real_dft
from elastid.base.matrices import power, squared_magnitude
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.frf.automatic import LIMITS as AUTOMATIC
from elastid.frf.automatic import choose_by_error, may_have_transient, method_choice, within_excitation
from elastid.frf.checks import (
    check_consistency,
    check_number_of_periods,
    hit_notes,
    inconsistency_notes,
    repeated_phase_notes,
    scatter_notes,
    separable_lines,
)
from elastid.frf.distortion import DetectionLines, detect, detection_lines, fast_total_error, friction_bias
from elastid.frf.estimators import (
    METHODS,
    Estimate,
    averaging_lines,
    equation_error,
    kronecker,
    noise_covariance,
    total_covariance,
    total_error,
)
from elastid.frf.experiment_blocks import MeanSpectra, gather_spectra
from elastid.frf.lines import analysed_lines
from elastid.frf.local.response import local_response
from elastid.frf.moved_sensors import by_outputs, stack_outputs
from elastid.frf.quality import (
    described_lines,
    discarded_lines_note,
    input_notes,
    measured_quality,
    measured_response,
    output_notes,
)
from elastid.frf.spec import EstimatorSpec, Method
from elastid.frf.spectra import RecordSpectra
from elastid.frf.welch import welch_response
from elastid.record import MOTION_ORDER, Record
from elastid.response import MotorMotion, Response

LOCAL = ("local_polynomial", "local_rational")
MAX_AVERAGING_LINES = 1024  # number of lines for the estimation of `averaging_lines`
_MIN_LINE_FRACTION = 1e-5  # power of a line relative to the motion, below which it is neglected
_MIN_RECORDS = 6  # number of records from which the motion is computed, if there are more
_MAX_LINES = 128  # number of lines of the motion, and for the estimation of the feedback
_MIN_EXPLAINED = 0.5  # fraction of the power of u - r that the feedback must explain; noise has less


def estimate(records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None) -> Response:
    """Estimate G (F, n_y, n_u) of one configuration with its covariances and quality, from all of its records.

    For n_u inputs a mean over realisations needs n_u experiments of each realisation, other methods n_u in all, and
    local methods one.  A record without a period is a realisation.  planned_lines: excited DFT lines, if planned.
    total is None for one realisation without excluded odd lines.  Notes report discarded periods and lines, and signs
    of a faulty measurement.  Records with different sensor locations are estimated separately and stacked.

    Raises StudyError if the spec requires periods that the records lack.  DataError for inconsistent or too few
    records, dependent inputs, or no excited line.
    """
    if len(sets := by_outputs(records) if isinstance(records, Sequence) else []) > 1:
        return stack_outputs([estimate(record_set, spec, planned_lines) for record_set in sets])
    check_consistency(records)
    if records[0].is_periodic:
        groups: dict[int, list[Record]] = {}
        for record in sorted(records, key=lambda record: (record.realisation, record.experiment)):
            groups.setdefault(record.realisation, []).append(record)
        response = _with_period(records, list(groups.values()), spec, planned_lines)
    else:
        response = _without_period(records, spec)
    place = f"configuration {response.configuration.name}"
    notes = tuple(note if note.place else replace(note, place=place) for note in response.notes)
    return replace(response, notes=notes, motion=motor_motion(records, response))


def _without_period(records: Sequence[Record], spec: EstimatorSpec) -> Response:
    _check_without_period(records, spec)
    spec = replace(spec, transient_periods="auto", lines="full")
    method, notes = _choose_without_period(records, spec)
    spec = replace(spec, method=method)
    response = local_response(records, spec) if method in LOCAL else welch_response(records, spec)
    if spec.band_hz is None:
        response = within_excitation(response)
    return replace(response, notes=(*notes, *response.notes, *chain.from_iterable(map(hit_notes, records))))


def _choose_without_period(records: Sequence[Record], spec: EstimatorSpec) -> tuple[Method, tuple[Note, ...]]:
    """Return the method of the spec; for `auto` the method with the smaller stated error, h1 for very long records."""
    if spec.method != "auto":
        return spec.method, ()
    first = records[0]
    band_hz = spec.band_hz or (0.0, first.rate_hz / 2)
    count = len(grid_lines("full", band_hz, first.rate_hz, min(record.n_samples for record in records)))
    is_long = count > AUTOMATIC.long_lines and spec.resolution_hz is None
    if is_long and count * len(first.inputs) * len(first.outputs) > AUTOMATIC.long_values:
        return method_choice(
            "h1", f"a local method would fit {count} lines, and records of this length give many segments"
        )
    h1 = partial(welch_response, records, replace(spec, method="h1"))
    preview = partial(local_response, records, replace(spec, method="local_rational"), max_lines=AUTOMATIC.lines)
    return choose_by_error("h1", h1, preview, AUTOMATIC.margin if is_long else 1.0)


def _check_without_period(records: Sequence[Record], spec: EstimatorSpec) -> None:
    """Raise StudyError for a method, lines or a transient that only records with a period have."""
    options = {
        "method": spec.method not in ("auto", "h1", *LOCAL),
        "lines": spec.lines in ("odd", "excited"),
        "transient_periods": spec.transient_periods not in ("auto", 0),
    }
    for key in (key for key, needs_period in options.items() if needs_period):
        text = f"it has no period; estimator.{key} {getattr(spec, key)} needs one. Omit the key, or give a period"
        raise StudyError("study/invalid", text, f"record {records[0].name}")


def _with_period(
    records: Sequence[Record], groups: Sequence[Sequence[Record]], spec: EstimatorSpec, planned_lines: IntArray | None
) -> Response:
    """Return the response by a local method or from periods.

    `auto` compares a mean with local_rational, which models transients, if the logs may have transients.
    """
    method, reason = _choose(spec, groups)
    response = None if method in LOCAL else _by_periods(groups, replace(spec, method=method), planned_lines)
    is_automatic = spec.method == "auto" and planned_lines is None
    if is_automatic and response is not None and may_have_transient(records, response):
        mean = response
        preview = partial(local_response, records, replace(spec, method="local_rational"), None, AUTOMATIC.lines)
        method, reason = choose_by_error(method, lambda: mean, preview, AUTOMATIC.margin)
    if response is None or method in LOCAL:
        response = local_response(records, replace(spec, method=method), planned_lines)
    return replace(response, notes=(*reason, *response.notes))


def _by_periods(groups: Sequence[Sequence[Record]], spec: EstimatorSpec, planned_lines: IntArray | None) -> Response:
    """Return the response by a method that estimates each line separately from its periods."""
    method = spec.method
    check_number_of_periods(groups, method)
    first = groups[0][0]
    spectra = [list(map(RecordSpectra, group)) for group in groups]
    lines = analysed_lines([record_spectra for group in spectra for record_spectra in group], spec, planned_lines)
    detection = detection_lines(lines, first.half_wave)
    everywhere = np.union1d(lines, detection)
    is_excited = np.isin(everywhere, lines)
    everything = gather_spectra(spectra, everywhere, is_excited, spec, method == "joint")
    usable, data, result = _fit_method(everything.on(is_excited), groups, method, lines)
    error = total_error(data, result)
    notes = [*(note for group in groups for note in notes_of(group)), *data.notes]
    if not usable.all():
        why = "the inputs are less than 6 dB above the noise there, or not independent"
        notes.append(discarded_lines_note(lines[~usable], first, why))
    notes += [*repeated_phase_notes(data.blocks, groups), *inconsistency_notes(data, groups)]
    lines = lines[usable]
    freq_hz = line_frequencies(lines, first.rate_hz, first.period_samples)
    quality = measured_quality(freq_hz, data, result.G)
    response = measured_response(first, spec.quantity, freq_hz, result.G, quality=quality)
    inside, detected = (detection > lines[0]) & (detection < lines[-1]), None
    if inside.any():
        spacing_hz, off_lines = freq_hz[0] / lines[0], everything.on(~is_excited).on(inside)
        detected = detect(detection[inside], lines, spacing_hz, result.G, off_lines)
    response = _with_covariances(response, data, result, error, detected, lines, spectra)
    notes += [
        *input_notes(first.inputs, data, quality),
        *output_notes(first.outputs, quality),
        *scatter_notes(response),
    ]
    return replace(response, notes=tuple(notes))


def _fit_method(
    data: MeanSpectra, groups: Sequence[Sequence[Record]], method: str, lines: IntArray
) -> tuple[BoolArray, MeanSpectra, Estimate]:
    """Return flags of the lines (F,) with independent inputs, and the data and the estimate at these lines.

    Raises DataError without such a line, and if the method has to invert a singular matrix.
    """
    first, usable = groups[0][0], separable_lines(data, groups, method)
    if not usable.any():
        raise DataError(
            "frf/inputs-not-separable",
            f"no line has independent inputs in every realisation: {described_lines(lines, first)} lost in "
            "at least one. Measure the weak realisations again",
            f"configuration {first.configuration.name}",
        )
    data = data.on(usable)
    try:
        return usable, data, METHODS[method](data)
    except np.linalg.LinAlgError as error:
        raise DataError(
            "frf/inputs-not-separable",
            f"estimator.method {method}: the matrix is singular at a line. Check the units, or set estimator.method "
            "arithmetic",
            f"configuration {first.configuration.name}",
        ) from error


def _choose(spec: EstimatorSpec, groups: Sequence[Sequence[Record]]) -> tuple[Method, tuple[Note, ...]]:
    """Return the method of the spec; for `auto` by the experiments, with a note unless it is arithmetic."""
    if spec.method != "auto":
        return spec.method, ()
    n_u, total = len(groups[0][0].inputs), sum(map(len, groups))
    short = [record.name for group in groups for record in group if record.n_samples < 2 * record.repeat_samples]
    if short:
        return method_choice(
            "local_rational", (f"{short[0]} has one period and thus no scatter; neighbouring lines provide it")
        )
    if total < n_u:
        return method_choice(
            "local_rational", f"{total} experiments separate {n_u} inputs only together with neighbouring lines"
        )
    if any(len(group) < n_u for group in groups):
        return method_choice(
            "joint" if all(record.r is not None for group in groups for record in group) else "errors_in_variables",
            "jointly over all realisations, since one has fewer experiments than inputs, and h1 is biased by noise "
            "and friction fed back into u",
        )
    if all(record.r_is_reference for group in groups for record in group):
        return method_choice("joint", "the references are independent of noise and friction in the loop")
    # Each realisation has its own inverse, so that noise and friction in the loop cause less bias than in h1.
    return "arithmetic", ()


def _with_covariances(
    response: Response, data: MeanSpectra, fitted: Estimate, error: tuple[ComplexArray, float] | None,
    detection: DetectionLines | None, lines: IntArray, spectra: Sequence[Sequence[RecordSpectra]],
) -> Response:  # fmt: skip
    C_V = equation_error(data, fitted.G)
    noise = noise_covariance(data, fitted, C_V)
    noise_cov = C_V * np.mean(1 / data.periods)
    total, stochastic, bias = None, None, None
    noise = replace(noise, averaging_lines=_averaging_lines(data.scatter, fitted.G))
    if error is not None:
        block = slice(MAX_AVERAGING_LINES)
        experiments = [np.concatenate([Y[block], U[block]], axis=1) for Y, U in zip(data.Y, data.U, strict=True)]
        averaging = _averaging_lines([np.concatenate(experiments, axis=2).transpose(2, 0, 1)], fitted.G)
        total = replace(total_covariance(data, fitted, *error), averaging_lines=averaging)
    elif detection is not None:
        error = fast_total_error(detection, lines, noise_cov, data.dof)
        total = (
            None
            if error is None
            else replace(kronecker(fitted.input_factor, *error), averaging_lines=noise.averaging_lines)
        )
    if total is not None and error is not None:
        bias = friction_bias(spectra, lines, fitted.G, response.quantity, error[0], noise_cov, error[1])
        stochastic = np.sqrt(power(error[0] - noise_cov))
    assert response.quality is not None
    even, odd = (None, None) if detection is None else (detection.even, detection.odd)
    quality = replace(response.quality, stochastic=stochastic, even=even, odd=odd)
    return replace(response, noise=noise, total=total, quality=quality, bias=bias)


def _averaging_lines(Z: Sequence[ComplexArray], G: ComplexArray) -> float:
    """Return `averaging_lines` of Y - G U from Z = [Y; U] (K, F, n_y + n_u) of experiments or periods; 1 without."""
    n_y, block = G.shape[1], slice(MAX_AVERAGING_LINES)
    V = [z[:, block, :n_y] - np.einsum("fyu,kfu->kfy", G[block], z[:, block, n_y:]) for z in Z]
    return averaging_lines(np.concatenate(V), G[block]) if V else 1.0


def motor_motion(records: Sequence[Record], response: Response) -> MotorMotion | None:
    """Return motion of the motors among the outputs of one configuration; None without any, or without a rate."""
    # Complete realisations, until all inputs have moved: further ones have the same amplitudes.
    records = sorted(records, key=lambda record: record.realisation)
    last = records[min(max(_MIN_RECORDS, len(records[0].inputs)), len(records)) - 1].realisation
    records = [record for record in records if record.realisation <= last]
    first = records[0]
    columns = [i for i, location in enumerate(first.outputs) if location.startswith("motor ")]
    if not columns or not first.has_rate or not first.is_periodic:
        return None
    N = first.period_samples
    lines = np.rint(response.freq_hz * N / first.rate_hz).astype(np.int64)
    K = min(N // 2, 2 * int(lines[-1]) + 2)  # above twice the band the motion is negligible
    s = (2j * np.pi * first.rate_hz / N * np.arange(1, K)).astype(np.complex128)
    orders = [MOTION_ORDER[first.quantities[i]] for i in columns]
    over = np.stack([s**-order for order in orders], axis=1)
    y = np.stack([_amplitudes(record, record.y, columns, K) for record in records])
    q = y[:, 1:] * over
    rows = lines[lines < K] - 1
    power = np.sum(squared_magnitude(q), axis=(0, 2))
    moving = power > _MIN_LINE_FRACTION * power[rows].sum()
    moving[rows] = True
    line_motion = q[:, moving].transpose(1, 2, 0)
    spectra = line_motion @ line_motion.mT.conj() / (2 * len(records))
    motors = tuple(first.outputs[i] for i in columns)
    has_all = set(motors) == set(first.inputs) and not first.input_units
    feedback = _feedback(records, motors, q, s, rows, moving) if has_all else None
    mean = np.where([order == 0 for order in orders], y[:, 0].real.mean(axis=0) / 2, np.nan)
    return MotorMotion(motors, s.imag[moving] / (2 * np.pi), spectra, mean, feedback).grouped(_MAX_LINES)


def _amplitudes(record: Record, signals: FloatArray, columns: list[int], K: int) -> ComplexArray:
    """Return complex amplitudes (K, c) of signal columns in the last usable period; twice the mean at 0 Hz."""
    N, P = record.period_samples, record.n_periods
    last = max((p for p in range(P) if p not in record.discarded_periods), default=P - 1)
    period: ComplexArray = real_dft(signals[last * N : (last + 1) * N][None], np.arange(K))[0]
    return period[:, columns] * (2 / N)


def _feedback(
    records: Sequence[Record], motors: tuple[str, ...], q: ComplexArray, s: ComplexArray, excited_rows: IntArray,
    moving: BoolArray,
) -> FloatArray | None:  # fmt: skip
    """Return (3, n_m, n_m) from motor angles q (E, K, n_m) at s (K,); None if the angles do not explain the torques."""
    order = [records[0].inputs.index(motor) for motor in motors]
    drive = np.stack([_amplitudes(record, record.u, order, len(s) + 1)[1:] for record in records])
    references = [record.r for record in records if record.r is not None and not record.r_is_reference]
    if len(references) == len(records):
        pairs = zip(references, records, strict=True)
        drive = drive - np.stack([_amplitudes(record, r, order, len(s) + 1)[1:] for r, record in pairs])
        lines = np.flatnonzero(moving)
    else:
        lines = np.setdiff1d(np.arange(excited_rows[0], excited_rows[-1]), excited_rows)
    lines = lines[:: -(-len(lines) // _MAX_LINES) or 1]
    q, drive, s = q[:, lines], drive[:, lines], s[lines]
    terms = np.concatenate([q / s[:, None], q, q * s[:, None]], axis=2)
    A, b = terms.reshape(-1, terms.shape[2]), -drive.reshape(-1, len(motors))
    A, b = np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag])
    if len(A) < 2 * A.shape[1]:
        return None
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    F = np.linalg.lstsq(A / size, b)[0] / size[:, None]
    if np.sum((b - A @ F) ** 2) > (1 - _MIN_EXPLAINED) * np.sum(b**2):
        return None
    return np.asarray(F.reshape(3, len(motors), len(motors)).swapaxes(1, 2))
