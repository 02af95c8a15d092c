"""Errors of modelled FRFs relative to measured ones, their noise, and the verdict of the validation.

    E(k) = Ghat(k) - G(k),   sigma^2(k) = measured variance of Ghat(k)

A variance from few realisations is smoothed over neighbouring lines, as in the fit. Magnitude and phase errors are
evaluated at the lines with |Ghat| >= 2 sigma; the statistical tests use every line.

Responses at the tool, by a hammer or an accelerometer, are compared with the prediction of `Result.at` and its band,
which includes the errors of parameters, of the robot model and of a misfit.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text
from elastid.base.propagation import PROBABILITY
from elastid.fit.problem.smoothed_noise import SmoothedNoise, smooth_noise
from elastid.fit.problem.weights import vec
from elastid.fit.result import Result
from elastid.response import Response
from elastid.validation.residual_tests import (
    FALSE_ALARM,
    above_2sigma,
    exceeds_by_chance,
    fisher_p_value,
    power_over_noise,
    sigma_of,
    white_by_chance,
    whitening,
    without_shifts,
)

# Radius of the 95 % interval of a circular complex error over its std, sqrt(E|e|^2).
CIRCULAR_95 = math.sqrt(-np.log(0.05))


@frozen_value(eq=False)
class PredictedResponse:
    """Measured response and the prediction of the fitted robot, on the same lines.

    std (F, n_y, n_u): sqrt(E|dG|^2).  pointwise (F, n_y, n_u): radius of the 95 % interval at each line.  motors: held
    (locked), free or controlled.  is_fitted: the response is part of the fit.
    """

    measured: Response
    predicted: Response
    std: FloatArray = labelled("standard deviation of the prediction")
    pointwise: FloatArray = labelled("95 % of the truth, line by line")
    motors: str
    by: str
    is_fitted: bool = False

    @property
    def configuration(self) -> str:
        """Name of the configuration."""
        return self.measured.configuration.name

    @property
    def inside(self) -> float:
        """Fraction of the lines of all elements with a difference within both 95 % intervals."""
        radius = np.hypot(self.pointwise, CIRCULAR_95 * sigma_of(self.measured))
        return float(np.mean(np.abs(self.measured.G - self.predicted.G) <= radius))

    @property
    def rms_log_db(self) -> float:
        """Rms of 20 log10 |measured / predicted| over lines above the noise, dB."""
        return agreement(self.measured, self.predicted).overall_rms_log_db

    @property
    def sentence(self) -> str:
        """Comparison as a sentence."""
        elements = f"{', '.join(self.measured.outputs)} by {', '.join(self.measured.inputs)}"
        return (
            f"{self.configuration}, motors {self.motors}: {elements}: {self.rms_log_db:.2g} dB rms between measurement "
            f"and prediction; {100 * self.inside:.0f} % of the lines agree within both 95 % bands"
        )


def predict_response(result: Result, measured: Response, is_fitted: bool = False) -> PredictedResponse:
    """Predict a response with the motors as measured; StudyError for unknown locations or without an equilibrium."""
    motors, locations = measured.motors, (measured.inputs, measured.outputs)
    from elastid.fit.posture import PredictionPorts, as_configuration  # pages use this file without the model

    request = PredictionPorts(*locations, motors, quantity=measured.quantity, controller=measured.loop)
    family = result.family(request, measured.configuration.name)
    posture = family.at(as_configuration(measured.configuration, family.robot, ()))
    band = posture.response_band(measured.freq_hz, PROBABILITY)
    predicted = replace(band.response, configuration=measured.configuration)
    return PredictedResponse(measured, predicted, band.std, band.pointwise, motors, band.by, is_fitted)


@frozen_value
class FrfError:
    """Errors of the model in one configuration; arrays by element (n_y, n_u), NaN without an uncertainty or lines.

    rms_sigma: on all lines, 1 for a correct model.  power_ratio, power_dof: `power_over_noise`.  white_p:
    `white_by_chance`.
    """

    configuration: str
    is_validation: bool
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    lines: IntArray = labelled("lines judged for magnitude and phase", "", "outputs inputs")
    rms_log_db: FloatArray = labelled("rms of 20 log10 |measured / modelled|", "dB", "outputs inputs")
    phase_rms_deg: FloatArray = labelled("rms of the phase of measured / modelled", "deg", "outputs inputs")
    rms_sigma: FloatArray = labelled("rms of the residual over its standard deviation", "", "outputs inputs")
    power_ratio: float = math.nan
    power_dof: float = 0.0
    white_p: float = math.nan

    @property
    def overall_rms_log_db(self) -> float:
        """Rms magnitude error over all evaluated lines of all elements, dB."""
        return pooled_rms(self.rms_log_db, self.lines)

    @property
    def overall_phase_rms_deg(self) -> float:
        """Rms phase error over all evaluated lines of all elements, degrees."""
        return pooled_rms(self.phase_rms_deg, self.lines)

    @property
    def overall_rms_sigma(self) -> float:
        """Rms residual over its standard deviation, over all elements that have one."""
        finite = self.rms_sigma[np.isfinite(self.rms_sigma)]
        return math.sqrt(np.mean(finite**2)) if finite.size else math.nan


def pooled_rms(rms: FloatArray, lines: IntArray) -> float:
    """Return the rms over all lines from the rms (...) of each element and its lines (...); NaN without lines."""
    mask = lines > 0
    return math.sqrt(np.average(rms[mask] ** 2, weights=lines[mask])) if mask.any() else math.nan


def are_white(agreements: Sequence[FrfError]) -> bool:
    """Return whether the residuals of all configurations together are white, with false-alarm rate FALSE_ALARM."""
    return not fisher_p_value([result.white_p for result in agreements]) < FALSE_ALARM


def noise_p(agreements: Sequence[FrfError]) -> float:
    """Return the probability of at least this residual power by noise alone; NaN if the noise is unknown."""
    return exceeds_by_chance(*power_ratio(agreements))


def power_ratio(agreements: Sequence[FrfError]) -> tuple[float, float]:
    """Return the ratio of residual to noise power over all configurations, and its degrees of freedom."""
    pairs = [(a.power_dof, a.power_ratio) for a in agreements if a.power_dof > 0]
    dof = sum(weight for weight, _ in pairs)
    return (sum(weight * ratio for weight, ratio in pairs) / dof, dof) if pairs else (math.nan, 0.0)


@dataclass(frozen=True)
class Fold:
    """Errors of a configuration in cross-validation, NaN if its fit failed; misfit: mean |E|^2 / sigma^2."""

    configuration: str = ""
    misfit: float = math.nan
    rms_log_db: float = math.nan
    phase_rms_deg: float = math.nan


@frozen_value
class Validation:
    """Errors of every configuration, predictions of responses at the tool, and the verdict in one sentence."""

    configurations: tuple[FrfError, ...] = labelled(entry="configuration")
    verdict: str
    predictions: tuple[PredictedResponse, ...] = ()

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Table of the verdict and the errors of each configuration."""
        rows = [
            (a.configuration, "validation" if a.is_validation else "fitted", f"{a.overall_rms_log_db:.2g}",
             f"{a.overall_phase_rms_deg:.2g}", f"{math.sqrt(a.power_ratio):.3g}")
            for a in self.configurations
        ]  # fmt: skip
        headings = ("configuration", "in the fit", "magnitude, dB rms", "phase, degrees rms", "residual / noise")
        return Display(f"Validation: {self.verdict}", headings, rows)


def validate(
    measured: Sequence[Response], modelled: Sequence[Response], validation: Sequence[str],
    shifts: Mapping[str, ComplexArray] | None = None
) -> Validation:  # fmt: skip
    """Compare measured and modelled FRFs; validation: names of configurations that were not fitted.

    shifts (n_x, F, n_y, n_u): of `agreement`, by configuration.  ValueError if a pair differs in elements or lines.
    """
    agreements = tuple(
        agreement(Ghat, G, (name := Ghat.configuration.name) in validation, (shifts or {}).get(name))
        for Ghat, G in zip(measured, modelled, strict=True)
    )
    return Validation(agreements, _verdict(agreements))


def agreement(
    measured: Response, modelled: Response, is_validation: bool = False, shifts: ComplexArray | None = None
) -> FrfError:
    """Return the errors of one configuration; ValueError if the responses differ in elements or lines.

    shifts (n_x, F, n_y, n_u): changes of the prediction by one standard deviation of the parameters in independent
    directions. The tests allow for them, as for the systematic errors of the measurement.
    """
    for name in ("inputs", "outputs", "quantity", "freq_hz"):
        if not np.array_equal(getattr(measured, name), getattr(modelled, name)):
            raise ValueError(f"{measured.configuration.name}: {name} of measurement and model differ")
    Ghat, G = measured.G, modelled.G
    noise = smooth_noise(measured)
    sigma = sigma_of(measured, noise)
    is_judged = above_2sigma(measured, sigma)
    has_noise = sigma > 0
    e = np.divide(Ghat - G, sigma, out=np.zeros_like(Ghat), where=has_noise)
    # The reference is at least sigma: an element that is 0 in the model has a finite error.
    tiny = np.finfo(float).tiny
    reference = np.maximum(np.maximum(np.abs(G), sigma), tiny)
    ratio, ratio_dof, white_p = _tests(measured, noise, Ghat - G, shifts)
    return FrfError(
        measured.configuration.name, is_validation, measured.outputs, measured.inputs, is_judged.sum(axis=0),
        np.sqrt(_mean((20 * np.log10(np.maximum(np.abs(Ghat), tiny) / reference)) ** 2, is_judged)),
        np.sqrt(_mean(np.degrees(np.angle(Ghat * G.conj())) ** 2, is_judged)),
        np.sqrt(_mean(np.abs(e) ** 2, has_noise) / _expected_power(noise, sigma)), ratio, ratio_dof, white_p,
    )  # fmt: skip


def _expected_power(noise: SmoothedNoise | None, sigma: FloatArray) -> FloatArray | float:
    """Return the mean (n_y, n_u) of |E / sigma|^2 of a correct model, below 1 because smoothing raises sigma."""
    if noise is None:
        return 1.0
    ratio = np.divide(noise.measured.variance, sigma**2, out=np.zeros(sigma.shape), where=sigma > 0)
    return _mean(ratio / np.maximum(1 - noise.influence.variance / noise.measured.dof, 0.1)[:, None, None], sigma > 0)


def _tests(
    measured: Response, noise: SmoothedNoise | None, E: ComplexArray, shifts: ComplexArray | None
) -> tuple[float, float, float]:
    """Return the power of the errors E (F, n_y, n_u) over the noise, its degrees of freedom, and p of whiteness."""
    if noise is None or not np.any(noise.variance > 0):
        return math.nan, 0.0, math.nan
    whiten = whitening(noise)
    z, shift_dof = (whiten @ vec(E)[:, :, None])[:, :, 0], 0.0
    if systematic := [x.reshape(-1, *E.shape) for x in (shifts, measured.bias) if x is not None]:
        z, shift_dof = without_shifts(z, (whiten @ vec(np.concatenate(systematic))[..., None])[..., 0])
    return *power_over_noise(z, whiten, noise, shift_dof), white_by_chance(z)


def _mean(values: FloatArray | BoolArray, mask: BoolArray) -> FloatArray:
    """Return the mean (n_y, n_u) over the lines of a mask (F, n_y, n_u); NaN without any."""
    count = mask.sum(axis=0)
    return np.asarray(np.where(mask, values, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan))


def _verdict(agreements: Sequence[FrfError]) -> str:
    fitted, validation = ([a for a in agreements if a.is_validation is flag] for flag in (False, True))
    rows = validation or fitted
    (db, deg), (ratio, dof), p, white = _over(rows), power_ratio(rows), noise_p(rows), are_white(rows)
    if math.isnan(db):
        return "Validation not possible: no line of the measured FRFs is above 2 sigma."
    is_less = exceeds_by_chance(1 / max(ratio, 1e-300), dof) < FALSE_ALARM
    color = f"{'white' if white else 'coloured'}{' (noise overestimated, intervals too wide)' if is_less else ''}"
    error = f"{db:.2g} dB and {deg:.2g} deg rms"
    if not validation:  # the residual test of the fit applies to these residuals
        return f"Error of the fitted FRFs: {error}. No configuration is reserved for validation."
    names, is_larger = ", ".join(a.configuration for a in validation), False
    if fitted:
        fitted_db, fitted_deg = _over(fitted)
        # A larger error may be due to more noise than in the fitted configurations.
        is_larger = db > 1.5 * fitted_db + 0.1 and not p >= FALSE_ALARM
        error += f" (fitted: {fitted_db:.2g} dB and {fitted_deg:.2g} deg)" if is_larger else ""
    verdict = "failed" if is_larger or p < FALSE_ALARM or not white else "passed"
    test = "the noise is unknown"
    if not math.isnan(p):
        test = f"residuals {color}, {math.sqrt(ratio):.3g} times the noise (rms)"
    subject = f"configuration {names}, which was not fitted"
    return f"Validation {verdict}. The model predicts {subject}: {test}. Error of the FRFs: {error} including noise."


def _over(agreements: Sequence[FrfError]) -> tuple[float, float]:
    db, deg, lines = np.array([(a.overall_rms_log_db, a.overall_phase_rms_deg, a.lines.sum()) for a in agreements]).T
    return pooled_rms(db, lines), pooled_rms(deg, lines)
