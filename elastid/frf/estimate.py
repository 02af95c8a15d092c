"""Frequency responses from records: G (F, n_y, n_u) of one configuration with all that is known of its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.frf.checks.exchanged_channels import pairing_words
from elastid.frf.checks.quality import input_words, measured_quality, output_words
from elastid.frf.covariance import (
    distortion_covariance,
    equation_error,
    form_words,
    kronecker,
    noise_covariance,
    total_covariance,
    total_error,
)
from elastid.frf.distortion import Detected, detected, detection_lines, fast_total_error
from elastid.frf.experiment_blocks import Block, Gathered, gathered, pooled
from elastid.frf.lines import LEAST_SNR, analysed_lines, described_lines, smoothed_noise
from elastid.frf.local.response import local_response
from elastid.frf.methods import AVERAGED, METHODS, Estimate
from elastid.frf.spec import EstimatorSpec, Method
from elastid.frf.spectra import refuse_uncomputable
from elastid.record import Record
from elastid.response import FrequencyResponse

# Power of the weakest over the strongest combination of inputs, below which rounding decides.
_LEAST_POWER_RATIO = 1e-12
LOCAL = ("local_polynomial", "local_rational")
# Realisations whose inputs differ by less than this part have the same phases.
_SAME_PHASES = 0.2


def estimate(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None
) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration with its covariances and quality, from all of its records.

    Records are grouped by realisation; a mean over realisations needs as many experiments of each as there are inputs,
    other methods as many in all, local ones a single one.  planned_lines: the excited DFT lines where a plan tells
    them.  total is None for one realisation, unless odd lines were left out on purpose.  What was left out or looks
    wrong is said in notes.

    Raises DataError where the records do not fit together, the experiments do not tell the inputs apart, or no line
    is excited.
    """
    _check_together(records)
    groups = _realisations(records)
    method, reason = chosen_method(spec, groups)
    if method in LOCAL:
        for record in records:
            refuse_uncomputable(record)
        response = local_response(records, replace(spec, method=method), planned_lines)
        return replace(response, notes=(*reason, *response.notes))
    _check_periods(records, method)
    _check_experiments(groups, method)
    return _from_periods(groups, spec, method, reason, planned_lines)


def _from_periods(
    groups: Sequence[Sequence[Record]],
    spec: EstimatorSpec,
    method: str,
    reason: tuple[str, ...],
    planned_lines: IntArray | None,
) -> FrequencyResponse:
    """By a mean over realisations, or a method that pools them: each line on its own, from its periods."""
    records = [record for group in groups for record in group]
    first = groups[0][0]
    lines = analysed_lines(records, spec, planned_lines)
    detection = detection_lines(lines, first.half_wave)
    everything = gathered(groups, lines, detection, spec, with_reference=method == "joint")
    excited = np.isin(np.union1d(lines, detection), lines)
    data = everything.on(excited)
    notes = [*reason, *(note for record in records for note in record.notes), *data.notes]
    usable = _separated_lines(data.blocks, groups, method)
    if not usable.all():
        notes.append(_left_out(lines[~usable], usable.any(), first))
    data = data.on(usable)
    notes += _same_phases(data.blocks, groups)
    found = _found(method, data, first)
    freq_hz = line_frequencies(lines[usable], first.rate_hz, first.period_samples)
    response = FrequencyResponse(
        freq_hz=freq_hz,
        G=found.G,
        inputs=first.inputs,
        outputs=first.outputs,
        quantity=spec.quantity,
        configuration=first.configuration,
        rate_is_known=first.rate_is_known,
        sliding=first.sliding,
    )
    where = first.configuration.name
    quality = measured_quality(freq_hz, data, found.G)
    response = replace(response, quality=quality)
    levels = _detected(detection, lines[usable], freq_hz, found, everything.on(~excited))
    response, words = _with_covariances(response, data, found, levels, lines[usable])
    notes += [f"configuration {where}: {note}" for note in found.notes]
    notes += [*words, *input_words(where, first.inputs, data, quality), *output_words(where, first.outputs, quality)]
    return replace(response, notes=(*notes, *pairing_words(response)))


def _found(method: str, data: Gathered, first: Record) -> Estimate:
    """What the method makes of the data; DataError where it must divide by what is not there."""
    try:
        return METHODS[method](data.blocks, data.scatter.C_Z)
    except np.linalg.LinAlgError as error:
        raise DataError(
            f"configuration {first.configuration.name}: estimator.method {method} finds a singular matrix at some "
            f"line: an output of {', '.join(first.outputs)} does not move on its own, or the units of inputs and "
            "outputs are too far apart; check these channels, or take arithmetic"
        ) from error


def chosen_method(spec: EstimatorSpec, groups: Sequence[Sequence[Record]]) -> tuple[Method, tuple[str, ...]]:
    """The method that the spec names; for `auto` the one for closed-loop robot data, and why."""
    if spec.method != "auto":
        return spec.method, ()
    where, n_u = groups[0][0].configuration.name, len(groups[0][0].inputs)
    total = sum(map(len, groups))
    if total < n_u:
        return "local_rational", (
            f"configuration {where}: estimator.method auto takes local_rational: {total} experiments tell {n_u} inputs "
            "apart only through neighbouring lines",
        )
    if any(len(group) < n_u for group in groups):
        known = all(record.r is not None for group in groups for record in group)
        pooling: Method = "joint" if known else "errors_in_variables"
        return pooling, (
            f"configuration {where}: estimator.method auto takes {pooling}, over all realisations together: single "
            "ones have fewer experiments than inputs, so that no mean of their responses can be had, and h1 is biased "
            "by what noise and friction feed back",
        )
    return "arithmetic", (
        f"configuration {where}: estimator.method auto takes the arithmetic mean: each realisation keeps its pairing "
        "of torque and motion, which noise and friction in the loop upset in h1; the harmonic mean fails where "
        "friction sticks, and the logarithmic one tells the same",
    )


def _check_periods(records: Sequence[Record], method: str) -> None:
    """DataError where a record holds less than two periods: there is no noise level then."""
    short = [record.name for record in records if record.n_samples < 2 * record.repeat_samples]
    if short:
        raise DataError(
            f"records {', '.join(short)} of configuration {records[0].configuration.name} hold one period, method "
            f"{method} needs two; measure more, or take estimator.method local_rational"
        )


def _realisations(records: Sequence[Record]) -> list[list[Record]]:
    """Records by realisation, in the order of their experiments."""
    groups: dict[int, list[Record]] = {}
    for record in sorted(records, key=lambda each: (each.realisation, each.experiment)):
        groups.setdefault(record.realisation, []).append(record)
    return list(groups.values())


def _check_together(records: Sequence[Record]) -> None:
    """DataError where the records of a configuration do not fit together."""
    first = records[0]
    for record in records:
        for what in ("rate_hz", "period_samples", "half_wave", "hold", "inputs", "outputs", "quantities"):
            a, b = getattr(first, what), getattr(record, what)
            if a != b:
                raise DataError(
                    f"records {first.name} and {record.name} of configuration {first.configuration.name} do not fit "
                    f"together: {what} is {a} and {b}; estimate them apart, as two configurations"
                )


def _check_experiments(groups: Sequence[Sequence[Record]], method: str) -> None:
    """DataError where a realisation, or all together for a method that pools them, has too few experiments."""
    first = groups[0][0]
    n_u = len(first.inputs)
    if method in AVERAGED:
        counts = {f"realisation {group[0].realisation}": len(group) for group in groups}
    else:
        counts = {"all realisations": sum(map(len, groups))}
    for what, count in counts.items():
        if count < n_u:
            raise DataError(
                f"configuration {first.configuration.name}, {what}: {count} experiments for "
                f"{n_u} inputs ({', '.join(first.inputs)}); each realisation needs at least {n_u} that move the inputs "
                "in different ways (number them as its experiments 0, 1, ...)"
            )


def _separated_lines(blocks: Sequence[Block], groups: Sequence[Sequence[Record]], method: str) -> BoolArray:
    """Lines (F,) where the inputs can be told apart: in every realisation if each gives a response, else together."""
    if method in AVERAGED:
        in_all: BoolArray = np.all([_separated(*each) for each in zip(blocks, groups, strict=True)], axis=0)
        return in_all
    return _separated(pooled(blocks), groups[0])


def _separated(block: Block, group: Sequence[Record]) -> BoolArray:
    """Lines (F,) where every combination of the inputs stands out of the noise; DataError where it never does.

    The weakest combination has the power lambda_min(U U^H) / E, each input counted relative to its RMS. Dividing by
    it biases G by a part exp(-power / noise): 2 % where it stands out least.
    """
    rms, (_, n_u, E) = block.input_rms, block.U.shape
    of_mean = block.input_noise * np.mean(1 / block.periods)
    noise = LEAST_SNR * smoothed_noise((of_mean / rms**2).max(axis=1), block.dof)
    whole = np.sum(np.abs(block.U) ** 2, axis=2) @ (1 / (E * rms**2))
    least = np.maximum(noise, _LEAST_POWER_RATIO * whole)
    # Most lines pass by the bound 1 / tr(S_U^-1) <= lambda_min, which costs no eigenvalue.
    separated = _weakest_at_least(block, least)
    doubtful = np.flatnonzero(~separated)
    U = block.U[doubtful]
    power = np.linalg.eigvalsh(U @ np.swapaxes(U, 1, 2).conj() / (E * np.outer(rms, rms)))
    separated[doubtful] = power[:, 0] > least[doubtful]
    if not separated.any():
        record = group[0]
        ways = int(np.median(np.sum(power > least[:, None], axis=1)))
        raise DataError(
            f"configuration {record.configuration.name}, realisation {record.realisation}: its {E} experiments move "
            f"the {n_u} inputs ({', '.join(record.inputs)}) in {ways} independent ways only, above the noise; "
            "is a file listed twice, an input not excited, or were the phases the same in all experiments?"
        )
    return separated


def _weakest_at_least(block: Block, least: FloatArray) -> BoolArray:
    """Lines (F,) where 1 / tr(S_U^-1) is above the least power; none where some matrix has no inverse at all."""
    try:
        trace = block.U.shape[2] * (np.sum(np.abs(block.W) ** 2, axis=1) @ block.input_rms**2)
    except np.linalg.LinAlgError:
        return np.zeros(len(least), dtype=np.bool_)
    above: BoolArray = least * trace < 1
    return above


def _detected(
    detection: IntArray, lines: IntArray, freq_hz: FloatArray, found: Estimate, data: Gathered
) -> Detected | None:
    """Levels at the detection lines between the lowest and the highest line of G."""
    inside = (detection > lines[0]) & (detection < lines[-1])
    if not inside.any():
        return None
    return detected(detection[inside], lines, freq_hz[0] / lines[0], found.G, data.on(inside))


def _with_covariances(
    response: FrequencyResponse, data: Gathered, found: Estimate, levels: Detected | None, lines: IntArray
) -> tuple[FrequencyResponse, list[str]]:
    """Noise, total and distortion of G, and the nonlinear levels in the outputs."""
    blocks, C_V = data.blocks, equation_error(data.scatter, found.G)
    noise = noise_covariance(blocks, found, C_V, data.scatter.dof)
    total, error = None, total_error(data, found)
    if error is not None:
        total = total_covariance(blocks, found, *error)
    elif levels is not None:
        error = fast_total_error(levels, lines)
        total = None if error is None else kronecker(found.left, *error)
    distortion, stochastic = None, None
    if total is not None and error is not None:
        distortion = distortion_covariance(noise, total, len(blocks))
        excess = np.einsum("fii->fi", error[0] - C_V * np.mean(1 / data.periods)).real
        stochastic = np.sqrt(np.maximum(excess, 0.0))
    assert response.quality is not None
    quality = replace(
        response.quality,
        stochastic=stochastic,
        even=None if levels is None else levels.even,
        odd=None if levels is None else levels.odd,
    )
    words = form_words(response.configuration.name, noise, total)
    return replace(response, noise=noise, total=total, distortion=distortion, quality=quality), words


def _left_out(lines: IntArray, some_are_left: np.bool_, record: Record) -> str:
    where = f"configuration {record.configuration.name}"
    what = f"lines {described_lines(lines, record)}"
    if not some_are_left:
        raise DataError(
            f"{where}: at no line do the experiments of all realisations tell the inputs apart: {what} are lost in one "
            "or another; measure the weak ones again"
        )
    return (
        f"{where}: {what} are left out: some combination of the inputs is less than 6 dB above its noise there, so "
        "that outputs cannot be traced to inputs"
    )


def _same_phases(blocks: Sequence[Block], groups: Sequence[Sequence[Record]]) -> list[str]:
    """A word where two realisations were excited alike: they say nothing about nonlinear distortion."""
    words = []
    for m in range(1, len(blocks)):
        a, b = blocks[m - 1].U, blocks[m].U
        if a.shape == b.shape and np.linalg.norm(a - b) < _SAME_PHASES * np.linalg.norm(a):
            words.append(
                f"configuration {groups[m][0].configuration.name}: realisations {groups[m - 1][0].realisation} and "
                f"{groups[m][0].realisation} have the same phases, so the total variance misses the nonlinear "
                "distortion; draw new phases for every realisation"
            )
    return words
