r"""Estimation of the modes of a measured response: poles, shapes and residual terms with 95 % intervals.

The p-LSCF estimator gives poles over orders, F tests select those that are not noise, and weighted least squares on
all lines and elements refines them.  The residues are those of

.. math:: G(s) = \sum_r \left( \frac{\psi_r L_r^T}{s - \lambda_r} + \frac{\bar\psi_r L_r^H}{s - \bar\lambda_r} \right)
          + \sum_p C_p\, s^{k+p}

with shapes psi (n_y,) and participations L (n_u,), the largest singular pair of each residue.  A residue with a second
singular value above its noise is a repeated root: two modes with one pole.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.display import percent
from elastid.base.errors import DataError, Note, check_kind
from elastid.modal.basis import Basis
from elastid.modal.fitted_mode import LIMITS, FittedMode, line_notes, lost_notes, window_notes, without_twins
from elastid.modal.influences import Influences
from elastid.modal.line_variance import floor_variance, has_variance, line_variance, smooth_variance
from elastid.modal.model import ModalData, ModalFit
from elastid.modal.modes import Modes, phase_collinearity, without_modes
from elastid.modal.pole_selection import eliminate_poles, pursue_poles, residual_peaks
from elastid.modal.poles import StabilisationDiagram, clusters, poles_over_orders, stabilisation
from elastid.modal.spec import ModalSpec
from elastid.response import Response

NO_POLES: ComplexArray = np.empty(0, complex)


def estimate_modes(
    response: Response, band_hz: tuple[float, float] | None = None, max_order: int | None = None,
    poles_hz: Sequence[float] | None = None, exponential_s: float | None = None,
) -> Modes:  # fmt: skip
    r"""Estimate the modes of a response with 95 % intervals: p-LSCF over orders, F tests, weighted least squares.

    band_hz: band of the lines used.  max_order: of the matrix polynomial; default 60, or fewer with few lines.
    poles_hz: natural frequencies of the poles, each the nearest stable pole; default: selection by F tests.
    exponential_s: time constant tau of an exponential window on hits and outputs, whose damping is removed,

    .. math:: \lambda = \lambda_w + 1 / \tau

    Lines with weak inputs (40 dB below the best, coherence below 0.9) or without coherence are not used.
    Raises DataError for fewer than 16 usable lines or overloaded hits, ValueError for numbers that a `modal` section
    does not accept.
    """
    check_kind(response, Response, "response", "elastid.estimate(records) makes them")
    ModalSpec(band_hz, max_order, None if poles_hz is None else tuple(poles_hz), exponential_s)
    # Clipping is nonlinear: false poles with narrow intervals would fit it.
    if poles_hz is None and any(note.code == "frf/overload" for note in response.notes):
        raise DataError(
            "modal/lines",
            "overloaded hits cause false modes that no test distinguishes from "
            "true modes. Remove these hits or measure again, or list reliable frequencies in modal.poles_hz",
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
            text = (
                "the phases have the opposite sign. elastid uses the conjugate response, which leaves "
                f"{percent(remaining)} of the power unexplained"
            )
            notes = (Note("modal/phase", text, response.configuration.name),)
    modes = _modes(response, fit, stabilisation(orders), 0.0 if exponential_s is None else 1 / exponential_s, poles_hz)
    return replace(modes, notes=(*modes.notes, *notes))


def _search(
    response: Response, max_order: int | None, poles_hz: Sequence[float] | None
) -> tuple[tuple[tuple[int, ComplexArray], ...], ModalFit]:
    """Return the poles of all orders, and the fit with the selected poles."""
    data, n_correlated = modal_data(response), response.correlated_lines
    # G over one scale per input and one per output, with which G = B / A remains valid.
    scale = data.scale.reshape(response.G.shape[1:])
    output_scale = np.exp(np.log(scale).mean(axis=1, keepdims=True))
    input_scale = np.exp((np.log(scale) - np.log(output_scale)).mean(axis=0, keepdims=True))
    normalised = response.G / (output_scale * input_scale)
    n = max_order or int(np.clip(response.n_lines // 6, 8, 60))
    orders = poles_over_orders(response.freq_hz, normalised, data.weight, n)
    stable = clusters(orders)
    fit = _fit_modes(data, stable / data.basis.scale, n_correlated, poles_hz)
    if not has_variance(response):
        for _ in range(2):  # variance of the residuals: differences of lines are inaccurate at a narrow resonance
            data = modal_data(response, _residual_variance(response, fit))
            fit = _fit_modes(data, stable / data.basis.scale, n_correlated, poles_hz, fit.poles)
    return orders, fit


def _unexplained_fraction(response: Response, fit: ModalFit) -> float:
    """Return the residual power over the power of the response."""
    residual = response.G - fit.synthesis().reshape(response.G.shape)
    return float(np.sum(np.abs(residual) ** 2) / np.sum(np.abs(response.G) ** 2))


def estimate_all_modes(responses: Sequence[Response], spec: ModalSpec) -> tuple[Modes, ...]:
    """Estimate the modes of each response as specified; a response that raises DataError has no modes, and a note."""
    modes: list[Modes] = []
    for response in responses:
        try:
            modes.append(estimate_modes(response, spec.band_hz, spec.max_order, spec.poles_hz, spec.exponential))
        except DataError as error:
            modes.append(without_modes(response, Note("modal/lines", str(error))))
    return tuple(modes)


def usable_response(response: Response, band_hz: tuple[float, float] | None) -> Response:
    """Return the response on the excited, coherent lines in the band; raise DataError for fewer than 16."""
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
    """Return flags (F,) of the lines with sufficient input and coherence."""
    from scipy.ndimage import median_filter

    quality = response.quality
    if quality is None:
        return np.ones(response.n_lines, bool)
    weakest = quality.input_singular_values[:, -1]
    size = min(LIMITS.coherence_lines, response.n_lines)
    force = median_filter(weakest, size, mode="nearest")
    coherence = median_filter(quality.multiple_coherence.max(axis=1), size, mode="nearest")
    is_forced = force > LIMITS.min_input_singular_value * force.max()
    if not response.window:  # few segments, such as hits, have a coherence near 1 even for noise
        is_forced |= coherence > LIMITS.sufficient_coherence
    return np.asarray(is_forced & (coherence > LIMITS.coherence))


def _residual_variance(response: Response, fit: ModalFit) -> FloatArray:
    """Return the variance (F, n_y, n_u) of the residuals of a fit, smoothed over frequency."""
    power = np.abs(response.G) ** 2
    model = fit.synthesis().reshape(response.G.shape)
    free = np.maximum(1 - fit.leverage, 0.1)[:, None, None]
    return floor_variance(smooth_variance(np.abs(response.G - model) ** 2 / free, np.abs(model) ** 2), power)


def modal_data(response: Response, variance: FloatArray | None = None) -> ModalData:
    """Return the response as weighted columns; variance (F, n_y, n_u): default `line_variance`."""
    return ModalData.of(Basis.of(response), response.G, line_variance(response) if variance is None else variance)


def _fit_modes(
    data: ModalData, candidates: ComplexArray, correlated_lines: float, poles_hz: Sequence[float] | None,
    start: ComplexArray = NO_POLES,
) -> ModalFit:  # fmt: skip
    """Fit the poles nearest to poles_hz, or `start` and the significant candidates (n,), and refine them."""
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
    """Return the candidate nearest to each natural frequency, or a pole with 1 % damping if it is not within 2 %."""
    nearest = []
    for f in poles_hz:
        size = 2 * np.pi * f / data.basis.scale
        gap = np.abs(np.abs(candidates) - size) / size
        nearest.append(candidates[np.argmin(gap)] if len(gap) > 0 and gap.min() < 0.02 else size * complex(-0.01, 1.0))
    return np.unique(np.array(nearest, complex))


def _modes(
    response: Response, fit: ModalFit, diagram: StabilisationDiagram, shift: float, poles_hz: Sequence[float] | None
) -> Modes:
    """Judge the poles of a fit as modes.  shift: correction for an exponential window, 1/s.  poles_hz: selection."""
    influences = Influences(fit, response.correlated_lines)
    poles = (fit.poles * fit.data.basis.scale + shift).tolist()
    fitted = [FittedMode.of(response, influences, r, poles[r]) for r in np.argsort(np.abs(fit.poles)).tolist()]
    if poles_hz is None:
        within = without_twins([mode for mode in fitted if mode.is_within(response, shift)])
        significant = [mode for mode in within if not mode.is_background(response)]
    else:
        significant = [mode for mode in fitted if mode.is_near(poles_hz)]
    modes = _collect_modes(response, fit, significant, diagram, influences)
    notes = (*lost_notes(significant, response, poles_hz), *window_notes(fitted, shift, response))
    return replace(modes, notes=(*modes.notes, *notes))


def _collect_modes(
    response: Response, fit: ModalFit, modes: Sequence[FittedMode], diagram: StabilisationDiagram,
    influences: Influences,
) -> Modes:  # fmt: skip
    """Return `Modes` of the significant poles, with the synthesis of the whole fit."""
    n_y, n_u = response.G.shape[1:]
    none = (np.empty((n_y, 0), complex), np.empty((n_y, 0)), np.empty((n_u, 0), complex), np.empty((n_u, 0)))
    pairs = [_singular_pairs(mode) for mode in modes]
    members = [mode for mode, (shapes, *_) in zip(modes, pairs, strict=True) for _ in shapes.T]
    shapes, shape_std, participation, participation_std = map(np.hstack, zip(none, *pairs, strict=True))
    numbers = np.array([(mode.freq_hz, mode.freq_std, mode.zeta, mode.zeta_std) for mode in members]).reshape(-1, 4)
    power = np.maximum(np.mean(np.abs(response.G) ** 2, axis=(1, 2)), np.finfo(float).tiny)
    noise_std = np.sqrt(np.mean(line_variance(response), axis=(1, 2)) / power)
    f, f_std, zeta, zeta_std = numbers.T
    collinearity, covariance = phase_collinearity(participation if n_u > n_y else shapes), np.zeros((0, 0))
    if members:
        std = numbers[:, [1, 3]].ravel()
        covariance = influences.correlation([(mode.index, mode.slopes) for mode in members]) * np.outer(std, std)
    return Modes(
        response.configuration.name, response.inputs, response.outputs, response.quantity, response.unit,
        response.has_rate, f, f_std, zeta, zeta_std, shapes, shape_std, participation, participation_std, collinearity,
        response.freq_hz, fit.synthesis().reshape(response.G.shape), noise_std,
        np.asarray(np.linalg.svd(response.G, compute_uv=False), float), diagram, covariance,
        line_notes(modes, response),
    )  # fmt: skip


def _singular_pairs(mode: FittedMode) -> tuple[FloatArray, ...]:
    """Return shapes (n_y, m), their std, participations (n_u, m) and their std of the m significant singular pairs."""
    std, pairs = mode.residue_std, []
    U, s, Vh = np.linalg.svd(mode.residue)
    # A residue of rank 1 has a second singular value by noise, or by errors of its pole.
    size_of_noise = math.sqrt(np.mean(std**2)) * (np.sqrt(std.shape[0]) + np.sqrt(std.shape[1])) / 2
    count = 1 + int(len(s) > 1 and s[1] > max(LIMITS.second_shape * s[0], LIMITS.second_shape_std * size_of_noise))
    for u, size, v in zip(U.T[:count], s, Vh, strict=False):
        largest = u[np.argmax(np.abs(u))]
        shape, participation = u / largest, v / v[np.argmax(np.abs(v))]
        # The noise of a shape is that of the residue along v, the noise of a participation that along u.
        shape_noise = np.sqrt(std**2 @ np.abs(v) ** 2) / (size * np.abs(u).max())
        noise = np.sqrt(np.abs(u) ** 2 @ std**2) / (size * np.abs(v).max())
        stds = _relative_std(shape, shape_noise), _relative_std(participation, noise)
        pairs.append((shape, stds[0], v * size * largest, stds[1]))
    return tuple(np.stack(column, axis=1) for column in zip(*pairs, strict=True))


def _relative_std(shape: ComplexArray, noise: FloatArray) -> FloatArray:
    """Return the standard deviation (n,) of a shape whose largest entry is scaled to 1; noise (n,): std of entries."""
    largest = int(np.argmax(np.abs(shape)))
    return np.asarray(np.sqrt(noise**2 + (np.abs(shape) * noise[largest]) ** 2) * (np.arange(len(shape)) != largest))
