r"""Modes of a measured response: poles, shapes, residuals, intervals; no pole that noise has by chance.

Poles come from the p-LSCF estimator over orders, are chosen by F tests, and refined by weighted least squares on all
lines and elements together; residues are those of

.. math:: G(s) = \sum_r \left( \frac{\psi_r L_r^T}{s - \lambda_r} + \frac{\bar\psi_r L_r^H}{s - \bar\lambda_r} \right)
          + \sum_p C_p\, s^{k+p}

with shapes psi (n_y,) and participations L (n_u,), the largest singular pair of each residue; a residue with a second
one beyond its noise is a repeated root, two modes with one pole.

Variance of each line and element of a response: as stated, smoothed over lines, or by differences of lines.

A response without a covariance shows its noise from line to line: of five neighbours the combination that no cubic
passes has the variance of one,

.. math:: d_k = \sum_i c_i G_{k+i}, \qquad \sum_i c_i x_i^m = 0\ (m = 0..3), \quad \sum_i c_i^2 = 1

and the median of |d|^2 over some lines leaves resonances out.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.display import percent
from elastid.base.errors import DataError, Note, check_kind
from elastid.modal.fitted_mode import (
    LIMITS,
    FittedMode,
    Influences,
    line_notes,
    lost_notes,
    window_notes,
    without_twins,
)
from elastid.modal.model import Basis, ModalData, ModalFit
from elastid.modal.modes import Modes, phase_collinearity, without_modes
from elastid.modal.poles import (
    StabilisationDiagram,
    clusters,
    eliminate_poles,
    poles_over_orders,
    pursue_poles,
    residual_peaks,
    stabilisation,
)
from elastid.modal.spec import ModalSpec
from elastid.response import Covariance, Response

# Lines of a median of differences, and of a mean of stated variances or of residuals.
DIFFERENCE_LINES, MEAN_LINES = 41, 41
# Stated variances of more degrees of freedom are taken as they are.
MANY_DOF = 15.0
# Of a line's variance over its smooth level, so that single lines do not make that of their neighbours.
MAX_RATIO = 100.0
# Of |G|^2: errors of the model itself (rounding of files, noise that bends windows) below it are no signal.
MIN_RELATIVE_VARIANCE = 1e-12


def line_variance(response: Response) -> FloatArray:
    """Return E|dG|^2 (F, n_y, n_u), without the leakage of windows that the columns have; positive."""
    power = np.abs(response.G) ** 2
    covariance = response.uncertainty
    if response.window and response.noise is not None:
        covariance = response.noise
    if covariance is None or not has_variance(response):
        return floor_variance(by_differences(response.freq_hz, response.G), power)
    if covariance.dof > MANY_DOF:
        return floor_variance(covariance.variance, power)
    # The part by the inputs is known line by line: of hits it is as uneven as their spectrum.
    relative_variance = _input_variance(covariance)
    return floor_variance(relative_variance * smooth_variance(covariance.variance / relative_variance, power), power)


def _input_variance(covariance: Covariance) -> FloatArray:
    """Return variance (F, 1, n_u) of G by noise of variance 1 at the outputs, over its mean; 1 if unknown."""
    if covariance.left is None:
        return np.ones((1, 1, 1))
    power = np.einsum("fuu->fu", covariance.left).real[:, None, :]
    return np.asarray(power / power.mean(axis=0))


def has_variance(response: Response) -> bool:
    """Return True where the response states its noise."""
    covariance = response.uncertainty
    return covariance is not None and bool(np.any(covariance.variance > 0))


def floor_variance(variance: FloatArray, power: FloatArray) -> FloatArray:
    """Return variance (F, n_y, n_u), at least the positive variance of rounding; power (F, n_y, n_u): |G|^2."""
    mean = power.mean(axis=0)
    return np.asarray(np.maximum(variance, MIN_RELATIVE_VARIANCE * (power + mean) + np.where(mean > 0, 0.0, 1.0)))


def by_differences(freq_hz: FloatArray, G: ComplexArray) -> FloatArray:
    """Return variance (F, n_y, n_u) by fourth differences of neighbouring lines."""
    F = len(freq_hz)
    power = np.abs(_differences(freq_hz, G)) ** 2
    median = median_filter(power, size=(min(DIFFERENCE_LINES, len(power)), 1, 1), mode="nearest") / math.log(2)
    return np.pad(median, ((2, F - len(power) - 2), (0, 0), (0, 0)), "edge")


def _differences(freq_hz: FloatArray, G: ComplexArray) -> ComplexArray:
    """Return d (F - 4, n_y, n_u), of the variance of a line where neighbours are independent."""
    x = np.lib.stride_tricks.sliding_window_view(freq_hz, 5) / (freq_hz[-1] / len(freq_hz))
    c = 1 / (x[:, :, None] - x[:, None, :] + np.eye(5)).prod(axis=2)
    c /= np.linalg.norm(c, axis=1, keepdims=True)
    return np.asarray(np.einsum("ki,k...i->k...", c, np.lib.stride_tricks.sliding_window_view(G, 5, axis=0)))


def smooth_variance(variance: FloatArray, power: FloatArray) -> FloatArray:
    """Smooth variances (F, n_y, n_u) of few dof as (a + b |G|^2) c: a by outputs, b by inputs, c a local mean.

    a, b >= 0 of each element by least squares relative to their sum; single variances would weigh lines by chance.
    """
    F, size, tiny = len(variance), min(MEAN_LINES, len(variance)), np.finfo(float).tiny
    v, p = variance.reshape(F, -1), power.reshape(F, -1)
    mean = np.maximum(v.mean(axis=0), tiny)
    columns = mean * np.stack([np.ones(p.shape), p / np.maximum(p.mean(axis=0), tiny)])
    scale = columns[0]
    for _ in range(5):
        A = columns / scale
        gram = np.einsum("ifc,jfc->cij", A, A) + 1e-12 * np.eye(2)
        inside = np.einsum("ifc,fc->ci", A, v / scale)
        weights = np.linalg.solve(gram, inside[:, :, None])[:, :, 0]
        # Where one of them is negative, the other is alone.
        weights = np.where(weights[:, ::-1] < 0, inside / np.einsum("cii->ci", gram), np.maximum(weights, 0.0))
        scale = np.einsum("ifc,ci->fc", columns, weights) + 1e-9 * mean
    local = uniform_filter1d(np.minimum(v / scale, MAX_RATIO), size, axis=0, mode="nearest")
    return np.asarray((scale * np.maximum(local, 1 / MAX_RATIO)).reshape(variance.shape))


NO_POLES: ComplexArray = np.empty(0, complex)


def estimate_modes(
    response: Response,
    band_hz: tuple[float, float] | None = None,
    max_order: int | None = None,
    poles_hz: Sequence[float] | None = None,
    exponential_s: float | None = None,
) -> Modes:
    r"""Return modes of a response with 95 % intervals: p-LSCF over orders, F tests, weighted least squares.

    band_hz: lines that are used.  max_order: of the matrix polynomial, 60 by default as lines allow.  poles_hz: natural
    frequencies of the poles that are taken, the nearest stable one each, in place of the choice by F tests.
    exponential_s: time constant of an exponential window on hits and answers, whose damping 1 / (omega tau) is taken
    out,

    .. math:: \lambda = \lambda_w + 1 / \tau

    Lines that the inputs do not reach (40 dB below their best, coherence below 0.9) or without coherence are left out.
    Raises DataError where fewer than 16 lines are left or hits are overloaded, ValueError for numbers that a `modal`
    section does not take.
    """
    check_kind(response, Response, "response", "elastid.estimate(records) makes them")
    ModalSpec(band_hz, max_order, None if poles_hz is None else tuple(poles_hz), exponential_s)
    # Clipping is not linear, and false poles with narrow intervals would fit it.
    if poles_hz is None and any(note.code == "frf/overload" for note in response.notes):
        raise DataError(
            "modal/lines",
            "of overloaded hits false modes are not to be told from true "
            "ones; leave these hits out or measure again, or name the frequencies that you trust as modal.poles_hz",
            f"configuration {response.configuration.name}",
        )
    response = usable_response(response, band_hz)
    orders, fit = _search(response, max_order, poles_hz)
    notes: tuple[Note, ...] = ()
    if (fraction := _unexplained_fraction(response, fit)) > LIMITS.unexplained:
        # The phase convention of an analyser may be e^(-j omega t): stable poles then look unstable.
        inverted = replace(response, G=response.G.conj())
        conjugate_modes, conjugate_fit = _search(inverted, max_order, poles_hz)
        if (remaining := _unexplained_fraction(inverted, conjugate_fit)) < LIMITS.phase_gain * fraction:
            response, orders, fit = inverted, conjugate_modes, conjugate_fit
            text = f"the phases have the opposite sign: the conjugate leaves {percent(remaining)} of the power"
            notes = (Note("modal/phase", f"{text}; elastid uses it", response.configuration.name),)
    modes = _modes(response, fit, stabilisation(orders), 0.0 if exponential_s is None else 1 / exponential_s, poles_hz)
    return replace(modes, notes=(*modes.notes, *notes))


def _search(
    response: Response, max_order: int | None, poles_hz: Sequence[float] | None
) -> tuple[tuple[tuple[int, ComplexArray], ...], ModalFit]:
    """Return poles of all orders, and the fit with those that are modes."""
    data, n_correlated = modal_data(response), response.correlated_lines
    orders = poles_over_orders(
        response.freq_hz,
        normalise_response(response, data),
        data.weight,
        max_order or int(np.clip(response.n_lines // 6, 8, 60)),
    )
    stable = clusters(orders)
    fit = _fit_modes(data, stable / data.basis.scale, n_correlated, poles_hz)
    if not has_variance(response):
        for _ in range(2):  # by the residuals, which follow a resonance where differences of lines do not
            data = modal_data(response, _residual_variance(response, fit))
            fit = _fit_modes(data, stable / data.basis.scale, n_correlated, poles_hz, fit.poles)
    return orders, fit


def _unexplained_fraction(response: Response, fit: ModalFit) -> float:
    """Return residual power over the power of the response."""
    residual = response.G - fit.synthesis().reshape(response.G.shape)
    return float(np.sum(np.abs(residual) ** 2) / np.sum(np.abs(response.G) ** 2))


def estimate_all_modes(responses: Sequence[Response], spec: ModalSpec) -> tuple[Modes, ...]:
    """Return the modes of each response as a study asks for them; none, with a note, of one with too few lines."""
    return tuple(_modes_or_none(response, spec) for response in responses)


def _modes_or_none(response: Response, spec: ModalSpec) -> Modes:
    try:
        return estimate_modes(response, spec.band_hz, spec.max_order, spec.poles_hz, spec.exponential)
    except DataError as error:
        return without_modes(response, Note("modal/lines", str(error)))


def usable_response(response: Response, band_hz: tuple[float, float] | None) -> Response:
    """Return the response on lines in the band that inputs excite and outputs answer; DataError if they are too few."""
    is_usable = response.freq_hz > 0
    if band_hz is not None:
        is_usable &= (response.freq_hz >= band_hz[0]) & (response.freq_hz <= band_hz[1])
    mask = is_usable & _measurable_lines(response)
    if np.sum(mask) < LIMITS.lines:
        where = "" if band_hz is None else f" from {band_hz[0]:g} to {band_hz[1]:g} Hz"
        raise DataError(
            "modal/lines",
            f"{int(np.sum(mask))} lines{where} are excited and "
            f"coherent; modes need {LIMITS.lines}. Use a wider band, or a longer period or record",
            f"configuration {response.configuration.name}",
        )
    return response.lines(mask)


def _measurable_lines(response: Response) -> BoolArray:
    """Return flags (F,) of lines with force and coherence."""
    from scipy.ndimage import median_filter

    quality = response.quality
    if quality is None:
        return np.ones(response.n_lines, bool)
    weakest = quality.input_singular_values[:, -1]
    size = min(LIMITS.coherence_lines, response.n_lines)
    force = median_filter(weakest, size, mode="nearest")
    coherence = median_filter(quality.multiple_coherence.max(axis=1), size, mode="nearest")
    is_forced = force > LIMITS.min_input_singular_value * force.max()
    if not response.window:  # few segments, as of hits, have a coherence near 1 whatever they hold
        is_forced |= coherence > LIMITS.sufficient_coherence
    return np.asarray(is_forced & (coherence > LIMITS.coherence))


def _residual_variance(response: Response, fit: ModalFit) -> FloatArray:
    """Return variance (F, n_y, n_u) of the residuals of a model, smoothed over frequency."""
    power = np.abs(response.G) ** 2
    model = fit.synthesis().reshape(response.G.shape)
    free = np.maximum(1 - fit.leverage, 0.1)[:, None, None]
    return floor_variance(smooth_variance(np.abs(response.G - model) ** 2 / free, np.abs(model) ** 2), power)


def modal_data(response: Response, variance: FloatArray | None = None) -> ModalData:
    """Return the response as weighted columns; variance (F, n_y, n_u): by default as stated, or by neighbours."""
    return ModalData.of(Basis.of(response), response.G, line_variance(response) if variance is None else variance)


def normalise_response(response: Response, data: ModalData) -> ComplexArray:
    """Return G (F, n_y, n_u) over the scale of its elements, or over one scale per input so that G = B / A holds."""
    scale = data.scale.reshape(response.G.shape[1:])
    output_scale = np.exp(np.log(scale).mean(axis=1, keepdims=True))
    input_scale = np.exp((np.log(scale) - np.log(output_scale)).mean(axis=0, keepdims=True))
    return np.asarray(response.G / (output_scale * input_scale))


def _fit_modes(
    data: ModalData,
    candidates: ComplexArray,
    correlated_lines: float,
    poles_hz: Sequence[float] | None,
    start: ComplexArray = NO_POLES,
) -> ModalFit:
    """Return the chosen poles, refined; else those that noise has not by chance, from `start` on."""
    if poles_hz is not None:
        return ModalFit(data, _nearest(candidates, np.asarray(poles_hz), data)).refined(30, 1e-4)
    fit = pursue_poles(ModalFit(data, start).refined(), candidates, correlated_lines)
    for _ in range(3):
        new_poles = pursue_poles(fit, residual_peaks(fit), correlated_lines)
        if len(new_poles.poles) == len(fit.poles):
            break
        fit = new_poles
    return eliminate_poles(fit, correlated_lines)


def _nearest(candidates: ComplexArray, poles_hz: FloatArray, data: ModalData) -> ComplexArray:
    """Return the candidates nearest to natural frequencies, each once; beyond 2 % a pole of 1 % damping."""
    nearest = []
    for f in poles_hz:
        size = 2 * np.pi * f / data.basis.scale
        gap = np.abs(np.abs(candidates) - size) / size
        nearest.append(candidates[np.argmin(gap)] if len(gap) > 0 and gap.min() < 0.02 else size * complex(-0.01, 1.0))
    return np.unique(np.array(nearest, complex))


def _modes(
    response: Response, fit: ModalFit, diagram: StabilisationDiagram, shift: float, poles_hz: Sequence[float] | None
) -> Modes:
    """Return poles selected as modes. shift: correction for an exponential window, 1/s. poles_hz: user selection."""
    influences, scale = Influences(fit, response.correlated_lines), fit.data.basis.scale
    fitted = []
    for r in np.argsort(np.abs(fit.poles)).tolist():
        fitted.append(FittedMode.of(response, influences, r, complex(fit.poles[r] * scale) + shift))
    if poles_hz is None:
        within = without_twins([mode for mode in fitted if mode.is_within(response, shift)])
        significant = [mode for mode in within if not mode.is_background(response)]
    else:
        significant = [mode for mode in fitted if mode.is_near(poles_hz)]
    modes = _collect_modes(response, fit, significant, diagram, influences)
    notes = (*lost_notes(significant, response, poles_hz), *window_notes(fitted, shift, response))
    return replace(modes, notes=(*modes.notes, *notes))


def _collect_modes(
    response: Response,
    fit: ModalFit,
    modes: Sequence[FittedMode],
    diagram: StabilisationDiagram,
    influences: Influences,
) -> Modes:
    members: list[FittedMode] = []
    numbers, shapes, stds, participations, participation_stds = [], [], [], [], []
    for mode in modes:
        std = mode.residue_std
        U, s, Vh = np.linalg.svd(mode.residue)
        count = 1 + int(len(s) > 1 and s[1] > _second_singular_value(s, std))
        for u, size, v in zip(U.T[:count], s, Vh, strict=False):
            largest = u[np.argmax(np.abs(u))]
            shape, participation = u / largest, v / v[np.argmax(np.abs(v))]
            members.append(mode)
            numbers.append((mode.freq_hz, mode.freq_std, mode.zeta, mode.zeta_std))
            shapes.append(shape)
            participations.append(v * size * largest)
            # By the entries of a residue along the input, or output, that goes with it.
            stds.append(_relative_std(shape, np.sqrt(std**2 @ np.abs(v) ** 2) / (size * np.abs(u).max())))
            noise = np.sqrt(np.abs(u) ** 2 @ std**2) / (size * np.abs(v).max())
            participation_stds.append(_relative_std(participation, noise))
    n_y, n_u = response.G.shape[1:]
    f, f_std, zeta, zeta_std = np.array(numbers).reshape(-1, 4).T
    synthesis = fit.synthesis().reshape(response.G.shape)
    power = np.maximum(np.mean(np.abs(response.G) ** 2, axis=(1, 2)), np.finfo(float).tiny)
    noise_std = np.sqrt(np.mean(line_variance(response), axis=(1, 2)) / power)
    shape_matrix, drive = np.array(shapes, complex).reshape(-1, n_y).T, np.array(participations).reshape(-1, n_u).T
    return Modes(
        response.configuration.name, response.inputs, response.outputs, response.quantity, response.unit,
        response.has_rate, f, f_std, zeta, zeta_std, shape_matrix, np.array(stds).reshape(-1, n_y).T,
        drive, np.array(participation_stds).reshape(-1, n_u).T,
        phase_collinearity(drive if n_u > n_y else shape_matrix) if shapes else np.empty(0),
        response.freq_hz, synthesis, noise_std, np.asarray(np.linalg.svd(response.G, compute_uv=False), float), diagram,
        influences.joint_covariance(members), line_notes(modes, response),
    )  # fmt: skip


def _relative_std(shape: ComplexArray, noise: FloatArray) -> FloatArray:
    """Return standard deviation (n,) of entries over the largest one, which is 1, with noise (n,) on each."""
    largest = int(np.argmax(np.abs(shape)))
    return np.asarray(np.sqrt(noise**2 + (np.abs(shape) * noise[largest]) ** 2) * (np.arange(len(shape)) != largest))


def _second_singular_value(s: FloatArray, std: FloatArray) -> float:
    """Return the second singular value that a residue of rank 1 has by noise, or by its own errors."""
    noise = math.sqrt(np.mean(std**2)) * (np.sqrt(std.shape[0]) + np.sqrt(std.shape[1])) / 2
    return float(max(LIMITS.second_shape * float(s[0]), LIMITS.second_shape_std * noise))
