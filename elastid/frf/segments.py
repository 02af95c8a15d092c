"""Segments of records without a period, and the cross spectra that they sum up to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.base.mapped import release
from elastid.excitation.grids import line_frequencies
from elastid.frf.matrices import adjoint
from elastid.frf.spec import EstimatorSpec
from elastid.record import MOTION_ORDER, Record

# Segments that `auto` wants at least, of all records together, and for each input.
_MIN_SEGMENTS = 16
_MIN_SEGMENTS_PER_INPUT = 8
# Numbers in a segment of all channels that `auto` takes at most.
_MAX_NUMBERS = 1 << 20
# Numbers in the segments that are transformed at once: 32 MB.
_NUMBERS_AT_ONCE = 4_000_000


@dataclass(frozen=True)
class Segments:
    """Segments of L samples under a window (L,), each `step` after the last."""

    window: FloatArray
    step: int

    def count(self, n_samples: int) -> int:
        """Whole segments in a record."""
        return max(0, 1 + (n_samples - len(self.window)) // self.step)

    @property
    def correlated_lines(self) -> float:
        r"""Lines over which the errors of cross spectra are correlated: sum_l |rho_l|^2 of the window's spectrum.

        .. math:: \rho_l = \sum_n w^2(n) e^{-2\pi j l n / L} / \sum_n w^2(n)

        1 for a boxcar, 1.94 for Hann's window.
        """
        power = self.window**2
        return float(len(power) * np.sum(power**2) / np.sum(power) ** 2)

    def independent(self, n_samples: int) -> float:
        r"""K_e of a record's K segments: the variance of a mean of white noise's power falls by it.

        .. math:: K_e = K / \left(1 + 2 \sum_{j=1}^{K-1} (1 - j/K) \rho_j\right), \quad
                  \rho_j = \left(\frac{\sum_n w(n) w(n + jD)}{\sum_n w^2(n)}\right)^2
        """
        K, w, D = self.count(n_samples), self.window, self.step
        if K == 0:
            return 0.0
        shifts = range(1, min(K, -(-len(w) // D)))
        rho = [(np.dot(w[: -j * D], w[j * D :]) / np.dot(w, w)) ** 2 for j in shifts]
        return float(K / (1 + 2 * sum((1 - j / K) * each for j, each in zip(shifts, rho, strict=True))))


@dataclass(frozen=True)
class CrossSpectra:
    """S (F, n, n), the sum of Z Z^H over K segments of Z = [Y; U], as complex amplitudes; K_e of them independent."""

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

    def on(self, lines: BoolArray) -> CrossSpectra:
        """The same on some of its lines (F,)."""
        return self if lines.all() else CrossSpectra(self.S[lines], self.n_y, self.K, self.K_e)


def make_segments(records: Sequence[Record], spec: EstimatorSpec) -> Segments:
    """The segments that the spec asks for; `auto` takes the longest power of two that leaves enough of them.

    Raises DataError where they are too few for a variance, or longer than a record.
    """
    from scipy.signal import get_window

    first, n_u = records[0], len(records[0].inputs)
    lengths = [record.n_samples for record in records]

    def of(L: int) -> Segments:
        window = np.asarray(get_window(spec.window, L), dtype=np.float64)
        return Segments(window, max(1, L - int(spec.overlap * L)))

    where = f"configuration {first.configuration.name}: "
    if spec.segment != "auto":
        L = round(spec.segment * first.rate_hz)
        if L < 4:
            raise DataError(
                f"{where}estimator.segment {spec.segment:g} s is {L} samples; give {4 / first.rate_hz:g} s or more"
            )
        segments = of(L)
    else:
        wanted = max(_MIN_SEGMENTS, _MIN_SEGMENTS_PER_INPUT * n_u)
        most = _MAX_NUMBERS // (len(first.outputs) + n_u)
        L = 2 ** int(np.log2(min(max(lengths), most)))
        segments = of(L)
        while L > 8 and sum(map(segments.count, lengths)) < wanted:
            L //= 2
            segments = of(L)
    if sum(map(segments.independent, lengths)) < n_u + 1:
        longest = max(lengths) / first.rate_hz
        raise DataError(
            f"{where}{sum(map(segments.count, lengths))} segments of {L / first.rate_hz:g} s leave no degree of "
            f"freedom for {n_u} inputs in records of up to {longest:g} s; give estimator.segment "
            f"{longest / (2 * n_u + 2):.3g} or less, or take estimator.method local_rational"
        )
    return segments


def cross_spectra(records: Sequence[Record], segments: Segments, lines: IntArray, spec: EstimatorSpec) -> CrossSpectra:
    """Sums over all segments at lines (F,), each segment less its mean; outputs as `quantity`, torque as it acts."""
    first, w, D = records[0], segments.window, segments.step
    L, n_y = len(w), len(first.outputs)
    n = n_y + len(first.inputs)
    S = np.zeros((len(lines), n, n), dtype=np.complex128)
    at_once = max(1, _NUMBERS_AT_ONCE // (L * n))
    for record in records:
        for begin in range(0, segments.count(record.n_samples), at_once):
            K = min(at_once, segments.count(record.n_samples) - begin)
            part = slice(begin * D, (begin + K - 1) * D + L)
            signals = np.ascontiguousarray(np.concatenate([record.y[part], record.u[part]], axis=1).T)
            cut = np.lib.stride_tricks.sliding_window_view(signals, L, axis=1)[:, ::D]
            cut = (cut - cut.mean(axis=2, keepdims=True)) * w
            Z = np.moveaxis(rfft(cut, axis=2)[:, :, lines], 2, 0)
            S += Z @ adjoint(Z)
            release(record.y)
            release(record.u)
    freq_hz = line_frequencies(lines, first.rate_hz, L)
    order = np.array([MOTION_ORDER[spec.quantity] - MOTION_ORDER[each] for each in first.quantities])
    scale = np.empty((len(lines), n), dtype=np.complex128)
    scale[:, :n_y] = (2j * np.pi * freq_hz[:, None]) ** order
    scale[:, n_y:] = first.hold_response(freq_hz)
    scale *= 2 / w.sum()
    S *= scale[:, :, None] * scale[:, None, :].conj()
    lengths = [record.n_samples for record in records]
    return CrossSpectra(S, n_y, sum(map(segments.count, lengths)), sum(map(segments.independent, lengths)))
