r"""Frequency responses from records: the arithmetic mean over realisations of G = Y U^H (U U^H)^-1.

.. math:: \hat G = \frac{1}{M} \sum_m G^{[m]}, \quad G^{[m]} = Y^{[m]} (U^{[m]})^{-1}

Averaging responses instead of spectra keeps each realisation's pairing of u and y, which on a robot with friction is
nearly free of bias where H1 and the joint input-output method are not (Wernholt and Moberg, IFAC World Congress 2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.arrays import BoolArray, IntArray
from elastid.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.frf.lines import LEAST_SNR, analysed_lines, described_lines, noise_of_mean, smoothed
from elastid.frf.passivity import sign_words
from elastid.frf.periods import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, period_spectra
from elastid.frf.uncertainty import Block, block, noise_covariance, total_covariance
from elastid.record import Record
from elastid.response import FrequencyResponse

# Power of the weakest over the strongest combination of inputs, below which rounding decides.
_LEAST_POWER_RATIO = 1e-12
# Realisations whose inputs differ by less than this part have the same phases.
_SAME_PHASES = 0.2


def estimate(
    records: Sequence[Record], spec: EstimatorSpec, planned_lines: IntArray | None = None
) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration with noise and total covariance, from all of its records.

    Records are grouped by realisation; each needs as many experiments as there are inputs, or more.  planned_lines:
    the excited DFT lines where a plan tells them.  total is None for one realisation.  What was left out or looks
    wrong is said in notes.

    Raises DataError where the records do not fit together, the experiments do not tell the inputs apart, or no line
    is excited.
    """
    groups = _realisations(records)
    first = groups[0][0]
    lines = analysed_lines(records, spec, planned_lines)
    usable = np.ones(len(lines), dtype=np.bool_)
    blocks: list[Block] = []
    notes = [note for record in records for note in record.notes]
    for group in groups:
        spectra = [trusted(period_spectra(record, lines, spec.quantity), spec) for record in group]
        notes += [note for each in spectra for note in each.notes]
        separated = _separated(spectra)
        usable &= separated
        blocks.append(block(spectra, separated))
    if not usable.all():
        notes.append(_left_out(lines[~usable], usable.any(), first))
    blocks = [each.on(usable) for each in blocks]
    notes += _same_phases(blocks, groups)
    G = np.mean([each.G for each in blocks], axis=0)
    response = FrequencyResponse(
        freq_hz=line_frequencies(lines[usable], first.rate_hz, first.period_samples),
        G=G,
        inputs=first.inputs,
        outputs=first.outputs,
        quantity=spec.quantity,
        configuration=first.configuration,
        noise=noise_covariance(blocks),
        total=total_covariance(blocks, G),
        rate_is_known=first.rate_is_known,
    )
    return replace(response, notes=(*notes, *sign_words(response)))


def _realisations(records: Sequence[Record]) -> list[list[Record]]:
    """Records by realisation, each of which must hold an experiment per input; DataError where they do not fit."""
    first = records[0]
    for record in records:
        _check_finite(record)
        for what in ("rate_hz", "period_samples", "half_wave", "hold", "inputs", "outputs", "quantities"):
            a, b = getattr(first, what), getattr(record, what)
            if a != b:
                raise DataError(
                    f"records {first.name} and {record.name} of configuration {first.configuration.name} do not fit "
                    f"together: {what} is {a} and {b}; estimate them apart, as two configurations"
                )
    groups: dict[int, list[Record]] = {}
    for record in sorted(records, key=lambda each: (each.realisation, each.experiment)):
        groups.setdefault(record.realisation, []).append(record)
    n_u = len(first.inputs)
    for realisation, group in groups.items():
        if len(group) < n_u:
            raise DataError(
                f"configuration {first.configuration.name}, realisation {realisation}: {len(group)} experiments for "
                f"{n_u} inputs ({', '.join(first.inputs)}); each realisation needs at least {n_u} that move the inputs "
                "in different ways (number them as its experiments 0, 1, ...)"
            )
    return list(groups.values())


def _check_finite(record: Record) -> None:
    """DataError that names the first sample that is missing: it would make every line of G missing."""
    for role, names, signals in (("u", record.inputs, record.u), ("y", record.outputs, record.y)):
        if not np.isfinite(signals).all():
            sample, column = np.argwhere(~np.isfinite(signals))[0]
            raise DataError(
                f"record {record.name}: {role} at {names[column]} is NaN or infinite from sample {sample} on; "
                "leave that part out, or mend the record"
            )


def _separated(spectra: Sequence[PeriodSpectra]) -> BoolArray:
    """Lines (F,) where every combination of the inputs stands out of the noise; DataError where there are none.

    The weakest combination has the power lambda_min(U U^H) / E, each input counted relative to its RMS. Dividing by
    it biases G by a part exp(-power / noise): 2 % where it stands out least.
    """
    U = np.stack([each.U.mean(axis=0) for each in spectra], axis=2)
    _, n_u, E = U.shape
    rms = np.sqrt(np.mean(np.abs(U) ** 2, axis=(0, 2)))
    rms[rms == 0] = 1.0
    power = np.linalg.eigvalsh(U @ np.swapaxes(U, 1, 2).conj() / np.outer(rms, rms) / E)
    dof = sum(len(each.periods) - 1 for each in spectra)
    noise = smoothed(np.mean([noise_of_mean(each.U / rms) for each in spectra], axis=0).max(axis=1), dof)
    least = np.maximum(LEAST_SNR * noise, _LEAST_POWER_RATIO * power[:, -1])
    separated: BoolArray = power[:, 0] > least
    if not separated.any():
        record = spectra[0].record
        ways = int(np.median(np.sum(power > least[:, None], axis=1)))
        raise DataError(
            f"configuration {record.configuration.name}, realisation {record.realisation}: its {E} experiments move "
            f"the {n_u} inputs ({', '.join(record.inputs)}) in {ways} independent ways only, above the noise; "
            "is a file listed twice, an input not excited, or were the phases the same in all experiments?"
        )
    return separated


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
