r"""Welch's H1, H2 and Hv: responses of records without a period, from windowed segments that overlap.

Every segment of every record of a configuration is a realisation. With the cross spectra of all K of them,

.. math:: S_{yu} = \sum_k Y_k U_k^H, \quad H_1 = S_{yu} S_{uu}^{-1}, \quad H_2 = S_{yy} S_{uy}^{-1}

and Hv by total least squares of each output.  The residual gives the covariance; for one input it is that by coherence,

.. math:: cov(vec\, H) = S_{uu}^{-T} \otimes \frac{S_{vv}}{K_e - n_u}, \quad S_{vv} = \sum_k V_k V_k^H, \qquad
          \sigma^2_H = |H|^2 \frac{1 - \gamma^2}{\gamma^2 (K_e - 1)}

where K_e independent segments would tell as much as the K that overlap (Welch, IEEE Trans. Audio Electroacoust. 15,
1967).  A segment has no model of leakage: a resonance narrower than its resolution is flattened, beyond its variance.
(Bendat and Piersol, Random Data, 4th ed., sections 9.2 and 11.5.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.frf.checks.quality import coherences
from elastid.frf.covariance import kronecker
from elastid.frf.local.bandwidth import local_modes
from elastid.frf.matrices import adjoint, power, transposed
from elastid.frf.measured_response import measured_response
from elastid.frf.segments import CrossSpectra, Segments, cross_spectra, make_segments
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
from elastid.response import Covariance, FrequencyResponse, Levels, Quality

# Power of the weakest over the strongest combination of inputs, each relative to its RMS, below which rounding decides.
_MIN_POWER_RATIO = 1e-12
# Condition of the inputs beyond which they move nearly together.
_MAX_CONDITION = 10.0
# A resonance is resolved by so many lines of a segment within its bandwidth.
_MIN_LINES_IN_MODE = 4.0


def welch_response(records: Sequence[Record], spec: EstimatorSpec) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration by h1, h2 or hv, with coherences, from all segments of its records.

    noise and total are the same: segments do not tell noise from nonlinear distortion.  Lines are those of a segment.

    Raises DataError where the records are shorter than a segment, hold too few, or do not separate the inputs.
    """
    first = records[0]
    segments = make_segments(records, spec)
    lines = grid_lines("full", spec.band_hz or (0.0, first.rate_hz / 2), first.rate_hz, len(segments.window))
    data = cross_spectra(records, segments, lines, spec)
    power_ratio = _input_power(data)
    usable = power_ratio[:, 0] > _MIN_POWER_RATIO * power_ratio[:, -1]
    if not usable.any():
        raise DataError(
            f"configuration {first.configuration.name}: its records do not separate the {len(first.inputs)} inputs "
            f"({', '.join(first.inputs)}) at any line: one of them was not excited, or two move in proportion; excite "
            "each with its own noise, or leave out the channel that was not excited"
        )
    data, kept = data.on(usable), lines[usable]
    G = _METHODS[spec.method](data)
    freq_hz = line_frequencies(kept, first.rate_hz, len(segments.window))
    covariance, C_V = _covariance(data, G)
    quality = _quality(freq_hz, data, G, C_V)
    notes = [note for record in records for note in record.notes]
    if not usable.all():
        text = f"{np.sum(~usable)} lines are left out: an input has no power there, or two move in proportion"
        notes.append(Note("lines-left-out", text))
    notes += [_segment_note(spec, segments, data, first), *_notes(freq_hz, G, covariance, quality, first)]
    response = measured_response(
        first, spec.quantity, freq_hz, G, noise=covariance, total=covariance, quality=quality, notes=tuple(notes)
    )
    return replace(response, correlated_lines=segments.correlated_lines)


def _h1(data: CrossSpectra) -> ComplexArray:
    return data.yu @ np.linalg.inv(data.uu)


def _h2(data: CrossSpectra) -> ComplexArray:
    n_u = data.uu.shape[1]
    if data.n_y != n_u:
        raise StudyError(
            f"estimator.method h2 needs as many outputs as inputs, here {data.n_y} and {n_u}; take h1 or local_rational"
        )
    try:
        return np.asarray(data.yy @ np.linalg.inv(adjoint(data.yu)))
    except np.linalg.LinAlgError as error:
        raise DataError(
            "estimator.method h2 finds a singular matrix at some line: an output does not move; take h1"
        ) from error


def _hv(data: CrossSpectra) -> ComplexArray:
    """Each output by the weakest direction v of [y; u], v^H z = 0: as much noise on it as on every input."""
    G = np.empty(data.yu.shape, dtype=np.complex128)
    n_y = data.n_y
    for i in range(n_y):
        rows = np.concatenate([[i], np.arange(n_y, data.S.shape[1])])
        v = np.linalg.eigh(data.S[:, rows[:, None], rows])[1][:, :, 0].conj()
        if not v[:, 0].all():
            raise DataError("estimator.method hv: an input has no power at some line of its own; take h1")
        G[:, i] = -v[:, 1:] / v[:, :1]
    return G


_METHODS = {"h1": _h1, "h2": _h2, "hv": _hv}


def _covariance(data: CrossSpectra, G: ComplexArray) -> tuple[Covariance, ComplexArray]:
    """Covariance of vec G from the residual, and that of one segment's V = Y - G U (F, n_y, n_y)."""
    dof = data.K_e - G.shape[2]
    cross = data.yu @ adjoint(G)
    S_V = data.yy - cross - adjoint(cross) + G @ data.uu @ adjoint(G)
    # Rounding makes the residual of exact data negative.
    S_V = S_V + np.eye(data.n_y) * np.maximum(-np.linalg.eigvalsh(S_V)[:, :1, None], 0.0)
    C_V = S_V * (data.K_e / data.K / dof)
    inverse: ComplexArray = np.asarray(np.linalg.inv(data.uu), dtype=np.complex128)
    left = transposed(inverse) * (data.K / data.K_e)
    return kronecker(left, C_V, dof), C_V


def _input_power(data: CrossSpectra) -> FloatArray:
    """Eigenvalues (F, n_u) of the mean S_uu, each input relative to its RMS over lines; smallest first."""
    S = data.uu / data.K
    rms = np.sqrt(power(S).mean(axis=0))
    rms = np.where(rms > 0, rms, 1.0)
    return np.asarray(np.maximum(np.linalg.eigvalsh(S / np.outer(rms, rms)), 0.0))


def _quality(freq_hz: FloatArray, data: CrossSpectra, G: ComplexArray, C_V: ComplexArray) -> Quality:
    """Coherences and levels; the noise in the inputs is unknown and counts as none."""
    ordinary, multiple = coherences(power(data.yy), data.yu, data.uu)
    noise = power(C_V)
    return Quality(
        coherence=ordinary,
        multiple_coherence=multiple,
        singular_values=np.asarray(np.linalg.svd(G, compute_uv=False), dtype=np.float64),
        input_singular_values=np.sqrt(_input_power(data)[:, ::-1]),
        input_noise=np.zeros((len(G), G.shape[2])),
        output_noise=noise,
        excited=Levels(freq_hz, np.sqrt(power(data.yy) / data.K), np.sqrt(noise / data.K_e)),
    )


def _segment_note(spec: EstimatorSpec, segments: Segments, data: CrossSpectra, first: Record) -> Note:
    L = len(segments.window)
    length = f"{L / first.rate_hz:g} s ({L} samples)" if first.rate_is_known else f"{L} samples"
    text = (
        f"{spec.method} from {data.K} segments of {length}, window {spec.window}, overlap {100 * spec.overlap:g} %: "
        f"worth {data.K_e:.3g} independent ones"
    )
    return Note("segments", text, severity="information")


def _notes(freq_hz: FloatArray, G: ComplexArray, covariance: Covariance, quality: Quality, first: Record) -> list[Note]:
    """A note where inputs move together, and one on resonances that a segment does not resolve."""
    notes = []
    condition = float(np.median(quality.condition))
    if condition > _MAX_CONDITION:
        text = (
            f"the inputs move nearly together: the condition of their spectra is {condition:.3g} at the median line (1 "
            "is best); excite each with its own noise"
        )
        notes.append(Note("inputs-move-together", text))
    if len(freq_hz) < 3:
        return notes
    spacing = float(np.min(np.diff(freq_hz)))
    # Leakage is most of the variance at such a peak, which 10 dB are enough to tell from noise.
    modes = local_modes(freq_hz, G, covariance.variance / 4)
    narrow = np.flatnonzero(modes.bandwidth_hz < _MIN_LINES_IN_MODE * spacing)
    if narrow.size:
        worst = narrow[np.argmin(modes.bandwidth_hz[narrow])]
        unit = "Hz" if first.rate_is_known else "of the sampling rate"
        longer = 2 * _MIN_LINES_IN_MODE / modes.bandwidth_hz[worst]
        text = (
            f"segments of {1 / spacing:.3g} s barely resolve {narrow.size} of {len(modes.freq_hz)} resonances, that at "
            f"{modes.freq_hz[worst]:.4g} {unit} least: its peak is flattened and its damping too large, beyond the "
            f"variance; take estimator.segment {longer:.3g} or more where the records allow it, or local_rational"
        )
        notes.append(Note("segment-too-short", text))
    return notes
