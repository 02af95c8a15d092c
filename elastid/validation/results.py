r"""The results of validation as values: agreements, folds, and resonances of an element between its lines.

.. math:: f_r^2 = \arg\min_x p(x), \qquad p(f^2) \text{ a parabola through } 1/|G|^2 \text{ near a peak of } |G|

1/|G|^2 of a single mode is a parabola in f^2, however sharp its peak between two lines; one through log |G| is not.
Antiresonances are the resonances of 1/G.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text
from elastid.validation.predicted import PredictedResponse
from elastid.validation.residual_tests import FALSE_ALARM, exceeds_by_chance, together

PeakKind: TypeAlias = Literal["resonance", "antiresonance"]


@dataclass(frozen=True)
class PeakLimits:
    """Limits of the judgement of peaks."""

    min_prominence_db: float = 3.0
    min_prominence_sigmas: float = 6.0  # the same in standard deviations
    max_frequency_ratio: float = 1.25  # up to which two frequencies may be of the same mode


PEAKS = PeakLimits()


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
    freq_hz: FloatArray,
    G: ComplexArray,
    std: FloatArray | None = None,
    prominence_db: float = PEAKS.min_prominence_db,
    sign: int = 1,
) -> FloatArray:
    """Frequencies (n,) of the peaks of |G| (F,) (sign 1) or of its dips (-1), increasing, none at the ends of the band.

    A peak has a prominence of prominence_db, and with std (F,) of G of 6 standard deviations, in |G| or in 1/|G|, one
    of which may be mostly noise.  An element that is zero somewhere has none.
    """
    from scipy.signal import find_peaks  # slow to load, and a fit looks for no peaks

    magnitude = np.abs(G)
    if len(G) < 3 or not np.all(magnitude > 0):
        return np.array([])
    level, std = sign * 20 * np.log10(magnitude), np.zeros(len(G)) if std is None else std
    peaks, of_peaks = find_peaks(level, prominence=prominence_db)
    left, right = of_peaks["left_bases"], of_peaks["right_bases"]
    base = np.where(level[left] > level[right], left, right)  # from which prominence counts
    pairs = ((magnitude, std), (1 / magnitude, std / magnitude**2))
    sigmas = [np.abs(m[peaks] - m[base]) / np.maximum(np.hypot(s[peaks], s[base]), 1e-300) for m, s in pairs]
    is_significant = np.max(sigmas, axis=0) > PEAKS.min_prominence_sigmas / math.sqrt(2)
    return np.array([_minimum(freq_hz, magnitude ** (-2 * sign), peak) for peak in peaks[is_significant].tolist()])


def paired_resonances(measured: FloatArray, modelled: FloatArray) -> FloatArray:
    """The modelled partner (n,) of each measured frequency: mutually nearest on a logarithmic axis, NaN without one."""
    partner = np.full(len(measured), np.nan)
    if len(measured) == 0 or len(modelled) == 0:
        return partner
    distance = np.abs(np.log(measured[:, None] / modelled[None, :]))
    nearest, rows = distance.argmin(axis=1), np.arange(len(measured))
    is_mutual = distance.argmin(axis=0)[nearest] == rows
    near = is_mutual & (distance[rows, nearest] < math.log(PEAKS.max_frequency_ratio))
    partner[near] = modelled[nearest[near]]
    return partner


def _minimum(freq_hz: FloatArray, p: FloatArray, line: int) -> float:
    """Frequency of the minimum of a parabola through p (F,) over f^2, at the lines around a low one.

    As many on either side, those within 1.5 dB of it, at least one; beyond may be other modes.
    """
    above = np.flatnonzero(np.append(p > 1.4 * p[line], True))
    before = above[above < line][-1] if np.any(above < line) else -1
    reach = max(1, min(line - before, above[above > line][0] - line) - 1)
    near = slice(line - reach, line + reach + 1)
    low, middle, high = freq_hz[[near.start, line, near.stop - 1]] ** 2
    x = (freq_hz[near] ** 2 - middle) / (high - low)
    a, b, _ = np.linalg.lstsq(np.vander(x, 3), p[near] / p[line])[0].tolist()
    return math.sqrt(min(max(middle - b / (2 * a) * (high - low), low), high) if a > 0 else middle)


@frozen_value
class Agreement:
    """Agreement of the model of a configuration with its measurement; arrays by element (n_y, n_u).

    lines: judged for magnitude and phase.  rms_log_db: of 20 log10 |Ghat / G|.  phase_rms_deg: of the wrapped phase of
    Ghat / G.  inside_2sigma: share of all lines with |E| <= 2 sigma; inside_expected: that of a true model, given its
    degrees of freedom.  rms_sigma: of E / sigma, 1 for a true model.
    power_ratio, power_dof: as `power_over_noise`.  white_p: as `white_by_chance`.  NaN without an uncertainty or lines.
    """

    configuration: str
    left_out: bool
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    lines: IntArray = labelled("lines judged for magnitude and phase", "", "outputs inputs")
    rms_log_db: FloatArray = labelled("rms of 20 log10 |measured / modelled|", "dB", "outputs inputs")
    phase_rms_deg: FloatArray = labelled("rms of the phase of measured / modelled", "deg", "outputs inputs")
    inside_2sigma: FloatArray = labelled("share of the lines within 2 standard deviations", "", "outputs inputs")
    inside_expected: float
    rms_sigma: FloatArray = labelled("rms of the residual over its standard deviation", "", "outputs inputs")
    peaks: tuple[Peak, ...]
    power_ratio: float = math.nan
    power_dof: float = 0.0
    white_p: float = math.nan

    @property
    def overall_rms_log_db(self) -> float:
        """Magnitude error over all judged lines of all elements, dB."""
        return pooled_rms(self.rms_log_db, self.lines)

    @property
    def overall_phase_rms_deg(self) -> float:
        """Phase error over all judged lines of all elements, degrees."""
        return pooled_rms(self.phase_rms_deg, self.lines)

    @property
    def overall_inside_2sigma(self) -> float:
        """Share of the lines of all elements within 2 sigma."""
        return _known_mean(self.inside_2sigma)

    @property
    def overall_rms_sigma(self) -> float:
        """Residual over its standard deviation, rms over all elements with one."""
        return math.sqrt(_known_mean(self.rms_sigma**2))

    @property
    def is_white(self) -> bool:
        """True if the residuals of neighbouring lines are uncorrelated, as `are_white`."""
        return are_white([self])

    def worst(self, kind: PeakKind) -> Peak | None:
        """The resonance or antiresonance whose modelled frequency is furthest off; None where none was matched."""
        matched = [peak for peak in self.peaks if peak.kind == kind and math.isfinite(peak.modelled_hz)]
        return max(matched, key=lambda peak: abs(peak.error_percent), default=None)


def _known_mean(values: FloatArray) -> float:
    """Mean of the values that are not NaN; NaN without any."""
    known = np.isfinite(values)
    return float(values[known].mean()) if known.any() else math.nan


def pooled_rms(rms: FloatArray, lines: IntArray) -> float:
    """Root mean square over elements or configurations of so many lines each, NaN without lines."""
    some = lines > 0
    return float(np.sqrt(np.average(rms[some] ** 2, weights=lines[some]))) if some.any() else math.nan


def are_white(agreements: Sequence[Agreement]) -> bool:
    """True if the residuals of all configurations together are white; of white ones FALSE_ALARM are called coloured."""
    return not together([each.white_p for each in agreements]) < FALSE_ALARM


def noise_p(agreements: Sequence[Agreement], cost_p: float = math.nan) -> float:
    """P(as much power in the residuals) by noise alone, and of the cost cost_p; NaN where no noise is known.

    Of the two the smaller, doubled: that either is below FALSE_ALARM has at most its probability.
    """
    known = [p for p in (exceeds_by_chance(*power_ratio(agreements)), cost_p) if math.isfinite(p)]
    return min(1.0, len(known) * min(known)) if known else math.nan


def power_ratio(agreements: Sequence[Agreement]) -> tuple[float, float]:
    """Power of the residuals over that of the noise, of all configurations together, and its degrees of freedom."""
    known = [(a.power_dof, a.power_ratio) for a in agreements if math.isfinite(a.power_ratio) and a.power_dof > 0]
    dof = sum(own for own, _ in known)
    return (sum(own * ratio for own, ratio in known) / dof, dof) if known else (math.nan, 0.0)


@dataclass(frozen=True)
class Fold:
    """A configuration predicted by the fit to others: misfit (mean |E|^2 / sigma^2), dB rms, degrees rms.

    NaN where the fit without it failed; message then says why.
    """

    configuration: str
    misfit: float
    rms_log_db: float
    phase_rms_deg: float
    message: str = ""


@frozen_value
class Validation:
    """The agreement of every configuration, in the order measured, and the verdict on the model in one sentence.

    cost: explanation of the cost of the fit, in words.  folds: cross-validation, where asked for; folded: its summary.
    predictions: of left-out configurations and of records at the tool, by `Result.at`.
    """

    configurations: tuple[Agreement, ...] = labelled(entry="configuration")
    verdict: str
    cost: str = ""
    folds: tuple[Fold, ...] = ()
    folded: str = ""
    predictions: tuple[PredictedResponse, ...] = ()

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """The verdict, and the agreement of each configuration."""
        shares = [a.overall_inside_2sigma for a in self.configurations]
        rows = [
            (
                a.configuration, "left out" if a.left_out else "fitted", f"{a.overall_rms_log_db:.2g}",
                f"{a.overall_phase_rms_deg:.2g}", f"{100 * share:.3g} %" if math.isfinite(share) else "unknown",
            )
            for a, share in zip(self.configurations, shares, strict=True)
        ]  # fmt: skip
        headings = ("configuration", "in the fit", "magnitude, dB rms", "phase, degrees rms", "lines within 2 sigma")
        return Display(f"Validation: {self.verdict}", headings, rows)

    @property
    def at_tool(self) -> tuple[PredictedResponse, ...]:
        """The predictions of forces and torques at frames."""
        return tuple(each for each in self.predictions if each.measured.inputs[0].startswith(("force ", "torque ")))

    @property
    def fitted(self) -> tuple[Agreement, ...]:
        """Configurations that were fitted."""
        return tuple(agreement for agreement in self.configurations if not agreement.left_out)

    @property
    def left_out(self) -> tuple[Agreement, ...]:
        """Configurations that were not."""
        return tuple(agreement for agreement in self.configurations if agreement.left_out)
