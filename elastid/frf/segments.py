"""Segments of a record under a window, and how long they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import inputs_pass
from elastid.record import Record

# Numbers in a segment of all channels that `auto` takes at most.
_MAX_NUMBERS = 1 << 20
# Of a window's power on its middle line: lines with less of it leak nothing that counts.
_LEAST_LEAKAGE = 1e-4


@dataclass(frozen=True)
class Segments:
    """Segments of L samples under a window (L,), each `step` after the last."""

    window: FloatArray
    step: int

    def count(self, n_samples: int) -> int:
        """Whole segments in a record."""
        return max(0, 1 + (n_samples - len(self.window)) // self.step)

    def padded(self, record: Record) -> Record:
        """The record between zeros where w^2 of its segments are to add up to a constant, so to its ends."""
        zeros = len(self.window) - self.step
        if 2 * zeros <= len(self.window):
            return record
        u, y = (np.pad(x - x.mean(axis=0), ((zeros, zeros), (0, 0))) for x in (record.u, record.y))
        return replace(record, u=u, y=y, r=None, period_samples=len(u))

    @property
    def correlated_lines(self) -> float:
        r"""Lines over which the errors of cross spectra are correlated: sum_l |rho_l|^2 of the window's spectrum.

        .. math:: \rho_l = \sum_n w^2(n) e^{-2\pi j l n / L} / \sum_n w^2(n)

        1 for a boxcar, 1.94 for Hann's window.
        """
        power = self.window**2
        return float(len(power) * np.sum(power**2) / np.sum(power) ** 2)

    @property
    def leakage(self) -> tuple[FloatArray, float]:
        """Weights (2 m + 1,) of neighbouring lines in beta, and variance of beta by noise over that of H."""
        power = np.abs(rfft(self.window)) ** 2
        m = min(int(np.flatnonzero(power > _LEAST_LEAKAGE * power[0])[-1]), len(power) // 4)
        kernel = np.concatenate([power[m:0:-1], power[: m + 1]])
        weights = kernel / kernel.sum() - (np.arange(2 * m + 1) == m)
        correlation = np.abs(rfft(self.window**2) / np.sum(self.window**2))[: 2 * m + 1] ** 2
        lags = np.arange(2 * m + 1)
        return weights, float(weights @ correlation[np.abs(lags[:, None] - lags)] @ weights)

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
        return float(K / (1 + 2 * sum((1 - j / K) * rho_j for j, rho_j in zip(shifts, rho, strict=True))))


def make_segments(records: Sequence[Record], spec: EstimatorSpec) -> Segments:
    """The segments that the spec asks for; `auto` takes the longest power of two that leaves enough of them.

    Raises DataError where they are too few for a variance, or longer than a record.
    """
    from scipy.signal import get_window

    first, n_u = records[0], len(records[0].inputs)
    lengths = [record.n_samples for record in records]

    def segments_of(L: int) -> Segments:
        window = np.asarray(get_window(spec.window, L), dtype=np.float64)
        return Segments(window, max(1, L - L // 2))

    where = f"configuration {first.configuration.name}: "
    if spec.segment != "auto":
        L = round(spec.segment * first.rate_hz)
        if L < 4:
            raise DataError(
                "frf/segment",
                f"{where}estimator.segment {spec.segment:g} s is {L} samples; give {4 / first.rate_hz:g} s or more",
            )
        segments = segments_of(L)
    else:
        wanted = max(16, 8 * n_u)
        most = _MAX_NUMBERS // (len(first.outputs) + n_u)
        L = 2 ** int(np.log2(min(max(lengths), most)))
        segments = segments_of(L)
        while L > 8 and sum(map(segments.count, lengths)) < wanted:
            L //= 2
            segments = segments_of(L)
    if sum(map(segments.independent, lengths)) < n_u + 1:
        longest = max(lengths) / first.rate_hz
        raise DataError(
            "frf/segment",
            f"{where}{sum(map(segments.count, lengths))} segments of {L / first.rate_hz:g} s leave no degree of "
            f"freedom for {n_u} inputs in records of up to {longest:g} s; give estimator.segment "
            f"{longest / (2 * n_u + 2):.3g} or less, or take estimator.method local_rational",
        )
    return replace(segments, step=max(1, L // 4)) if inputs_pass(records) else segments
