r"""Bandwidths of modes, compared with the windows of a local method.

A polynomial follows G over a window narrower than the modal bandwidth 2 zeta f_0, and flattens peaks in a wider one.  A
rational function of degree d follows d modes in a window however narrow they are.  Modes are the peaks of the response
itself: bandwidth is their width at half power,

.. math:: ||G(f_0 \pm \zeta f_0)||^2 \approx ||G(f_0)||^2 / 2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note


@dataclass(frozen=True)
class LocalModes:
    """Peaks of a response at freq_hz (n,) with bandwidth_hz (n,), their width at half power."""

    freq_hz: FloatArray
    bandwidth_hz: FloatArray


def local_modes(freq_hz: FloatArray, G: ComplexArray, variance: FloatArray) -> LocalModes:
    """Peaks of the Frobenius norm of G (F, n_y, n_u) that fall to half power on both sides before they rise again.

    Peaks that do not stand out of the variance of G by 16 dB are ignored.
    """
    power = np.sum(np.abs(G) ** 2, axis=(1, 2))
    peaks = 1 + np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]))
    modes = []
    # 16 dB: noise alone does not halve such a peak on both sides.
    for peak in peaks[power[peaks] > 40.0 * variance.sum(axis=(1, 2))[peaks]]:
        below = _half_power(freq_hz[peak::-1], power[peak::-1])
        above = _half_power(freq_hz[peak:], power[peak:])
        if below is not None and above is not None:
            modes.append((freq_hz[peak], above - below))
    f_0, width = np.array(modes).reshape(-1, 2).T
    return LocalModes(f_0, width)


def wide_windows(modes: LocalModes, freq_hz: FloatArray, span_hz: FloatArray, poles: int) -> list[Note]:
    """A note on modes for which windows of span_hz (F,) at freq_hz are too wide; poles: degree d, 0 for polynomials."""
    span = np.interp(modes.freq_hz, freq_hz, span_hz)
    if poles == 0:
        wide = np.flatnonzero(span > modes.bandwidth_hz)
        if wide.size == 0:
            return []
        worst = wide[np.argmax(span[wide] / modes.bandwidth_hz[wide])]
        return [
            Note(
                "wide-windows",
                f"the windows are wider than the bandwidth of {wide.size} of {len(span)} modes: {span[worst]:.3g} Hz "
                f"at {modes.freq_hz[worst]:.4g} Hz, where the mode is {modes.bandwidth_hz[worst]:.3g} Hz wide; its "
                "peak may be flattened: take method local_rational, a longer period or record, or more experiments",
            )
        ]
    inside = np.array([np.sum(np.abs(modes.freq_hz - f) <= s / 2) for f, s in zip(modes.freq_hz, span, strict=True)])
    crowded = np.flatnonzero(inside > poles)
    if crowded.size == 0:
        return []
    worst = crowded[np.argmax(inside[crowded])]
    return [
        Note(
            "crowded-window",
            f"{inside[worst]} modes share a window of {span[worst]:.3g} Hz at {modes.freq_hz[worst]:.4g} Hz, which has "
            f"poles for {poles}; take a longer period or record, more experiments or a higher local_order",
        )
    ]


def _half_power(freq_hz: FloatArray, power: FloatArray) -> float | None:
    """Frequency where the power (F,) from a peak, its first entry, on has halved; None where it rises before."""
    half = np.flatnonzero(power < power[0] / 2)
    if half.size == 0 or np.any(power[: half[0]] > power[0]):
        return None
    i = int(half[0])
    part = (power[i - 1] - power[0] / 2) / (power[i - 1] - power[i])
    return float(freq_hz[i - 1] + part * (freq_hz[i] - freq_hz[i - 1]))
