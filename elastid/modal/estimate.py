r"""Modes of a measured response: poles, shapes, residuals, intervals; no pole that noise has by chance.

Poles come from the p-LSCF estimator over orders, are chosen by F tests, and refined by weighted least squares on all
lines and elements together; residues are those of

.. math:: G(s) = \sum_r \left( \frac{\psi_r L_r^T}{s - \lambda_r} + \frac{\bar\psi_r L_r^H}{s - \bar\lambda_r} \right)
          + \sum_p C_p\, s^{k+p}

with shapes psi (n_y,) and participations L (n_u,), the largest singular pair of each residue; a residue with a second
one beyond its noise is a repeated root, two modes with one pole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.display import percent
from elastid.base.errors import DataError, check_kind
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.modal.basis import Basis, unstacked
from elastid.modal.model import ModalData, ModalFit
from elastid.modal.modes import Modes, without_modes
from elastid.modal.noise import floored, has_variance, line_variance, smoothed
from elastid.modal.poles import StabilisationDiagram, clusters, poles_over_orders, stabilisation
from elastid.modal.selection import eliminated, p_values, pursued, residual_peaks
from elastid.modal.shapes import mode_indicators, phase_collinearity
from elastid.modal.spec import ModalSpec
from elastid.modal.uncertainty import Influences
from elastid.response import FrequencyResponse


@dataclass(frozen=True)
class ModeLimits:
    """Judgement of poles that are more than noise.

    In 40 random structures under multisines, of 321 modes, one was missed and none false (`scripts/studies/modes.py`).
    """

    max_damping: float = 0.35
    damping_significance: float = 2.5  # damping over its standard deviation
    freq_std: float = 0.05  # of the frequency, at most: a slow pole at the edge of the band is no mode
    input_share: float = 0.01  # least singular value of the inputs over its largest: 40 dB,
    sure_coherence: float = 0.9  # unless the coherence shows that less suffices
    coherence: float = 0.2  # multiple, median over some lines of the best output
    coherence_lines: int = 21
    lines: int = 16  # of a response that has modes
    second_shape: float = 0.1  # singular value of a residue over its first, from which on a root is repeated
    second_shape_std: float = 6.0  # and over its standard deviation
    twin_distance: float = 1.5  # in half widths, of poles with one shape, of which the weaker mends the stronger
    twin_mac: float = 0.9
    wide_damping: float = 0.2  # half of its 95 % interval over the damping, from which on it is reported
    twin_share: float = 0.1  # of the stronger one's residue
    broad: float = 0.03  # damping, from which on a pole may be background that stronger modes leave
    visible_share: float = 0.1  # of the rms of G within its half powers, that a broad mode's peak has at least
    residue_std: float = 0.5  # of a broad mode's residue, relative
    undamped_std: float = 4.0  # standard deviations by which a damping is below 0
    lines_in_width: float = 1.5  # of a resonance between its half powers, below which its damping is doubtful
    chosen_distance: float = 0.05  # of a pole from the frequency that it was chosen by, relative


LIMITS = ModeLimits()
NO_POLES: ComplexArray = np.empty(0, complex)


def estimate_modes(
    response: FrequencyResponse,
    band_hz: tuple[float, float] | None = None,
    max_order: int | None = None,
    poles_hz: Sequence[float] | None = None,
    exponential_s: float | None = None,
) -> Modes:
    r"""Modes of a response with 95 % intervals: p-LSCF over orders, F tests, weighted least squares.

    band_hz: lines that are used.  max_order: of the matrix polynomial, 60 by default as lines allow.  poles_hz: natural
    frequencies of the poles that are taken, the nearest stable one each, in place of the choice by F tests.
    exponential_s: time constant of an exponential window on hits and answers, whose damping 1 / (omega tau) is taken
    out,

    .. math:: \lambda = \lambda_w + 1 / \tau

    Lines that the inputs do not reach (40 dB below their best, coherence below 0.9) or without coherence are left out.  Raises
    DataError where fewer than 16 lines are left, ValueError for numbers that a `modal` section does not take.
    """
    check_kind(response, FrequencyResponse, "response", "elastid.estimate(records, EstimatorSpec()) makes one")
    ModalSpec(band_hz, max_order, None if poles_hz is None else tuple(poles_hz), exponential_s)
    response = usable(response, band_hz)
    data, correlated = modal_data(response), response.correlated_lines
    orders = poles_over_orders(
        response.freq_hz, weighted(response, data), data.weight, max_order or _default_order(response)
    )
    stable, counts = clusters(orders)
    fit = _fitted(data, stable / data.basis.scale, correlated, poles_hz)
    if not has_variance(response):
        for _ in range(2):  # by the residuals, which follow a resonance where differences of lines do not
            data = modal_data(response, _residual_variance(response, fit))
            fit = _fitted(data, stable / data.basis.scale, correlated, poles_hz, fit.poles)
    shift = 0.0 if exponential_s is None else 1 / exponential_s
    return _modes(response, fit, (stable, counts), stabilisation(orders), shift, poles_hz)


def modes_of_responses(responses: Sequence[FrequencyResponse], spec: ModalSpec) -> tuple[Modes, ...]:
    """The modes of each response as a study asks for them; none, with a note, of one with too few lines."""
    return tuple(_modes_or_none(response, spec) for response in responses)


def _modes_or_none(response: FrequencyResponse, spec: ModalSpec) -> Modes:
    try:
        return estimate_modes(response, spec.band_hz, spec.max_order, spec.poles_hz, spec.exponential)
    except DataError as error:
        return without_modes(response, Note("no-modes", str(error)))


def usable(response: FrequencyResponse, band_hz: tuple[float, float] | None) -> FrequencyResponse:
    """The response on lines in the band that inputs reach and outputs answer; DataError where they are too few."""
    keep = response.freq_hz > 0
    if band_hz is not None:
        keep &= (response.freq_hz >= band_hz[0]) & (response.freq_hz <= band_hz[1])
    lost = ~_reached(response)
    if np.sum(keep & ~lost) < LIMITS.lines:
        where = "" if band_hz is None else f" from {band_hz[0]:g} to {band_hz[1]:g} Hz"
        raise DataError(
            f"configuration {response.configuration.name}: {int(np.sum(keep & ~lost))} lines{where} have excitation "
            f"and coherence, modes need {LIMITS.lines} or more; take a wider band, a longer period or record"
        )
    return response.lines(keep & ~lost)


def _reached(response: FrequencyResponse) -> BoolArray:
    """Flags (F,) of lines with force and coherence."""
    from scipy.ndimage import median_filter

    quality = response.quality
    if quality is None:
        return np.ones(response.n_lines, bool)
    weakest = quality.input_singular_values[:, -1]
    size = min(LIMITS.coherence_lines, response.n_lines)
    force = median_filter(weakest, size, mode="nearest")
    coherence = median_filter(quality.multiple_coherence.max(axis=1), size, mode="nearest")
    is_forced = (force > LIMITS.input_share * force.max()) | (coherence > LIMITS.sure_coherence)
    return np.asarray(is_forced & (coherence > LIMITS.coherence))


def _residual_variance(response: FrequencyResponse, fit: ModalFit) -> FloatArray:
    """Variance (F, n_y, n_u) by what a model leaves of the lines, smooth along frequency."""
    power = np.abs(response.G) ** 2
    model = fit.synthesis().reshape(response.G.shape)
    free = np.maximum(1 - np.sum(np.abs(unstacked(fit.Q)) ** 2, axis=1) / 2, 0.1)[:, None, None]
    return floored(smoothed(np.abs(response.G - model) ** 2 / free, np.abs(model) ** 2), power)


def modal_data(response: FrequencyResponse, variance: FloatArray | None = None) -> ModalData:
    """The response as weighted columns; variance: by default that stated, or by neighbouring lines."""
    return ModalData.of(Basis.of(response), response.G, line_variance(response) if variance is None else variance)


def weighted(response: FrequencyResponse, data: ModalData) -> ComplexArray:
    """G (F, n_y, n_u) over the scale of its elements; of inputs, one scale for all outputs, so that G = B / A holds."""
    scale = data.scale.reshape(response.G.shape[1:])
    of_outputs = np.exp(np.log(scale).mean(axis=1, keepdims=True))
    of_inputs = np.exp((np.log(scale) - np.log(of_outputs)).mean(axis=0, keepdims=True))
    return np.asarray(response.G / (of_outputs * of_inputs))


def _default_order(response: FrequencyResponse) -> int:
    return int(np.clip(response.n_lines // 6, 8, 60))


def _fitted(
    data: ModalData,
    candidates: ComplexArray,
    correlated_lines: float,
    poles_hz: Sequence[float] | None,
    start: ComplexArray = NO_POLES,
) -> ModalFit:
    """The chosen poles, refined; else those that noise has not by chance, from `start` on."""
    if poles_hz is not None:
        return ModalFit(data, _nearest(candidates, np.asarray(poles_hz), data)).refined(30, 1e-4)
    fit = pursued(ModalFit(data, start).refined(), candidates, correlated_lines)
    for _ in range(3):
        more = pursued(fit, residual_peaks(fit), correlated_lines)
        if len(more.poles) == len(fit.poles):
            break
        fit = more
    return eliminated(fit, correlated_lines)


def _nearest(candidates: ComplexArray, poles_hz: FloatArray, data: ModalData) -> ComplexArray:
    """The candidates nearest to natural frequencies, each once; one of 1 % damping where none is within 2 %."""
    chosen = []
    for f in poles_hz:
        size = 2 * np.pi * f / data.basis.scale
        gap = np.abs(np.abs(candidates) - size) / size
        near = len(gap) > 0 and gap.min() < 0.02
        chosen.append(candidates[np.argmin(gap)] if near else size * complex(-0.01, 1.0))
    return np.unique(np.array(chosen, complex))


def _modes(
    response: FrequencyResponse,
    fit: ModalFit,
    stable: tuple[ComplexArray, IntArray],
    diagram: StabilisationDiagram,
    shift: float,
    poles_hz: Sequence[float] | None,
) -> Modes:
    """The poles that are modes; shift: of poles by a window that is taken out, 1/s; poles_hz: as chosen."""
    influences, scale = Influences(fit, response.correlated_lines), fit.data.basis.scale
    chance = p_values(fit, response.correlated_lines)
    fitted = []
    for r in np.argsort(np.abs(fit.poles)).tolist():
        pole = complex(fit.poles[r] * scale)
        orders = int(np.max(np.where(np.abs(stable[0] - pole) < -pole.real, stable[1], 0), initial=0))
        fitted.append(_FittedMode.of(response, influences, r, pole + shift, orders, float(chance[r])))
    if poles_hz is None:
        within = _without_twins([mode for mode in fitted if mode.is_within(response)])
        found = [mode for mode in within if not mode.is_background(response)]
    else:
        within = []
        found = [mode for mode in fitted if mode.is_near(poles_hz)]
    modes = _gathered(response, fit, found, diagram)
    background = [mode for mode in within if mode not in found]
    notes = (*_lost_notes(found, response, poles_hz), *_window_notes(fitted, shift, response))
    return replace(modes, notes=(*modes.notes, *notes, *_background_notes(background, response)))


@dataclass(frozen=True)
class _FittedMode:
    """Frequency and damping with standard deviations, the residue (n_y, n_u) and its standard deviation."""

    freq_hz: float
    freq_std: float
    zeta: float
    zeta_std: float
    residue: ComplexArray
    residue_std: FloatArray
    orders: int
    chance: float

    @classmethod
    def of(
        cls, response: FrequencyResponse, influences: Influences, r: int, pole: complex, orders: int, chance: float
    ) -> _FittedMode:
        """The pole r of a fit; pole: the same in 1/s, without windows."""
        fit, size, scale = influences.fit, abs(pole), influences.fit.data.basis.scale
        C = influences.pole_covariances[r] * scale**2
        # zeta = -Re lambda / |lambda|
        of_freq = np.array([pole.real, pole.imag]) / size / (2 * np.pi)
        of_zeta = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
        freq_std, zeta_std = (float(np.sqrt(max(float(g @ C @ g), 0.0))) for g in (of_freq, of_zeta))
        shape = response.G.shape[1:]
        residue = (fit.residues[r] * scale).reshape(shape)
        std = (influences.residue_std(r) * fit.data.scale * scale).reshape(shape)
        return cls(size / (2 * np.pi), freq_std, -pole.real / size, zeta_std, residue, std, orders, chance)

    def is_within(self, response: FrequencyResponse) -> bool:
        """True within the band, with a frequency and a damping that are known."""
        inside = response.freq_hz[0] <= self.freq_hz <= response.freq_hz[-1]
        inside = inside and self.freq_std <= LIMITS.freq_std * self.freq_hz
        return bool(inside and LIMITS.damping_significance * self.zeta_std < self.zeta < LIMITS.max_damping)

    def is_background(self, response: FrequencyResponse) -> bool:
        """True for a broad pole of little height within its half powers, or of a shape that is not known."""
        if self.zeta < LIMITS.broad:
            return False
        size, half_width = float(np.linalg.norm(self.residue)), self.freq_hz * self.zeta
        G = response.G[np.abs(response.freq_hz - self.freq_hz) <= half_width]
        rms = float(np.linalg.norm(G)) / np.sqrt(max(len(G), 1))
        is_unknown = float(np.linalg.norm(self.residue_std)) > LIMITS.residue_std * size
        return bool(is_unknown or size / (2 * np.pi * half_width) < LIMITS.visible_share * rms)

    def is_near(self, poles_hz: Sequence[float]) -> bool:
        """True where one of these frequencies is within 5 %, or within the half width: poles may wander in a fit."""
        return any(abs(self.freq_hz / f - 1) < max(LIMITS.chosen_distance, self.zeta) for f in poles_hz)

    def is_twin_of(self, other: _FittedMode) -> bool:
        """True for a weak pole within a resonance of the same shape: it follows an error of that one."""
        size, size_of_other = float(np.linalg.norm(self.residue)), float(np.linalg.norm(other.residue))
        width = LIMITS.twin_distance * max(self.freq_hz * self.zeta, other.freq_hz * other.zeta)
        overlap = abs(np.vdot(self.residue, other.residue)) / (size * size_of_other)
        is_weak = size < LIMITS.twin_share * size_of_other
        return bool(is_weak and abs(self.freq_hz - other.freq_hz) < width and overlap**2 > LIMITS.twin_mac)


def _without_twins(modes: Sequence[_FittedMode]) -> list[_FittedMode]:
    return [mode for mode in modes if not any(mode.is_twin_of(other) for other in modes if other is not mode)]


def _gathered(
    response: FrequencyResponse, fit: ModalFit, modes: Sequence[_FittedMode], diagram: StabilisationDiagram
) -> Modes:
    numbers, shapes, stds, participations = [], [], [], []
    for mode in modes:
        std = mode.residue_std
        U, s, Vh = np.linalg.svd(mode.residue)
        count = 1 + int(len(s) > 1 and s[1] > _second_singular_value(s, std))
        for k in range(count):
            largest = int(np.argmax(np.abs(U[:, k])))
            shape = U[:, k] / U[largest, k]
            numbers.append((mode.freq_hz, mode.freq_std, mode.zeta, mode.zeta_std, mode.orders, mode.chance))
            shapes.append(shape)
            participations.append(Vh[k] * s[k] * U[largest, k])
            # By the entries of a residue along the input that drives it, the length of the shape fixed.
            noise = np.sqrt((std**2) @ (np.abs(Vh[k]) ** 2)) / (s[k] * np.abs(U[largest, k]))
            stds.append(noise * np.sqrt(1 + np.abs(shape) ** 2) * (np.arange(len(shape)) != largest))
    n_y, n_u = response.G.shape[1:]
    f, f_std, zeta, zeta_std, orders, chance = np.array(numbers).reshape(-1, 6).T
    synthesis = fit.synthesis().reshape(response.G.shape)
    power = np.maximum(np.mean(np.abs(response.G) ** 2, axis=(1, 2)), np.finfo(float).tiny)
    stated = np.sqrt(np.mean(line_variance(response), axis=(1, 2)) / power)
    shape_matrix = np.array(shapes, complex).reshape(-1, n_y).T
    return Modes(
        response.configuration.name, response.inputs, response.outputs, response.quantity, response.unit,
        response.rate_is_known, f, f_std, zeta, zeta_std, shape_matrix, np.array(stds).reshape(-1, n_y).T,
        np.array(participations, complex).reshape(-1, n_u).T,
        phase_collinearity(shape_matrix) if shapes else np.empty(0), orders.astype(int), chance,
        response.freq_hz, synthesis, np.sqrt(np.mean(np.abs(response.G - synthesis) ** 2, axis=(1, 2)) / power),
        stated, mode_indicators(response.G), diagram, (*_damping_notes(modes, response), *_line_notes(modes, response)),
    )  # fmt: skip


def _lost_notes(
    modes: Sequence[_FittedMode], response: FrequencyResponse, poles_hz: Sequence[float] | None
) -> tuple[Note, ...]:
    """A note on chosen frequencies without a pole."""
    lost = [f"{f:g}" for f in poles_hz or () if not any(mode.is_near([f]) for mode in modes)]
    if not lost:
        return ()
    unit = "Hz" if response.rate_is_known else "of the sampling rate"
    text = (
        f"no pole is at {', '.join(lost)} {unit}, which poles_hz names: fitted from there it moves to a resonance "
        "elsewhere; choose stable poles in the stabilisation diagram, and name those beside them, too"
    )
    return (Note("no-pole", text, response.configuration.name),)


def _background_notes(poles: Sequence[_FittedMode], response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on broad poles that are not called modes."""
    if not poles:
        return ()
    unit = "Hz" if response.rate_is_known else "of the sampling rate"
    where = ", ".join(f"{mode.freq_hz:.4g} {unit} (damping {percent(mode.zeta, 2)})" for mode in poles)
    text = (
        f"poles at {where} are background of the modes within their width: less than "
        f"{percent(LIMITS.visible_share, 2)} of the response there, or of uncertain shape; poles_hz can name them"
    )
    return (Note("broad-poles", text, response.configuration.name, severity="information"),)


def _window_notes(modes: Sequence[_FittedMode], shift: float, response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on poles with clearly less damping than the window that is taken out."""
    count = sum(mode.zeta < -LIMITS.undamped_std * mode.zeta_std for mode in modes) if shift else 0
    if not count:
        return ()
    text = (
        f"an exponential window of {1 / shift:g} s has more damping than {count} of {len(modes)} poles, which "
        "cannot have gone through it; give the time constant that the analyser states, or none"
    )
    return (Note("window-damping", text, response.configuration.name),)


def _damping_notes(modes: Sequence[_FittedMode], response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on dampings with wide intervals, and how much more to measure."""
    half_widths = np.array([QUANTILE_95 * mode.zeta_std / mode.zeta for mode in modes])
    wide = np.flatnonzero(half_widths > LIMITS.wide_damping)
    if not wide.size:
        return ()
    worst = int(np.argmax(half_widths))
    unit = "Hz" if response.rate_is_known else "of the sampling rate"
    narrower = 2 ** int(np.ceil(np.log2(half_widths[worst] / LIMITS.wide_damping)))
    text = (
        f"the damping of {wide.size} of {len(modes)} modes is uncertain, by {percent(half_widths[worst], 2)} of itself "
        f"at {modes[worst].freq_hz:.4g} {unit}: four times as many hits, periods or seconds of noise halve its "
        f"interval, {narrower**2} times as many bring it below {percent(LIMITS.wide_damping, 2)}"
    )
    return (Note("uncertain-damping", text, response.configuration.name, severity="information"),)


def _line_notes(modes: Sequence[_FittedMode], response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on modes whose half-power width 2 zeta f holds too few lines: records too short for their damping."""
    spacing = float(np.median(np.diff(response.freq_hz)))
    lines = np.array([2 * mode.zeta * mode.freq_hz / spacing for mode in modes])
    if not np.any(lines < LIMITS.lines_in_width):
        return ()
    worst, count = int(np.argmin(lines)), int(np.sum(lines < LIMITS.lines_in_width))
    mode = modes[worst]
    unit, per_line = ("Hz", " s") if response.rate_is_known else ("of the sampling rate", " samples")
    text = (
        f"the resonances of {count} of {len(modes)} modes are narrower than {LIMITS.lines_in_width:g} lines, that at "
        f"{mode.freq_hz:.4g} {unit} has {lines[worst]:.2g}: too few for its damping of {percent(mode.zeta, 2)}; lines "
        f"{mode.zeta * mode.freq_hz / 2:.2g} {unit} apart, of {2 / (mode.zeta * mode.freq_hz):.3g}{per_line} and more "
        "of record or period, hold four; of a long record resolution_hz brings them closer"
    )
    return (Note("narrow-resonances", text, response.configuration.name),)


def _second_singular_value(s: FloatArray, std: FloatArray) -> float:
    """The second singular value that a residue of rank 1 has by noise, or by its own errors."""
    noise = float(np.sqrt(np.mean(std**2))) * (np.sqrt(std.shape[0]) + np.sqrt(std.shape[1])) / 2
    return float(max(LIMITS.second_shape * float(s[0]), LIMITS.second_shape_std * noise))
