r"""Resonances and antiresonances of one element of a measured or modelled FRF, found between its lines.

.. math:: f_r = \arg\min_f |p(f)|^2, \qquad p \text{ a complex quadratic through } 1/G \text{ near a peak of } |G|

1/G of a single mode is a quadratic in f, however sharp its peak between two lines; a parabola through log |G| is not.
Antiresonances are the resonances of 1/G.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray

# A bump counts as a peak from this prominence on, and from so many standard deviations of it ...
MIN_PROMINENCE_DB = 3.0
MIN_PROMINENCE_SIGMAS = 6.0
# ... and if the standard deviation of its frequency, relative, is below this.
MAX_FREQUENCY_STD = 0.01
# Frequencies further apart than this factor are not of the same mode.
MAX_FREQUENCY_RATIO = 1.25

PeakKind: TypeAlias = Literal["resonance", "antiresonance"]


@dataclass(frozen=True)
class Peak:
    """A resonance or antiresonance of one element as measured and as modelled; modelled_hz is NaN without a partner."""

    output: str
    input: str
    kind: PeakKind
    measured_hz: float
    modelled_hz: float

    @property
    def error_percent(self) -> float:
        """Modelled against measured frequency."""
        return 100 * (self.modelled_hz / self.measured_hz - 1)


def resonances(
    freq_hz: FloatArray, G: ComplexArray, std: FloatArray | None = None, prominence_db: float = MIN_PROMINENCE_DB
) -> FloatArray:
    """Frequencies (n,) of the peaks of |G| (F,), increasing, none at the ends of the band.

    A peak has a prominence of prominence_db; with std (F,) of G, also of 6 standard deviations, and the standard
    deviation of its frequency is below 1 %.
    """
    return _peaks(freq_hz, G, np.zeros(len(G)) if std is None else std, prominence_db, sign=1)


def antiresonances(
    freq_hz: FloatArray, G: ComplexArray, std: FloatArray | None = None, prominence_db: float = MIN_PROMINENCE_DB
) -> FloatArray:
    """Frequencies (n,) of the dips of |G| (F,), increasing, under the same conditions."""
    return _peaks(freq_hz, G, np.zeros(len(G)) if std is None else std, prominence_db, sign=-1)


def paired_resonances(measured: FloatArray, modelled: FloatArray) -> FloatArray:
    """The modelled partner (n,) of each measured frequency: mutually nearest on a logarithmic axis, NaN without one."""
    partner = np.full(len(measured), np.nan)
    if len(measured) == 0 or len(modelled) == 0:
        return partner
    distance = np.abs(np.log(measured[:, None] / modelled[None, :]))
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(measured))
    mutual = (distance.argmin(axis=0)[nearest] == rows) & (distance[rows, nearest] < math.log(MAX_FREQUENCY_RATIO))
    partner[mutual] = modelled[nearest[mutual]]
    return partner


def _peaks(freq_hz: FloatArray, G: ComplexArray, std: FloatArray, prominence_db: float, sign: int) -> FloatArray:
    """Peaks (sign 1) or dips (-1) that are prominent and can be located; an element that is zero somewhere has none."""
    magnitude = np.abs(G)
    if len(G) < 3 or not np.all(magnitude > 0):
        return np.array([])
    level = sign * np.log(magnitude)
    p, std_p = (1 / G, std / magnitude**2) if sign > 0 else (G, std)
    found = []
    for peak in _local_maxima(level):
        base = _base(level, peak)
        prominent = level[peak] - level[base] > prominence_db * math.log(10) / 20
        if prominent and _is_significant(magnitude[[peak, base]], std[[peak, base]]):
            f, std_f = _minimum(freq_hz, p, std_p, peak)
            if std_f < MAX_FREQUENCY_STD * f:
                found.append(f)
    return np.array(found)


def _is_significant(magnitude: FloatArray, std: FloatArray) -> bool:
    """Whether two lines differ by 6 standard deviations in |G| or in 1/|G|; one of the two may be mostly noise."""
    pairs = ((magnitude, std), (1 / magnitude, std / magnitude**2))
    return any(abs(m[0] - m[1]) > MIN_PROMINENCE_SIGMAS * math.hypot(*s) / math.sqrt(2) for m, s in pairs)


def _local_maxima(level: FloatArray) -> list[int]:
    inner = level[1:-1]
    return [int(i) + 1 for i in np.flatnonzero((inner > level[:-2]) & (inner >= level[2:]))]


def _base(level: FloatArray, peak: int) -> int:
    """The line from which prominence counts: the higher of the two lowest lines between the peak and higher ones."""
    higher = np.flatnonzero(level > level[peak])
    first = int(higher[higher < peak][-1]) if np.any(higher < peak) else 0
    last = int(higher[higher > peak][0]) if np.any(higher > peak) else len(level) - 1
    left = first + int(level[first : peak + 1].argmin())
    right = peak + int(level[peak : last + 1].argmin())
    return left if level[left] > level[right] else right


def _minimum(freq_hz: FloatArray, p: ComplexArray, std: FloatArray, line: int) -> tuple[float, float]:
    """Frequency of the minimum of |p| near a line, and its standard deviation.

    p = a + b t + c t^2 is fitted to the lines within 3 dB of the lowest; |p| is least where g = Re(p* p') = 0, a cubic.
    """
    window = _within_3db(np.abs(p), line)
    width = freq_hz[window][-1] - freq_hz[window][0]
    t = (freq_hz[window] - freq_hz[line]) / width
    X = t[:, None] ** np.arange(3)
    scale = np.abs(p[window]).max()
    a, b, c = np.linalg.lstsq(X, p[window] / scale, rcond=None)[0]
    cubic = (2 * abs(c) ** 2, 3 * (b * c.conj()).real, abs(b) ** 2 + 2 * (a * c.conj()).real, (a * b.conj()).real)
    roots = np.roots(cubic)
    roots = roots.real[np.abs(roots.imag) < 1e-9]
    # The ends of the window are candidates too: the minimum of the quadratic may be outside it.
    candidates = np.concatenate([t[[0, -1]], roots[(roots >= t[0]) & (roots <= t[-1])]])
    t_r = candidates[np.abs(a + b * candidates + c * candidates**2).argmin()]

    p_r, slope = a + b * t_r + c * t_r**2, b + 2 * c * t_r
    w = slope * np.array([1, t_r, t_r**2]) + p_r * np.array([0, 1, 2 * t_r])
    variance_g = np.mean((std[window] / scale) ** 2) / 2 * (w.conj() @ np.linalg.solve(X.T @ X, w)).real
    curvature = abs(slope) ** 2 + (p_r.conj() * 2 * c).real
    return float(freq_hz[line] + width * t_r), float(width * np.sqrt(variance_g) / abs(curvature))


def _within_3db(magnitude: FloatArray, line: int) -> slice:
    """The lines around a low one within 3 dB of it, as many on either side, at least one; beyond may be other modes."""
    above = np.flatnonzero(magnitude > math.sqrt(2) * magnitude[line])
    left = line - 1 - (int(above[above < line][-1]) if np.any(above < line) else -1)
    right = (int(above[above > line][0]) if np.any(above > line) else len(magnitude)) - 1 - line
    reach = max(1, min(left, right))
    return slice(line - reach, line + reach + 1)
