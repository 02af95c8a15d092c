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
from dataclasses import dataclass, field

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text, digits, number, percent
from elastid.base.errors import DataError, check_kind
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.modal.basis import Basis, unstacked
from elastid.modal.model import ModalData, ModalFit
from elastid.modal.noise import floored, has_variance, line_variance, normalised_differences, smoothed
from elastid.modal.poles import StabilisationDiagram, clusters, poles_over_orders, stabilisation
from elastid.modal.selection import Noise, eliminated, p_values, pursued, residual_peaks
from elastid.modal.spec import ModalSpec
from elastid.modal.shapes import mode_indicators, phase_collinearity, turned
from elastid.modal.uncertainty import Influences
from elastid.response import FrequencyResponse


@dataclass(frozen=True)
class ModeLimits:
    """Judgement of poles that are more than noise.  False alarms: scripts/studies/modes.py."""

    max_damping: float = 0.35
    damping_significance: float = 2.5  # damping over its standard deviation
    input_share: float = 0.01  # least singular value of the inputs over its largest: 40 dB
    coherence: float = 0.2  # multiple, median over some lines of the best output
    coherence_lines: int = 21
    lines: int = 16  # of a response that has modes
    second_shape: float = 0.1  # singular value of a residue over its first, from which on a root is repeated
    second_shape_std: float = 6.0  # and over its standard deviation
    twin_distance: float = 1.5  # in half widths, of poles with one shape, of which the weaker mends the stronger
    twin_mac: float = 0.9
    twin_share: float = 0.1  # of the stronger one's residue


LIMITS = ModeLimits()
NO_POLES: ComplexArray = np.empty(0, complex)


@frozen_value
class Modes:
    """Modes by rising frequency, of one response.

    freq_hz (n,), zeta (n,) with standard deviations; shapes (n_y, n): the largest entry 1, complex; participation
    (n_u, n): residue = shape participation^T, in (rad/s) times the unit of G.  collinearity (n,): MPC.  orders (n,): of
    the estimator that have the pole.  chance (n,): probability that a record of noise has such a pole.
    at_hz (F,), synthesis (F, n_y, n_u): of the model; error (F,): |G - synthesis| over |G|, both RMS over elements, and
    stated (F,): of that the part by the noise.  indicators (F, n): CMIF.  diagram: of stabilisation.
    """

    configuration: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: str
    unit: str
    rate_is_known: bool
    freq_hz: FloatArray = labelled("natural frequency", "Hz")
    freq_std: FloatArray = labelled("its standard deviation", "Hz")
    zeta: FloatArray = labelled("damping ratio")
    zeta_std: FloatArray = labelled("its standard deviation")
    shapes: ComplexArray = labelled("mode shapes, the largest entry 1", "", "outputs mode")
    shape_std: FloatArray = labelled("standard deviation of shapes", "", "outputs mode")
    participation: ComplexArray = labelled("participation of inputs", "", "inputs mode")
    collinearity: FloatArray = labelled("modal phase collinearity")
    orders: IntArray
    chance: FloatArray = labelled("probability by chance")
    at_hz: FloatArray = labelled("lines", "Hz")
    synthesis: ComplexArray = labelled("response of the modal model", "{unit}", "at_hz outputs inputs")
    error: FloatArray = labelled("relative error of the synthesis")
    stated: FloatArray = labelled("relative standard deviation of the response")
    indicators: FloatArray = labelled("complex mode indicator functions", "{unit}", "at_hz rank")
    diagram: StabilisationDiagram
    notes: tuple[Note, ...] = field(default=())

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Frequency and damping of each mode with their intervals."""
        rows = []
        for f, f_std, zeta, zeta_std, mpc in zip(
            self.freq_hz, self.freq_std, self.zeta, self.zeta_std, self.collinearity, strict=True
        ):
            places, z_places = digits(f, f_std), digits(zeta, zeta_std)
            rows.append((number(f, places), number(QUANTILE_95 * f_std, 2), percent(zeta, z_places),
                         percent(QUANTILE_95 * zeta_std, 2), number(mpc, 3)))  # fmt: skip
        head = (f"frequency in {self.frequency_unit}", "+- 95 %", "damping", "+- 95 %", "phase collinearity")
        return Display(f"{len(rows)} modes of {self.configuration}", head, rows)

    @property
    def frequency_unit(self) -> str:
        """Hz, or that of a response whose rate is unknown."""
        return "Hz" if self.rate_is_known else "of the sampling rate"

    @property
    def n_modes(self) -> int:
        """How many."""
        return len(self.freq_hz)

    @property
    def poles(self) -> ComplexArray:
        """lambda (n,) in 1/s."""
        omega = 2 * np.pi * self.freq_hz
        return np.asarray(omega * (-self.zeta + 1j * np.sqrt(1 - self.zeta**2)))

    @property
    def freq95(self) -> FloatArray:
        """95 % intervals (n, 2) of the frequencies."""
        return _interval(self.freq_hz, self.freq_std)

    @property
    def zeta95(self) -> FloatArray:
        """95 % intervals (n, 2) of the dampings."""
        return _interval(self.zeta, self.zeta_std)


def _interval(value: FloatArray, std: FloatArray) -> FloatArray:
    return np.stack([value - QUANTILE_95 * std, value + QUANTILE_95 * std], axis=1)


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

    Lines that the inputs do not reach (40 dB below their best) or that have no coherence are left out.  Raises
    DataError where fewer than 16 lines are left.
    """
    check_kind(response, FrequencyResponse, "response", "elastid.estimate(records, EstimatorSpec()) makes one")
    response = usable(response, band_hz)
    data, noise = modal_data(response)
    orders = poles_over_orders(
        response.freq_hz, weighted(response, data), data.weight, max_order or _default_order(response)
    )
    stable, counts = clusters(orders)
    fit = _fitted(data, stable / data.basis.scale, noise, poles_hz)
    if not has_variance(response):
        for _ in range(2):  # by the residuals, which follow a resonance where differences of lines do not
            data, noise = modal_data(response, _residual_variance(response, fit))
            fit = _fitted(data, stable / data.basis.scale, noise, poles_hz, fit.poles)
    return _modes(response, fit, noise, (stable, counts), stabilisation(orders), exponential_s, poles_hz is not None)


def modes_of_responses(responses: Sequence[FrequencyResponse], spec: ModalSpec) -> tuple[Modes, ...]:
    """The modes of each response as a study asks for them; none, with a note, of one with too few lines."""
    return tuple(_modes_or_none(response, spec) for response in responses)


def _modes_or_none(response: FrequencyResponse, spec: ModalSpec) -> Modes:
    try:
        return estimate_modes(response, spec.band_hz, spec.max_order, spec.poles_hz, spec.exponential)
    except DataError as error:
        return without_modes(response, Note("no-modes", str(error)))


def without_modes(response: FrequencyResponse, note: Note) -> Modes:
    """No mode, and why."""
    n_y, n_u = len(response.outputs), len(response.inputs)
    none, no_lines = np.empty(0), response.lines(np.zeros(response.n_lines, bool))
    diagram = StabilisationDiagram(np.empty(0, int), none, none, np.empty(0, bool))
    return Modes(
        response.configuration.name, response.inputs, response.outputs, response.quantity, response.unit,
        response.rate_is_known, none, none, none, none, np.empty((n_y, 0), complex), np.empty((n_y, 0)),
        np.empty((n_u, 0), complex), none, np.empty(0, int), none, no_lines.freq_hz, no_lines.G, none, none,
        np.empty((0, min(n_y, n_u))), diagram, (note,),
    )  # fmt: skip


def usable(response: FrequencyResponse, band_hz: tuple[float, float] | None) -> FrequencyResponse:
    """The response on lines in the band that inputs reach and outputs answer; DataError where they are too few."""
    keep = response.freq_hz > 0
    if band_hz is not None:
        keep &= (response.freq_hz >= band_hz[0]) & (response.freq_hz <= band_hz[1])
    lost = ~_reached(response)
    if np.sum(keep & ~lost) < LIMITS.lines:
        where = "" if band_hz is None else f" from {band_hz[0]:g} to {band_hz[1]:g} Hz"
        raise DataError(
            f"configuration {response.configuration.name}: {int(np.sum(keep & ~lost))} lines{where} have excitation and "
            f"coherence, modes need {LIMITS.lines} or more; take a wider band, a longer period or record"
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
    return np.asarray((force > LIMITS.input_share * force.max()) & (coherence > LIMITS.coherence))


def _residual_variance(response: FrequencyResponse, fit: ModalFit) -> FloatArray:
    """Variance (F, n_y, n_u) by what a model leaves of the lines, smooth along frequency."""
    power = np.abs(response.G) ** 2
    model = fit.synthesis().reshape(response.G.shape)
    free = np.maximum(1 - np.sum(np.abs(unstacked(fit.Q)) ** 2, axis=1) / 2, 0.1)[:, None, None]
    return floored(smoothed(np.abs(response.G - model) ** 2 / free, np.abs(model) ** 2), power)


def modal_data(response: FrequencyResponse, variance: FloatArray | None = None) -> tuple[ModalData, Noise]:
    """The response as weighted columns, and its noise; variance: by default that stated, or by neighbouring lines."""
    variance = line_variance(response) if variance is None else variance
    data = ModalData.of(Basis.of(response), response.G, variance)
    differences = normalised_differences(response.freq_hz, response.G, variance)
    return data, Noise.of(differences, response.correlated_lines)


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
    noise: Noise,
    poles_hz: Sequence[float] | None,
    start: ComplexArray = NO_POLES,
) -> ModalFit:
    """The chosen poles, refined; else those that noise has not by chance, from `start` on."""
    if poles_hz is not None:
        return ModalFit(data, _nearest(candidates, np.asarray(poles_hz), data)).refined(30, 1e-4)
    fit = pursued(ModalFit(data, start).refined(), candidates, noise)
    for _ in range(3):
        more = pursued(fit, residual_peaks(fit), noise)
        if len(more.poles) == len(fit.poles):
            break
        fit = more
    return eliminated(fit, noise)


def _nearest(candidates: ComplexArray, poles_hz: FloatArray, data: ModalData) -> ComplexArray:
    """The candidate nearest to each natural frequency; one of 1 % damping where none is within 2 %."""
    chosen = []
    for f in poles_hz:
        size = 2 * np.pi * f / data.basis.scale
        gap = np.abs(np.abs(candidates) - size) / size
        near = len(gap) > 0 and gap.min() < 0.02
        chosen.append(candidates[np.argmin(gap)] if near else size * complex(-0.01, 1.0))
    return np.array(chosen, complex)


def _modes(
    response: FrequencyResponse,
    fit: ModalFit,
    noise: Noise,
    stable: tuple[ComplexArray, IntArray],
    diagram: StabilisationDiagram,
    exponential_s: float | None,
    is_chosen: bool,
) -> Modes:
    influences, scale = Influences(fit, noise.correlated_lines), fit.data.basis.scale
    chance = p_values(fit, noise)
    shift = 0.0 if exponential_s is None else 1 / exponential_s
    rows = []
    for r in np.argsort(np.abs(fit.poles)):
        pole = fit.poles[r] * scale
        C = influences.pole_covariances[r] * scale**2
        row = _row(response, fit, influences, int(r), pole + shift, C)
        if is_chosen or _is_mode(response, row):
            orders = int(np.max(np.where(np.abs(stable[0] - pole) < -pole.real, stable[1], 0), initial=0))
            rows.append((*row, orders, float(chance[r])))
    kept = rows if is_chosen else _without_twins(rows)
    return _gathered(response, fit, kept, diagram)


def _row(
    response: FrequencyResponse, fit: ModalFit, influences: Influences, r: int, pole: complex, C: FloatArray
) -> tuple[float, float, float, float, ComplexArray, FloatArray]:
    """Frequency and damping with stds, the residue (n_y, n_u) and its standard deviation."""
    size = abs(pole)
    gradient = np.array([pole.real, pole.imag]) / size
    # zeta = -Re lambda / |lambda|
    of_zeta = np.array([-pole.imag**2, pole.real * pole.imag]) / size**3
    f_std, zeta_std = (float(np.sqrt(max(g @ C @ g, 0.0))) for g in (gradient / (2 * np.pi), of_zeta))
    shape = response.G.shape[1:]
    residue = (fit.residues[r] * fit.data.basis.scale).reshape(shape)
    std = (influences.residue_std(r) * fit.data.scale * fit.data.basis.scale).reshape(shape)
    return size / (2 * np.pi), f_std, -pole.real / size, zeta_std, residue, std


def _is_mode(response: FrequencyResponse, row: tuple[float, float, float, float, ComplexArray, FloatArray]) -> bool:
    f, f_std, zeta, zeta_std, _, _ = row
    inside = response.freq_hz[0] <= f <= response.freq_hz[-1]
    return bool(inside and 0 < zeta < LIMITS.max_damping and zeta > LIMITS.damping_significance * zeta_std)


def _without_twins(rows: list[tuple[float, float, float, float, ComplexArray, FloatArray, int, float]]) -> list[
    tuple[float, float, float, float, ComplexArray, FloatArray, int, float]
]:
    """Without a weak pole within a resonance of the same shape: it follows an error of that one's."""
    kept = []
    for i, row in enumerate(rows):
        f, zeta, residue = row[0], row[2], row[4]
        for j, other in enumerate(rows):
            near = abs(f - other[0]) < LIMITS.twin_distance * max(f * zeta, other[0] * other[2])
            overlap = abs(np.vdot(residue, other[4])) / (np.linalg.norm(residue) * np.linalg.norm(other[4]))
            weaker = np.linalg.norm(residue) < LIMITS.twin_share * np.linalg.norm(other[4])
            if i != j and near and weaker and overlap**2 > LIMITS.twin_mac:
                break
        else:
            kept.append(row)
    return kept


def _gathered(
    response: FrequencyResponse,
    fit: ModalFit,
    rows: Sequence[tuple[float, float, float, float, ComplexArray, FloatArray, int, float]],
    diagram: StabilisationDiagram,
) -> Modes:
    numbers, shapes, stds, participations = [], [], [], []
    for f, f_std, zeta, zeta_std, residue, std, orders, chance in rows:
        U, s, Vh = np.linalg.svd(residue)
        count = 1 + int(len(s) > 1 and s[1] > _second(s, std, residue.shape))
        for k in range(count):
            shape = turned(U[:, [k]])[:, 0]
            largest = int(np.argmax(np.abs(shape)))
            numbers.append((f, f_std, zeta, zeta_std, orders, chance))
            shapes.append(shape)
            participations.append(Vh[k] * s[k] * U[largest, k] / shape[largest])
            # By the entries of a residue along the input that drives it, the length of the shape fixed.
            noise = np.sqrt((std**2) @ (np.abs(Vh[k]) ** 2)) / (s[k] * np.abs(U[largest, k]))
            stds.append(noise * np.sqrt(1 + np.abs(shape) ** 2) * (np.arange(len(shape)) != largest))
    n_y, n_u = response.G.shape[1:]
    columns = np.array(numbers).reshape(-1, 6).T
    synthesis = fit.synthesis().reshape(response.G.shape)
    power = np.maximum(np.mean(np.abs(response.G) ** 2, axis=(1, 2)), np.finfo(float).tiny)
    stated = np.sqrt(np.mean(line_variance(response), axis=(1, 2)) / power)
    shape_matrix = np.array(shapes, complex).reshape(-1, n_y).T
    return Modes(
        response.configuration.name, response.inputs, response.outputs, response.quantity, response.unit,
        response.rate_is_known, *columns[:4], shape_matrix, np.array(stds).reshape(-1, n_y).T,
        np.array(participations, complex).reshape(-1, n_u).T,
        phase_collinearity(shape_matrix) if shapes else np.empty(0), columns[4].astype(int), columns[5],
        response.freq_hz, synthesis, np.sqrt(np.mean(np.abs(response.G - synthesis) ** 2, axis=(1, 2)) / power),
        stated, mode_indicators(response.G), diagram,
    )  # fmt: skip


def _second(s: FloatArray, std: FloatArray, shape: tuple[int, ...]) -> float:
    """The singular value that a residue of rank 1 has by noise, or by its own errors."""
    noise = float(np.sqrt(np.mean(std**2))) * (np.sqrt(shape[0]) + np.sqrt(shape[1])) / 2
    return max(LIMITS.second_shape * float(s[0]), LIMITS.second_shape_std * noise)
