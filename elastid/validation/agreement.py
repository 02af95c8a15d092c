"""How far the modelled FRFs are from the measured ones, fitted and left-out configurations apart.

    E(k) = Ghat(k) - G(k),   sigma^2(k) = measured variance of Ghat(k)

The variance that few realisations gave is smoothed over neighbouring lines, as for the fit. Magnitude and phase are
judged on the lines where |Ghat| is at least 2 sigma; the statistical tests use every line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen
from elastid.base.errors import StudyError
from elastid.response import FrequencyResponse
from elastid.validation.cross_validation import Fold, carries_over
from elastid.validation.replay import Replay
from elastid.validation.residual_tests import (
    NORMAL_BELOW,
    above_2sigma,
    autocorrelation,
    coloured_by_chance,
    inside_expected,
    normality,
    sigma_of,
)
from elastid.validation.resonances import PROMINENCE_DB, antiresonances, paired_resonances, resonances

_ARRAYS = (
    "rms_log_db",
    "phase_rms_deg",
    "inside_2sigma",
    "autocorrelation",
    "autocorrelation_bound",
    "rms_sigma",
    "normality",
)

# Standard deviations that chance exceeds once in a hundred times.
CHANCE = 2.326

Kind: TypeAlias = Literal["resonance", "antiresonance"]
FINDERS: dict[Kind, Callable[..., FloatArray]] = {"resonance": resonances, "antiresonance": antiresonances}


@dataclass(frozen=True)
class Peak:
    """A resonance or antiresonance of one element as measured and as modelled; modelled_hz is NaN where it has none."""

    output: str
    input: str
    kind: Kind
    measured_hz: float
    modelled_hz: float

    @property
    def error_percent(self) -> float:
        """Modelled against measured frequency."""
        return 100 * (self.modelled_hz / self.measured_hz - 1)


@dataclass(frozen=True)
class Agreement:
    """How well one configuration's model agrees with its measurement; arrays by element (n_y, n_u).

    lines: judged for magnitude and phase.  rms_log_db: of 20 log10 |Ghat / G|.  phase_rms_deg: of the wrapped phase of
    Ghat / G.  inside_2sigma: share of all lines with |E| <= 2 sigma; inside_expected: what a true model would have,
    given its degrees of freedom.  autocorrelation, autocorrelation_bound (3, n_y, n_u): of E / sigma at lags
    of 1 to 3 lines, and what a white residual stays below with 95 % probability.  rms_sigma: of E / sigma, 1 for a
    true model.  normality: Anderson and Darling's statistic of E / sigma, below NORMAL_BELOW for 95 % of normal ones.
    coloured_std: by how much `coloured` scatters where the residuals are white.
    NaN where nothing can be said.
    """

    configuration: str
    left_out: bool
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    lines: IntArray
    rms_log_db: FloatArray
    phase_rms_deg: FloatArray
    inside_2sigma: FloatArray
    inside_expected: float
    autocorrelation: FloatArray
    autocorrelation_bound: FloatArray
    rms_sigma: FloatArray
    normality: FloatArray
    peaks: tuple[Peak, ...]
    coloured_std: float = math.nan

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "lines", frozen(self.lines, np.int64))
        for name in _ARRAYS:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def overall_rms_log_db(self) -> float:
        """Magnitude error over all judged lines of all elements, dB."""
        return _pooled(self.rms_log_db, self.lines)

    @property
    def overall_phase_rms_deg(self) -> float:
        """Phase error over all judged lines of all elements, degrees."""
        return _pooled(self.phase_rms_deg, self.lines)

    @property
    def overall_inside_2sigma(self) -> float:
        """Share of the lines of all elements within 2 sigma."""
        known = np.isfinite(self.inside_2sigma)
        return float(self.inside_2sigma[known].mean()) if known.any() else math.nan

    @property
    def overall_rms_sigma(self) -> float:
        """Residual over its standard deviation, rms over all elements with one."""
        known = np.isfinite(self.rms_sigma)
        return float(np.sqrt(np.mean(self.rms_sigma[known] ** 2))) if known.any() else math.nan

    @property
    def coloured(self) -> float:
        """Share of the autocorrelations beyond their bound: 0.05 for a white residual, NaN without an uncertainty."""
        known = np.isfinite(self.autocorrelation)
        beyond = self.autocorrelation[known] > self.autocorrelation_bound[known]
        return float(beyond.mean()) if known.any() else math.nan

    @property
    def not_normal(self) -> float:
        """Share of the elements whose residual is not normal: 0.05 where it is, NaN without an uncertainty."""
        known = np.isfinite(self.normality)
        return float((self.normality[known] > NORMAL_BELOW).mean()) if known.any() else math.nan

    @property
    def is_white(self) -> bool:
        """Whether no more autocorrelations are beyond their bound than chance allows once in a hundred times."""
        return are_white([self])

    def worst(self, kind: Kind) -> Peak | None:
        """The resonance or antiresonance whose modelled frequency is furthest off; None where none could be matched."""
        found = [peak for peak in self.peaks if peak.kind == kind and math.isfinite(peak.modelled_hz)]
        return max(found, key=lambda peak: abs(peak.error_percent), default=None)


def are_white(agreements: Sequence[Agreement]) -> bool:
    """The same of several configurations together: chance gets one in a hundred, however many they are."""
    tests = np.array([np.isfinite(one.autocorrelation).sum() for one in agreements], dtype=float)
    share = np.array([one.coloured for one in agreements])
    std = np.array([one.coloured_std for one in agreements])
    some = tests > 0
    independent = np.sqrt(0.05 * 0.95 / np.maximum(tests, 1))
    scatter = tests * np.where(np.isfinite(std), np.maximum(std, independent), independent)
    beyond = float(np.sum(tests[some] * (share[some] - 0.05)))
    return beyond <= CHANCE * float(np.sqrt(np.sum(scatter[some] ** 2)))


@dataclass(frozen=True)
class Validation:
    """The agreement of every configuration, in the order measured, and what it means in one sentence.

    cost: why the fit's cost is what it is, in words.  replays: of the records through the model, configuration by
    configuration, as far as there are records; replayed: what they say in one sentence.  folds: cross-validation, where
    asked for; folded: what it says.
    """

    configurations: tuple[Agreement, ...]
    verdict: str
    cost: str = ""
    replays: tuple[Replay, ...] = ()
    replayed: str = ""
    folds: tuple[Fold, ...] = ()
    folded: str = ""

    @property
    def fitted(self) -> tuple[Agreement, ...]:
        """Configurations that the fit has seen."""
        return tuple(agreement for agreement in self.configurations if not agreement.left_out)

    @property
    def left_out(self) -> tuple[Agreement, ...]:
        """Configurations that it has not."""
        return tuple(agreement for agreement in self.configurations if agreement.left_out)


def validate(
    measured: Sequence[FrequencyResponse], modelled: Sequence[FrequencyResponse], left_out: Sequence[str]
) -> Validation:
    """Judge the modelled FRFs, one for each measured one on the same lines; left_out names configurations not fitted.

    Raises StudyError where left_out names a configuration that was not measured, or all of them.
    """
    names = [response.configuration.name for response in measured]
    unknown = [name for name in left_out if name not in names]
    if unknown:
        raise StudyError(
            f"validation.left_out: {', '.join(unknown)} was not measured; configurations are {', '.join(names)}"
        )
    if set(names) <= set(left_out):
        raise StudyError("validation.left_out names every configuration; leave at least one to the fit")
    agreements = tuple(
        agreement(Ghat, G, Ghat.configuration.name in left_out) for Ghat, G in zip(measured, modelled, strict=True)
    )
    return Validation(agreements, _verdict(agreements))


def agreement(measured: FrequencyResponse, modelled: FrequencyResponse, left_out: bool = False) -> Agreement:
    """The errors of one configuration; ValueError where the two responses are not of the same elements and lines."""
    _check_pair(measured, modelled)
    Ghat, G = measured.G, modelled.G
    sigma, dof = sigma_of(measured)
    judged = above_2sigma(measured)
    known = sigma > 0
    e = np.divide(Ghat - G, sigma, out=np.zeros_like(Ghat), where=known)
    r, bound = autocorrelation(e)
    inside = np.where(known.any(axis=0), _mean(np.abs(e) <= 2, known), np.nan)
    return Agreement(
        configuration=measured.configuration.name,
        left_out=left_out,
        outputs=measured.outputs,
        inputs=measured.inputs,
        lines=judged.sum(axis=0),
        rms_log_db=np.sqrt(_mean(_log_ratio_db(Ghat, G, sigma) ** 2, judged)),
        phase_rms_deg=np.sqrt(_mean(np.degrees(np.angle(Ghat * G.conj())) ** 2, judged)),
        inside_2sigma=inside,
        inside_expected=inside_expected(dof),
        autocorrelation=r,
        autocorrelation_bound=bound,
        rms_sigma=np.sqrt(_mean(np.abs(e) ** 2, known)),
        normality=normality(e, dof),
        peaks=_peaks(measured, modelled, sigma),
        coloured_std=coloured_by_chance(e),
    )


def _check_pair(measured: FrequencyResponse, modelled: FrequencyResponse) -> None:
    for name in ("inputs", "outputs", "quantity"):
        if getattr(measured, name) != getattr(modelled, name):
            raise ValueError(f"{name} differ: {getattr(measured, name)} measured, {getattr(modelled, name)} modelled")
    if measured.configuration.name != modelled.configuration.name:
        raise ValueError(f"{measured.configuration.name} measured, {modelled.configuration.name} modelled")
    if not np.array_equal(measured.freq_hz, modelled.freq_hz):
        raise ValueError(f"{measured.configuration.name}: measured and modelled lines differ")


def _log_ratio_db(Ghat: ComplexArray, G: ComplexArray, sigma: FloatArray) -> FloatArray:
    """20 log10 |Ghat / G|; a model below sigma counts as sigma, so that an element it decouples has a finite error."""
    tiny = np.finfo(float).tiny
    reference = np.maximum(np.maximum(np.abs(G), sigma), tiny)
    ratio: FloatArray = 20 * np.log10(np.maximum(np.abs(Ghat), tiny) / reference)
    return ratio


def _mean(values: FloatArray | BoolArray, where: BoolArray) -> FloatArray:
    """Mean along frequency over some lines (n_y, n_u), NaN where there are none."""
    count = where.sum(axis=0)
    mean: FloatArray = np.where(where, values, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    return mean


def _pooled(rms: FloatArray, lines: IntArray) -> float:
    some = lines > 0
    return float(np.sqrt(np.average(rms[some] ** 2, weights=lines[some]))) if some.any() else math.nan


def _peaks(measured: FrequencyResponse, modelled: FrequencyResponse, sigma: FloatArray) -> tuple[Peak, ...]:
    """Measured peaks and dips with their modelled partners; the model has no noise, so smaller bumps count there."""
    freq_hz = measured.freq_hz
    found: list[Peak] = []
    for i, output in enumerate(measured.outputs):
        for j, source in enumerate(measured.inputs):
            for kind, finder in FINDERS.items():
                f = finder(freq_hz, measured.G[:, i, j], sigma[:, i, j])
                partner = paired_resonances(f, finder(freq_hz, modelled.G[:, i, j], prominence_db=PROMINENCE_DB / 3))
                found += [Peak(output, source, kind, *pair) for pair in zip(f.tolist(), partner.tolist(), strict=True)]
    return tuple(found)


def _verdict(agreements: Sequence[Agreement]) -> str:
    fitted = [a for a in agreements if not a.left_out]
    left_out = [a for a in agreements if a.left_out]
    judged = left_out or fitted
    db, deg = _over(judged)
    if math.isnan(db):
        return "Nothing can be said about the model: no line of the measured FRFs stands above 2 sigma."
    sentence = f"off by {db:.2g} dB and {deg:.2g} deg rms"
    if left_out:
        fitted_db, fitted_deg = _over(fitted)
        carries = carries_over(db, fitted_db)
        sentence = (
            f"On the left-out configurations ({', '.join(a.configuration for a in left_out)}) the model is {sentence}, "
            f"on the fitted ones by {fitted_db:.2g} dB and {fitted_deg:.2g} deg: "
            f"it {'carries' if carries else 'does not carry'} over to postures that it has not seen"
        )
    else:
        sentence = (
            f"On the fitted configurations the model is {sentence}; how it does on others is not known, "
            "because validation.left_out names none"
        )
    return sentence + _noise_clause(judged) + _resonance_clause(judged) + "."


def _over(agreements: Sequence[Agreement]) -> tuple[float, float]:
    """Magnitude and phase error over all judged lines of several configurations."""
    lines = np.array([a.lines.sum() for a in agreements])
    db = np.array([a.overall_rms_log_db for a in agreements])
    return _pooled(db, lines), _pooled(np.array([a.overall_phase_rms_deg for a in agreements]), lines)


def _noise_clause(agreements: Sequence[Agreement]) -> str:
    inside = np.mean([a.overall_inside_2sigma for a in agreements])
    expected = np.mean([a.inside_expected for a in agreements])
    if not np.isfinite(inside):
        return ""
    white = are_white(agreements)
    meaning = "no more than the noise" if inside >= expected - 0.05 and white else "more than the noise explains"
    share = f"{100 * inside:.0f} % of the lines lie within 2 sigma ({100 * expected:.0f} % expected)"
    return f"; {share}{'' if white else ' and the residuals are coloured'}, {meaning}"


def _resonance_clause(agreements: Sequence[Agreement]) -> str:
    found = [(peak, a.configuration) for a in agreements if (peak := a.worst("resonance")) is not None]
    if not found:
        return ""
    peak, configuration = max(found, key=lambda pair: abs(pair[0].error_percent))
    return (
        f"; the worst resonance is {abs(peak.error_percent):.2g} % off ({configuration}, {peak.input} to {peak.output})"
    )
