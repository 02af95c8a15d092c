"""Errors of the modelled FRFs against the measured ones, and the cost of a fit next to the noise.

    E(k) = Ghat(k) - G(k),   sigma^2(k) = measured variance of Ghat(k)

A variance estimated from few realisations is smoothed over neighbouring lines, as for the fit. Magnitude and phase
are judged on the lines where |Ghat| is at least 2 sigma; the statistical tests use every line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import StudyError
from elastid.fit.problem.smoothed_noise import SmoothedNoise, smooth_noise
from elastid.fit.problem.weights import vec
from elastid.fit.result import Result
from elastid.response import Response
from elastid.validation.comparison import generalises
from elastid.validation.residual_tests import (
    FALSE_ALARM,
    above_2sigma,
    exceeds_by_chance,
    falls_short_by_chance,
    inside_expected,
    power_over_noise,
    sigma_of,
    white_by_chance,
    whitening,
    without_shifts,
)
from elastid.validation.results import (
    PEAKS,
    Agreement,
    Peak,
    PeakKind,
    Validation,
    are_white,
    noise_p,
    paired_resonances,
    pooled_rms,
    power_ratio,
    resonances,
)

_SIGNS: dict[PeakKind, int] = {"resonance": 1, "antiresonance": -1}


def validate(
    measured: Sequence[Response],
    modelled: Sequence[Response],
    left_out: Sequence[str],
    cost_p: float = math.nan,
    shifts: Mapping[str, ComplexArray] | None = None,
) -> Validation:
    """Judge the modelled FRFs, one for each measured one on the same lines; left_out: configurations not fitted.

    All are left out of a fit to other data.  cost_p: P(as large a cost of the fit) by noise alone, which is judged with
    the residuals; NaN where it is unknown.  shifts: as `agreement`, of configurations that were not fitted.
    Raises StudyError where left_out names a configuration that was not measured.
    """
    names = [response.configuration.name for response in measured]
    if unknown := set(left_out) - set(names):
        raise StudyError(
            "validation/left-out",
            f"{', '.join(sorted(unknown))} was not measured; there are {', '.join(names)}",
            "validation.left_out",
        )
    agreements = tuple(
        agreement(Ghat, G, name in left_out, (shifts or {}).get(name))
        for name, Ghat, G in zip(names, measured, modelled, strict=True)
    )
    return Validation(agreements, _verdict(agreements, cost_p))


def agreement(
    measured: Response,
    modelled: Response,
    left_out: bool = False,
    shifts: ComplexArray | None = None,
    peaks: bool = True,
) -> Agreement:
    """The errors of one configuration; ValueError where the two responses are not of the same elements and lines.

    shifts (n_x, F, n_y, n_u): changes of a model that was not fitted to it by a standard deviation of its parameters,
    in independent directions; tests allow for them, as for the systematic errors of the measured one.  peaks: with its
    resonances, which take most of the time.
    """
    name = measured.configuration.name
    for each in ("inputs", "outputs", "quantity"):
        if getattr(measured, each) != getattr(modelled, each):
            raise ValueError(f"{each} differ: {getattr(measured, each)} measured, {getattr(modelled, each)} modelled")
    if name != modelled.configuration.name:
        raise ValueError(f"{name} measured, {modelled.configuration.name} modelled")
    if not np.array_equal(measured.freq_hz, modelled.freq_hz):
        raise ValueError(f"{name}: measured and modelled lines differ")
    Ghat, G = measured.G, modelled.G
    noise = smooth_noise(measured)
    sigma, dof = sigma_of(measured, noise)
    judged = above_2sigma(measured, sigma)
    known = sigma > 0
    e = np.divide(Ghat - G, sigma, out=np.zeros_like(Ghat), where=known)
    # |G| counts as sigma at least, so that an element that the model decouples is finite.
    tiny = np.finfo(float).tiny
    reference = np.maximum(np.maximum(np.abs(G), sigma), tiny)
    ratio, ratio_dof, white_p = _tests(measured, noise, Ghat - G, shifts)
    inside = np.where(known.any(axis=0), _mean(np.abs(e) <= 2, known), np.nan)
    return Agreement(
        configuration=name,
        left_out=left_out,
        outputs=measured.outputs,
        inputs=measured.inputs,
        lines=judged.sum(axis=0),
        rms_log_db=np.sqrt(_mean((20 * np.log10(np.maximum(np.abs(Ghat), tiny) / reference)) ** 2, judged)),
        phase_rms_deg=np.sqrt(_mean(np.degrees(np.angle(Ghat * G.conj())) ** 2, judged)),
        inside_2sigma=inside,
        inside_expected=inside_expected(dof),
        rms_sigma=np.sqrt(_mean(np.abs(e) ** 2, known)),
        peaks=_peaks(measured, modelled, sigma) if peaks else (),
        power_ratio=ratio,
        power_dof=ratio_dof,
        white_p=white_p,
    )


def _tests(
    measured: Response, noise: SmoothedNoise | None, E: ComplexArray, shifts: ComplexArray | None
) -> tuple[float, float, float]:
    """Power of the errors E (F, n_y, n_u) over the noise with its degrees of freedom, and p of their whiteness."""
    if noise is None or not np.any(noise.variance > 0):
        return math.nan, 0.0, math.nan
    whiten = whitening(noise)
    z, of_shifts = np.asarray((whiten @ vec(E)[:, :, None])[:, :, 0]), 0.0
    known = [] if shifts is None else [shifts]
    if measured.bias is not None:
        known.append(measured.bias.reshape(-1, *E.shape))
    if known:
        z, of_shifts = without_shifts(z, np.asarray((whiten @ vec(np.concatenate(known))[..., None])[..., 0]))
    return *power_over_noise(z, whiten, noise, of_shifts), white_by_chance(z)


def _mean(values: FloatArray | BoolArray, where: BoolArray) -> FloatArray:
    """Mean (n_y, n_u) along frequency over some lines, NaN without any."""
    count = where.sum(axis=0)
    return np.asarray(np.where(where, values, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan))


def _peaks(measured: Response, modelled: Response, sigma: FloatArray) -> tuple[Peak, ...]:
    """Measured peaks and dips with their modelled partners; the model has no noise, so smaller bumps count there."""
    freq_hz = measured.freq_hz
    peaks: list[Peak] = []
    for i, output in enumerate(measured.outputs):
        for j, source in enumerate(measured.inputs):
            for kind, sign in _SIGNS.items():
                f = resonances(freq_hz, measured.G[:, i, j], sigma[:, i, j], sign=sign)
                of_model = resonances(freq_hz, modelled.G[:, i, j], None, PEAKS.min_prominence_db / 3, sign)
                partner = paired_resonances(f, of_model)
                peaks += [Peak(output, source, kind, *pair) for pair in zip(f.tolist(), partner.tolist(), strict=True)]
    return tuple(peaks)


def _verdict(agreements: Sequence[Agreement], cost_p: float) -> str:
    fitted, left_out = ([a for a in agreements if a.left_out is is_out] for is_out in (False, True))
    judged = left_out or fitted
    db, deg = _over(judged)
    if math.isnan(db):
        return "The model cannot be judged: no line of the measured FRFs is above 2 sigma."
    sentence = f"off by {db:.2g} dB and {deg:.2g} deg rms"
    if left_out and not fitted:
        sentence = f"On the responses of these logs, which were not fitted, the model is {sentence}"
    elif left_out:
        fitted_db, fitted_deg = _over(fitted)
        # Of a left-out configuration with more noise than the fitted ones no error is the model's.
        carries = generalises(db, fitted_db) or noise_p(left_out) >= FALSE_ALARM
        sentence = (
            f"On the left-out configurations ({', '.join(a.configuration for a in left_out)}) the model is {sentence}, "
            f"on the fitted ones by {fitted_db:.2g} dB and {fitted_deg:.2g} deg: "
            f"it {'generalises' if carries else 'does not generalise'} to other postures"
        )
    else:
        sentence = (
            f"On the fitted configurations the model is {sentence}; its error on others is unknown, because "
            "validation.left_out names none"
        )
    return sentence + _noise_clause(judged, math.nan if left_out else cost_p) + _resonance_clause(judged) + "."


def _over(agreements: Sequence[Agreement]) -> tuple[float, float]:
    """Magnitude and phase error over all judged lines of several configurations."""
    db, deg, lines = np.array([(a.overall_rms_log_db, a.overall_phase_rms_deg, a.lines.sum()) for a in agreements]).T
    return pooled_rms(db, lines), pooled_rms(deg, lines)


def _noise_clause(agreements: Sequence[Agreement], cost_p: float) -> str:
    inside = np.mean([a.overall_inside_2sigma for a in agreements])
    expected = np.mean([a.inside_expected for a in agreements])
    p = noise_p(agreements, cost_p)
    if not np.isfinite(inside) or math.isnan(p):
        return ""
    white = are_white(agreements)
    meaning = "more than the noise" if p < FALSE_ALARM or not white else "no more than the noise"
    share = f"{100 * inside:.0f} % of the lines lie within 2 sigma ({100 * expected:.0f} % expected)"
    return (
        f"; {share}{'' if white else ' and the residuals are coloured'}, {meaning} (of a true model, each of these two "
        f"tests says more in {100 * FALSE_ALARM:g} % of measurements)"
    )


def _resonance_clause(agreements: Sequence[Agreement]) -> str:
    worst = [(peak, a.configuration) for a in agreements if (peak := a.worst("resonance")) is not None]
    if not worst:
        return ""
    peak, configuration = max(worst, key=lambda pair: abs(pair[0].error_percent))
    return (
        f"; the worst resonance is {abs(peak.error_percent):.2g} % off ({configuration}, {peak.input} to {peak.output})"
    )


def explain_cost(result: Result, measured: Sequence[Response], agreements: Sequence[Agreement]) -> str:
    """The cost of the fit next to the noise, in words; measured: fitted responses, with their agreements."""
    if all(response.uncertainty is None for response in measured):
        return "The responses came without an uncertainty: nothing says how large the residuals of the fit may be."
    opening = f"The residuals of the fit are {result.residual_ratio:.3g} times the noise, rms"
    rate = f"of a true model this test says otherwise in {100 * FALSE_ALARM:g} % of measurements"
    ratio = result.cost / max(result.cost_expected, 1e-300)
    coloured = ", ".join(a.configuration for a in agreements if not a.is_white)
    where = f": residuals of neighbouring lines are correlated in {coloured}" if not are_white(agreements) else ""
    if noise_p(agreements, cost_p(result)) < FALSE_ALARM:
        times = math.sqrt(max(ratio, power_ratio(agreements)[0]))
        floor = f", with a floor of {100 * result.floor:.3g} % of each element" if result.floor else ""
        return f"{opening}{floor}; without weights and floor they are {times:.3g} times the noise ({rate}){where}."
    if falls_short_by_chance(ratio, result.cost_dof) < FALSE_ALARM:
        return (
            f"{opening}, smaller than their uncertainty, which is overestimated, for instance by realisations or "
            "periods that differ by more than their mean is wrong, or by fit.weights.floor above the error of the "
            "model; the intervals are then too wide rather than too narrow."
        )
    return f"{opening}, and show no error of the model ({rate}){where}."


def cost_p(result: Result) -> float:
    """P(as large a cost) by noise alone; NaN where no noise is known."""
    return exceeds_by_chance(result.cost / max(result.cost_expected, 1e-300), result.cost_dof)
