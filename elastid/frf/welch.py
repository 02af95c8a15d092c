r"""Welch's H1: responses of records without a period, from overlapping windowed segments.

Every segment of every record of a configuration is a realisation. With the cross spectra of all K segments,

.. math:: S_{yu} = \sum_k Y_k U_k^H, \quad H_1 = S_{yu} S_{uu}^{-1}

The covariance follows from the residual, for one input from the coherence,

.. math:: cov(vec\, H) = S_{uu}^{-T} \otimes \frac{S_{vv}}{K_e - n_u}, \quad S_{vv} = \sum_k V_k V_k^H, \qquad
          \sigma^2_H = |H|^2 \frac{1 - \gamma^2}{\gamma^2 (K_e - 1)}

where K_e is the number of independent segments equivalent to K overlapping ones (Welch, IEEE Trans. Audio
Electroacoust. 15, 1967).  This covariance is `noise`.  The window of a segment smooths cross spectra (leakage),

.. math:: E[S_{yu}(f)] = \int |W(f - \nu)|^2\, H(\nu)\, S_{uu}(\nu)\, d\nu, \qquad
          \beta_k = \sum_l \frac{|W_l|^2}{\sum_m |W_m|^2} H_{k+l} - H_k

which flattens resonances by beta, 1/6 of the second difference of H for Hann's window.  `total` includes the square of
beta minus the contribution of noise to it.  This expectation is exact for noise inputs, and for sweeps and hits only if
w^2 of all segments add up to a constant.  Their segments therefore overlap by 75 %, and records are padded with zeros.
Lines that a sweep reaches at or after the end of its record are discarded.

A sweep or a decaying sine, and its leakage, is in few segments at each line, equally in each repeat.  With the leverage
h_j of a segment and its repeats,

.. math:: C_h = \frac{1}{n_u - \sum_j h_j^2} \sum_j E_j S_{uu}^{-1} E_j^H, \qquad
          E_j = \sum_{k \in j} V_k U_k^H, \quad h_j = \sum_{k \in j} U_k^H S_{uu}^{-1} U_k

is a cluster-robust covariance of V (White, Econometrica 48, 1980). `total` contains it if its mean over neighbouring
lines exceeds the covariance by S_vv.  Not included: the additional flattening of a resonance narrower than a few lines,
and the leakage of a boxcar between lines. (Bendat and Piersol, Random Data, 4th ed., sections 8.5, 9.2 and 11.5.)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, quotient
from elastid.base.display import percent
from elastid.base.errors import DataError, Note, notes_of
from elastid.base.large_arrays import release
from elastid.base.matrices import power
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.frf.checks import REPEAT_DIFFERENCE
from elastid.frf.estimators import kronecker
from elastid.frf.local.fitted_response import local_mean
from elastid.frf.quality import (
    coherences,
    dependent_input_notes,
    local_modes,
    measured_response,
    quality_of,
    relative_singular_values,
    segment_notes,
)
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import check_values, is_transient_excitation, unit_scale
from elastid.record import Record
from elastid.response import Covariance, LineAmplitudes, Quality, Response

_MIN_DOF = 0.4  # least 1 - sum h^2 / n_u, which is 0 for a line in a single segment
# A line is truncated if the last _END of a segment contains more than _MAX_END_FRACTION of its power.
_END, _MAX_END_FRACTION = 1 / 16, 0.25
_MAX_NUMBERS = 1 << 20  # largest number of values in a segment of all channels for `auto`
_MIN_LEAKAGE = 1e-4  # power of a window at a line relative to its middle line, below which it is neglected


@dataclass(frozen=True)
class Segments:
    """Segments with a window (L,), at distances of `step` samples."""

    window: FloatArray
    step: int

    def count(self, n_samples: int) -> int:
        """Return the number of segments in a record."""
        return max(0, 1 + (n_samples - len(self.window)) // self.step)

    def padded(self, record: Record) -> Record:
        """Return the record padded with zeros if segments overlap by more than 50 %, so that w^2 adds up."""
        zeros = len(self.window) - self.step
        if 2 * zeros <= len(self.window):
            return record
        u, y = (np.pad(x - x.mean(axis=0), ((zeros, zeros), (0, 0))) for x in (record.u, record.y))
        return replace(record, u=u, y=y, r=None, period_samples=len(u))

    @property
    def correlated_lines(self) -> float:
        r"""Number of lines with correlated errors of cross spectra: sum_l |rho_l|^2 of the window's spectrum.

        .. math:: \rho_l = \sum_n w^2(n) e^{-2\pi j l n / L} / \sum_n w^2(n)

        1 for a boxcar, 1.94 for Hann's window.
        """
        power = self.window**2
        return float(len(power) * np.sum(power**2) / np.sum(power) ** 2)

    @property
    def leakage(self) -> tuple[FloatArray, float]:
        """Weights (2 m + 1,) of neighbouring lines in beta, and noise variance of beta relative to H."""
        power = np.abs(rfft(self.window)) ** 2
        m = min(int(np.flatnonzero(power > _MIN_LEAKAGE * power[0])[-1]), len(power) // 4)
        kernel = np.concatenate([power[m:0:-1], power[: m + 1]])
        weights = kernel / kernel.sum() - (np.arange(2 * m + 1) == m)
        correlation = np.abs(rfft(self.window**2) / np.sum(self.window**2))[: 2 * m + 1] ** 2
        lags = np.arange(2 * m + 1)
        return weights, float(weights @ correlation[np.abs(lags[:, None] - lags)] @ weights)

    def independent(self, n_samples: int) -> float:
        r"""Return K_e of a record: factor by which K segments reduce the variance of the mean power of white noise.

        .. math:: K_e = K / \left(1 + 2 \sum_{j=1}^{K-1} (1 - j/K) \rho_j\right), \quad
                  \rho_j = \left(\frac{\sum_n w(n) w(n + jD)}{\sum_n w^2(n)}\right)^2
        """
        K, w, D = self.count(n_samples), self.window, self.step
        if K == 0:
            return 0.0
        shifts = range(1, min(K, -(-len(w) // D)))
        rho = [(np.dot(w[: -j * D], w[j * D :]) / np.dot(w, w)) ** 2 for j in shifts]
        return float(K / (1 + 2 * sum((1 - j / K) * rho_j for j, rho_j in zip(shifts, rho, strict=True))))


def make_segments(records: Sequence[Record], spec: EstimatorSpec) -> Segments:
    """Return the segments of the spec; `auto` has the longest power of two that gives enough segments.

    Raises DataError for too few segments, or segments that are too short.
    """
    from scipy.signal import get_window

    first, n_u = records[0], len(records[0].inputs)
    lengths = [record.n_samples for record in records]

    def segments_of(L: int) -> Segments:
        return Segments(np.asarray(get_window(spec.window, L), np.float64), max(1, L - L // 2))

    place = f"configuration {first.configuration.name}: "
    if spec.segment != "auto":
        L = round(spec.segment * first.rate_hz)
        if L < 4:
            raise DataError(
                "frf/segment",
                f"{place}estimator.segment {spec.segment:g} s is {L} samples. Give at least {4 / first.rate_hz:g} s",
            )
        segments = segments_of(L)
    else:
        min_segments = max(16, 8 * n_u)
        L = 2 ** int(np.log2(min(max(lengths), _MAX_NUMBERS // (len(first.outputs) + n_u))))
        segments = segments_of(L)
        while L > 8 and sum(map(segments.count, lengths)) < min_segments:
            L //= 2
            segments = segments_of(L)
    if sum(map(segments.independent, lengths)) < n_u + 1:
        longest = max(lengths) / first.rate_hz
        raise DataError(
            "frf/segment",
            f"{place}too few segments of {L / first.rate_hz:g} s for {n_u} inputs. Set estimator.segment to at most "
            f"{longest / (2 * n_u + 2):.3g}, or estimator.method local_rational",
        )
    return replace(segments, step=max(1, L // 4)) if is_transient_excitation(records) else segments


@dataclass(frozen=True)
class CrossSpectra:
    """Sum S (F, n, n) of Z Z^H over K segments, Z = [Y; U]: complex amplitudes at freq_hz (F,).

    K_e: equivalent number of independent segments.
    """

    freq_hz: FloatArray
    S: ComplexArray
    n_y: int
    K: int
    K_e: float

    @property
    def yy(self) -> ComplexArray:
        """S_yy (F, n_y, n_y)."""
        return self.S[:, : self.n_y, : self.n_y]

    @property
    def yu(self) -> ComplexArray:
        """S_yu (F, n_y, n_u)."""
        return self.S[:, : self.n_y, self.n_y :]

    @property
    def uu(self) -> ComplexArray:
        """S_uu (F, n_u, n_u)."""
        return self.S[:, self.n_y :, self.n_y :]

    def on(self, lines: BoolArray) -> "CrossSpectra":
        """Return spectra on some of the lines (F,)."""
        return self if lines.all() else replace(self, freq_hz=self.freq_hz[lines], S=self.S[lines])


def cross_spectra(records: Sequence[Record], segments: Segments, spec: EstimatorSpec) -> CrossSpectra:
    """Return the sums over all segments, without their means; outputs in the quantity of the spec.

    Raises DataError for a missing sample, StudyError if the band contains no line.
    """
    first, n_y = records[0], len(records[0].outputs)
    lines, freq_hz, scale = _lines(first, segments, spec)
    n = n_y + len(first.inputs)
    S = np.zeros((len(lines), n, n), np.complex128)
    for record in records:
        check_values(record)
    for Z in _spectra(records, segments, lines):
        S += Z @ Z.mT.conj()
    S *= scale[:, :, None] * scale[:, None, :].conj()
    lengths = [record.n_samples for record in records]
    return CrossSpectra(freq_hz, S, n_y, sum(map(segments.count, lengths)), sum(map(segments.independent, lengths)))


def _lines(first: Record, segments: Segments, spec: EstimatorSpec) -> tuple[IntArray, FloatArray, ComplexArray]:
    """Return the lines (F,) of a segment in the band, their frequencies (F,), and the scale (F, n) of its spectra."""
    L = len(segments.window)
    lines = grid_lines("full", spec.band_hz or (0.0, first.rate_hz / 2), first.rate_hz, L)
    freq_hz = line_frequencies(lines, first.rate_hz, L)
    return lines, freq_hz, np.asarray(2 / segments.window.sum() * unit_scale(first, freq_hz, spec.quantity))


def _spectra(
    records: Sequence[Record], segments: Segments, lines: IntArray, max_values: int = 4_000_000
) -> Iterator[ComplexArray]:
    """Yield Z = [Y; U] (F, n, K) of all segments, without their means, at most `max_values` numbers at a time."""
    w, D = segments.window, segments.step
    L, n = len(w), len(records[0].outputs) + len(records[0].inputs)
    at_once = max(1, max_values // (L * n))
    for record in records:
        for begin in range(0, segments.count(record.n_samples), at_once):
            samples = slice(begin * D, (begin + min(at_once, segments.count(record.n_samples) - begin) - 1) * D + L)
            signals = np.ascontiguousarray(np.concatenate([record.y[samples], record.u[samples]], axis=1).T)
            windows = np.lib.stride_tricks.sliding_window_view(signals, L, axis=1)[:, ::D]
            windows = (windows - windows.mean(axis=2, keepdims=True)) * w
            yield np.moveaxis(rfft(windows, axis=2)[:, :, lines], 2, 0)
            release(record.y)
            release(record.u)


def _by_leverage(
    records: Sequence[Record], segments: Segments, spec: EstimatorSpec, data: CrossSpectra, G: ComplexArray
) -> ComplexArray:
    """Return C_h (F, n_y, n_y), the cluster-robust covariance of V = Y - G U in one segment."""
    lines, freq_hz, scale = _lines(records[0], segments, spec)
    in_data = np.isin(freq_hz, data.freq_hz)
    n_y, n_u = data.n_y, G.shape[2]
    inverse = np.asarray(np.linalg.inv(data.uu), np.complex128)
    C, squares = np.zeros((len(G), n_y, n_y), np.complex128), np.zeros(len(G))
    for group in _repeats(records):
        max_values = 4_000_000 // (n_u * len(group))
        for spectra in zip_longest(*(_spectra([record], segments, lines[in_data], max_values) for record in group)):
            E, h = _leverages([Z * scale[in_data][:, :, None] for Z in spectra if Z is not None], G, inverse)
            squares += np.sum(h**2, axis=1)
            C += np.einsum("fykj,fkl,fzlj->fyz", E, inverse, E.conj(), optimize=True)
    return np.asarray(C / (n_u * np.maximum(1 - squares / n_u, _MIN_DOF))[:, None, None])


def _leverages(
    spectra: Sequence[ComplexArray], G: ComplexArray, inverse: ComplexArray
) -> tuple[ComplexArray, FloatArray]:
    """Return V U^H (F, n_y, n_u, K) of segments and their leverage (F, K), with repeated records summed."""
    n_y, K = G.shape[1], max(Z.shape[2] for Z in spectra)
    E, h = np.zeros((*G.shape, K), np.complex128), np.zeros((len(G), K))
    for Z in spectra:
        U = Z[:, n_y:]
        E[..., : Z.shape[2]] += (Z[:, :n_y] - G @ U)[:, :, None] * U.conj()[:, None]
        h[:, : Z.shape[2]] += np.sum(U.conj() * (inverse @ U), axis=1).real
    return E, h


def _repeats(records: Sequence[Record]) -> list[list[Record]]:
    groups: list[list[Record]] = []
    for record in records:
        alike = next((group for group in groups if _are_repeats(group[0], record)), None)
        groups.append([record]) if alike is None else alike.append(record)
    return groups


def _are_repeats(first: Record, other: Record) -> bool:
    n = min(first.n_samples, other.n_samples)
    if max(first.n_samples, other.n_samples) > 1.1 * n:
        return False
    u, v = (np.asarray(record.u[: n : -(-n // (1 << 20))]) for record in (first, other))
    return bool(np.sum((u - v) ** 2) <= REPEAT_DIFFERENCE**2 * np.sum((u - u.mean(axis=0)) ** 2))


def welch_response(records: Sequence[Record], spec: EstimatorSpec) -> Response:
    """Estimate G (F, n_y, n_u) of one configuration by h1, at the lines of a segment.

    noise: includes distortion.  total: also includes leakage.
    Raises DataError for too short records, too few segments, or dependent inputs.
    """
    first = records[0]
    segments, full_records = make_segments(records, spec), records
    records = [segments.padded(record) for record in full_records]
    data = cross_spectra(records, segments, spec)
    strength = relative_singular_values(data.uu / data.K)
    usable = strength[:, -1] > 1e-6 * strength[:, 0]  # rounding errors
    if not usable.any():
        raise DataError(
            "frf/inputs-not-separable",
            f"its records do not separate the {len(first.inputs)} inputs ({', '.join(first.inputs)}) at any line, "
            "since one was not excited or two are proportional. Excite each with its own noise, or omit the unexcited "
            "channel",
            f"configuration {first.configuration.name}",
        )
    is_padded = records[0] is not full_records[0]
    complete = usable & ~_is_truncated(full_records, segments, spec, data) if is_padded else usable
    data, L = data.on(complete if complete.any() else usable), len(segments.window)
    G = data.yu @ np.linalg.inv(data.uu)
    covariance, total, beta, C_V = _covariances(data, G, segments, _by_leverage(records, segments, spec, data, G))
    quality = _quality(data, G, C_V)
    notes = [*notes_of(records)]
    if not usable.all():
        text = f"DFT lines discarded ({np.sum(~usable)}): an input has no power there, or two are proportional"
        notes.append(Note("frf/lines-discarded", text))
    length = f"{L / first.rate_hz:g} s ({L} samples)" if first.has_rate else f"{L} samples"
    text = (
        f"h1 from {data.K} segments of {length}, window {spec.window}, overlap {percent(1 - segments.step / L, 2)}; "
        f"equivalent to {data.K_e:.3g} independent segments"
    )
    notes.append(Note("frf/segment", text, severity="information"))
    # Only 10 dB above the noise, because leakage dominates the variance at an unresolved peak.
    modes = local_modes(data.freq_hz, G, covariance.variance / 4)
    notes += dependent_input_notes(quality, "excite each with its own noise")
    notes += segment_notes(modes, data.freq_hz, first)
    response = measured_response(
        first, spec.quantity, data.freq_hz, G, noise=covariance, total=total, quality=quality, notes=tuple(notes)
    )
    response = replace(response, window=spec.window, segment_s=L / first.rate_hz)
    return replace(response, correlated_lines=segments.correlated_lines, leakage=beta)


def _is_truncated(records: Sequence[Record], segments: Segments, spec: EstimatorSpec, data: CrossSpectra) -> BoolArray:
    """Return flags (F,) of lines that a sweep reaches at or after the end of its record. data: zero-padded records."""
    lines, _, scale = _lines(records[0], segments, spec)
    w, n_y = segments.window, data.n_y
    n = max(1, round(_END * len(w)))
    rise = np.sin(np.pi / 2 * np.arange(1, n + 1) / n)[:, None] ** 2  # truncated at the end only
    ends = [rise * (record.u - record.u.mean(axis=0))[-n:] for record in records]
    at_end = np.sum([np.abs(rfft(end, len(w), axis=0)[lines] * scale[:, n_y:]) ** 2 for end in ends], axis=0)
    return np.asarray(np.any(at_end > _MAX_END_FRACTION * (power(data.uu) * segments.step / np.sum(w**2)), axis=1))


def _covariances(
    data: CrossSpectra, G: ComplexArray, segments: Segments, C_h: ComplexArray
) -> tuple[Covariance, Covariance, ComplexArray, ComplexArray]:
    """Return noise and total covariance of vec G, beta, and the covariance of V = Y - G U in one segment.

    C_h (F, n_y, n_y): see `_by_leverage`.
    """
    dof = data.K_e - G.shape[2]
    cross = data.yu @ G.mT.conj()
    S_V = data.yy - cross - cross.mT.conj() + G @ data.uu @ G.mT.conj()
    # For exact data rounding errors can make the residual negative.
    S_V = S_V + np.eye(data.n_y) * np.maximum(-np.linalg.eigvalsh(S_V)[:, :1, None], 0.0)
    C_V = S_V * (data.K_e / data.K / dof)
    input_factor = np.asarray(np.linalg.inv(data.uu), np.complex128).mT * (data.K / data.K_e)
    beta = _leakage(G, power(C_V)[:, :, None] * power(input_factor)[:, None, :], segments)
    scaled_beta = beta / np.sqrt(G.shape[2] * power(input_factor))[:, None, :]
    by_noise, by_leverage = power(C_V), power(C_h)
    factor = np.sqrt(np.maximum(local_mean(quotient(by_leverage, by_noise, 1.0)), 1.0))
    C_total = factor[:, :, None] * C_V * factor[:, None] + scaled_beta @ scaled_beta.mT.conj()
    noise, total = (kronecker(input_factor, C, dof) for C in (C_V, C_total))
    return noise, total, beta, C_V


def _leakage(G: ComplexArray, variance: FloatArray, segments: Segments) -> ComplexArray:
    """Return beta (F, n_y, n_u) of G, its square corrected for noise of the variance (F, n_y, n_u)."""
    weights, noise = segments.leakage
    F, m = len(G), len(weights) // 2
    if m >= F:
        return np.zeros_like(G)
    lines = np.pad(G, ((m, m), (0, 0), (0, 0)), "reflect", reflect_type="odd")
    beta = np.sum([weight * lines[i : i + F] for i, weight in enumerate(weights)], axis=0)
    return np.asarray(beta * np.sqrt(np.maximum(1 - noise * variance / np.maximum(np.abs(beta) ** 2, 1e-300), 0.0)))


def _quality(data: CrossSpectra, G: ComplexArray, C_V: ComplexArray) -> Quality:
    """Return the quality; the noise of the inputs is unknown and taken as 0."""
    noise, coherence = power(C_V), coherences(power(data.yy), data.yu, data.uu)
    amplitudes = LineAmplitudes(data.freq_hz, np.sqrt(power(data.yy) / data.K), np.sqrt(noise / data.K_e))
    return quality_of(G, data.uu / data.K, coherence, (np.zeros((len(G), G.shape[2])), noise), amplitudes)
