"""The response matrix of one configuration, measured and modelled, and the quality of its measurement."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse, Quality
from elastid.validation.residual_tests import above_2sigma, sigma_of, smoothed_std

# Inches: left of all panels, right, above and below; between columns and between rows.
LEFT, RIGHT, TOP, BOTTOM = 0.75, 0.3, 1.0, 0.55
GAP_X, GAP_Y = 0.09, 0.13
# Of the panels of a Bode plot.
PANEL_WIDTH, PANEL_HEIGHT = 3.4, 1.5
# The y range ends at most so many dB below the points that count, and below the highest.
NOISE_ROOM_DB, MAX_RANGE_DB = 30.0, 120.0
# The noun of an input by its unit.
INPUT_NOUN = {"N": "force", "V": "voltage", "A": "current"}


@dataclass(frozen=True)
class PanelMatrix:
    """Where values at freq_hz (F,) of every element (n_y rows, n_u columns) are on the canvas.

    y: the least and the largest value of all panels.  panel: width and height in inches.
    """

    freq_hz: FloatArray
    y: tuple[float, float]
    rows: int
    columns: int

    @property
    def panel(self) -> tuple[float, float]:
        """Width and height in inches."""
        return float(np.clip(8.6 / self.columns, 1.5, 6.0)) - GAP_X, float(np.clip(5.4 / self.rows, 1.1, 3.2)) - GAP_Y

    @property
    def size(self) -> tuple[float, float]:
        """Of the canvas."""
        width, height = self.panel
        across, down = self.columns * (width + GAP_X) - GAP_X, self.rows * (height + GAP_Y) - GAP_Y
        return LEFT + across + RIGHT, TOP + down + BOTTOM

    @property
    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Left edges (columns,) and lower edges (rows,), the first row at the top."""
        width, height = self.panel
        x = LEFT + np.arange(self.columns) * (width + GAP_X)
        return np.asarray(x), np.asarray(BOTTOM + np.arange(self.rows)[::-1] * (height + GAP_Y))

    def x_within(self, freq_hz: FloatArray) -> FloatArray:
        """Inches from the left edge of a panel; the panel is a twentieth wider than the lines on either side."""
        low, high = np.log(self.freq_hz[0] / 1.05), np.log(self.freq_hz[-1] * 1.05)
        return np.asarray(self.panel[0] * (np.log(freq_hz) - low) / (high - low))

    def y_within(self, values: FloatArray) -> FloatArray:
        """Inches from the lower edge of a panel."""
        low, high = self.y
        return np.asarray(self.panel[1] * (values - low) / (high - low))

    def placed(self, freq_hz: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and y (n, rows, columns) on the canvas of values (n, rows, columns) at freq_hz (n,)."""
        left, bottom = self.corners
        x = np.broadcast_to(left + self.x_within(freq_hz)[:, None, None], values.shape)
        return x, np.asarray(bottom[:, None] + self.y_within(values))

    def inside(self, values: FloatArray) -> BoolArray:
        """True of values within the range of y."""
        return np.asarray((values >= self.y[0]) & (values <= self.y[1]))

    def curve(self, freq_hz: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """One line through all panels, broken between them, where values are not finite and beyond the range of y."""
        shown = self.inside(values)
        shown[1:] |= self.inside(values)[:-1]
        shown[:-1] |= self.inside(values)[1:]
        x, y = self.placed(freq_hz, np.where(shown, np.clip(values, *self.y), np.nan))
        return _joined(x), _joined(y)

    def band(self, freq_hz: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, lower and upper edge of a band through all panels, broken as a curve is."""
        shown = (high >= self.y[0]) & (low <= self.y[1])
        edges = [np.where(shown, np.clip(edge, *self.y), np.nan) for edge in (low, high)]
        (x, below), (_, above) = (self.placed(freq_hz, edge) for edge in edges)
        return _joined(x), _joined(below), _joined(above)


def _joined(values: FloatArray) -> FloatArray:
    """(n, rows, columns) element by element in one row, NaN between them."""
    broken = np.concatenate([values, np.full((1, *values.shape[1:]), np.nan)])
    return np.asarray(broken.reshape(len(broken), -1).T.ravel())


def empty_panels(matrix: PanelMatrix, y_ticks: Sequence[float]) -> tuple[Figure, Axes]:
    """The canvas with a thin grid in every panel, and numbers on the left of and below all."""
    figure = Figure(figsize=matrix.size)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, matrix.size[0]), ylim=(0, matrix.size[1]), autoscale_on=False)
    axes.axis("off")
    low, high = float(matrix.freq_hz[0]), float(matrix.freq_hz[-1])
    x_ticks = style.round_ticks(low, high, 6 if matrix.columns <= 3 else 3)
    x, y = matrix.x_within(np.array(x_ticks)), matrix.y_within(np.array(y_ticks))
    (width, height), (left, bottom) = matrix.panel, matrix.corners
    upright = [[(a + tick, b), (a + tick, b + height)] for a in left for b in bottom for tick in x]
    across = [[(a, b + tick), (a + width, b + tick)] for a in left for b in bottom for tick in y]
    frames = [[(a, b + height), (a, b), (a + width, b)] for a in left for b in bottom]
    axes.add_collection(LineCollection(upright + across, colors=style.GRID, linewidths=0.4, zorder=0.5))
    axes.add_collection(LineCollection(frames, colors=style.TRUTH, linewidths=0.8, zorder=2.5))
    for place, value in [(a + tick, value) for a in left for tick, value in zip(x, x_ticks, strict=True)]:
        axes.text(place, bottom[-1] - 0.06, f"{value:g}", ha="center", va="top", fontsize=style.SMALL)
    for place, value in [(b + tick, value) for b in bottom for tick, value in zip(y, y_ticks, strict=True)]:
        text = f"{value:g}".replace("-", "−")
        axes.text(left[0] - 0.06, place, text, ha="right", va="center", fontsize=style.SMALL)
    return figure, axes


def name_panels(axes: Axes, matrix: PanelMatrix, rows: Sequence[str], columns: Sequence[str]) -> None:
    """Names of the columns above the first row, of the rows on the right of the last column, read downwards."""
    (width, height), (left, bottom) = matrix.panel, matrix.corners
    for edge, name in zip(left, columns, strict=True):
        middle, above = edge + width / 2, bottom[0] + height + 0.08
        axes.text(middle, above, style.plain(name), ha="center", va="bottom", fontsize=style.NORMAL)
    for edge, name in zip(bottom, rows, strict=True):
        right, middle = left[-1] + width + 0.06, edge + height / 2
        axes.text(right, middle, style.plain(name), rotation=270, va="center", fontsize=style.NORMAL)


def configuration_title(measured: FrequencyResponse, left_out: bool) -> str:
    """Name, angles of the driven joints, and if the configuration was fitted; of a structure the name."""
    if not measured.configuration.angles.size:
        return measured.configuration.name
    angles = ", ".join(f"{angle:.4g}°" for angle in np.degrees(measured.configuration.angles))
    return f"{measured.configuration.name} ({angles}), {'left out of the fit' if left_out else 'fitted'}"


def frf_magnitude(
    measured: FrequencyResponse,
    modelled: FrequencyResponse | None,
    title: str,
    std: FloatArray | None = None,
    dense: tuple[FrequencyResponse, FloatArray] | None = None,
) -> Figure:
    """|G| in dB of every element (n_y rows, n_u columns) on one y range.

    Measured: points, grey below 2 sigma.  Model: line, with a band of 2 std.  Standard deviations of noise, of noise
    and nonlinear distortion, and of the model: dashed and dotted.  |Ghat - G|: thin.
    std (F, n_y, n_u): of the model, due to the uncertainty of its parameters.  dense: model and std on lines of its
    own, which are drawn where they are given.
    """
    above, f = above_2sigma(measured), measured.freq_hz
    Ghat_db = style.in_db(measured.G)
    model_db = None if modelled is None else style.in_db(modelled.G)
    levels = _levels(measured, std)
    shown = [np.where(above, curve, np.nan) for curve in (Ghat_db, *(() if model_db is None else (model_db,)))]
    low, high = _db_range(shown, [std_db for std_db, _, _ in levels.values()])
    matrix = PanelMatrix(f, (low, high), *Ghat_db.shape[1:])
    ticks = style.db_ticks(low, high, most=6 if len(measured.outputs) <= 3 else 4)
    figure, axes = _empty(measured, matrix, ticks, f"|G| in dB re 1 {style.pretty_unit(measured.unit)}")
    drawn, spread = (modelled, std) if dense is None else dense
    if drawn is not None and spread is not None:
        band = matrix.band(drawn.freq_hz, *_band_db(drawn.G, spread))
        axes.fill_between(*band, color=style.FITTED, alpha=0.25, lw=0)
    style.plot_points(axes, *matrix.placed(f, Ghat_db), above, matrix.inside(Ghat_db))
    if drawn is not None and modelled is not None:
        curve = matrix.curve(drawn.freq_hz, style.in_db(drawn.G))
        axes.plot(*curve, color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
        left = matrix.curve(f, style.in_db(measured.G - modelled.G))
        axes.plot(*left, color=style.RESIDUAL, lw=0.5, zorder=1, label="|measured − model|")
    for label, (std_db, color, dashes) in levels.items():
        axes.plot(*matrix.curve(f, std_db), color=color, lw=1.0, ls=dashes, zorder=1.5, label=label)
    return style.finish(figure, title, (), (axes,), markerscale=2.0)


def frf_phase(measured: FrequencyResponse, modelled: FrequencyResponse | None, title: str) -> Figure:
    """Phase of G in degrees of every element, wrapped to (-180, 180]; the model's line is broken where it wraps."""
    phase = np.degrees(np.angle(measured.G))
    matrix = PanelMatrix(measured.freq_hz, (-190.0, 190.0), *phase.shape[1:])
    ticks = np.arange(-180.0, 181.0, 90.0 if len(measured.outputs) <= 3 else 180.0).tolist()
    figure, axes = _empty(measured, matrix, ticks, "phase of G in degrees")
    everywhere = np.ones(phase.shape, bool)
    style.plot_points(axes, *matrix.placed(measured.freq_hz, phase), above_2sigma(measured), everywhere)
    if modelled is not None:
        axes.plot(*matrix.curve(*_unwrapped(modelled)), color=style.FITTED, lw=1.1, label="fitted model")
    return style.finish(figure, title, (), (axes,), markerscale=2.0)


def _unwrapped(modelled: FrequencyResponse) -> tuple[FloatArray, FloatArray]:
    """Every line twice, (2 F,), and the phase (2 F, n_y, n_u) in degrees: NaN the second time where it wraps."""
    phase = np.degrees(np.angle(modelled.G))
    again = phase.copy()
    again[:-1][np.abs(np.diff(phase, axis=0)) > 180] = np.nan
    return np.repeat(modelled.freq_hz, 2), np.stack([phase, again], axis=1).reshape(-1, *phase.shape[1:])


def _levels(measured: FrequencyResponse, std: FloatArray | None) -> dict[str, tuple[FloatArray, str, str]]:
    levels = {
        label: (style.in_db(smoothed_std(measured, covariance)[0]), color, dashes)
        for covariance, label, color, dashes in (
            (measured.noise, "std of noise", style.NOISE, "--"),
            (measured.total, "std of noise + nonlinear", style.TOTAL, ":"),
        )
        if covariance is not None
    }
    return levels if std is None else levels | {"std of the model": (style.in_db(std), style.START, "-.")}


def singular_values(measured: FrequencyResponse, modelled: FrequencyResponse | None, title: str) -> Figure:
    """min(n_y, n_u) singular values of G in dB by frequency; grey below 2 sigma of the whole matrix.

    Noise lifts small singular values: below the Frobenius norm of sigma they cannot be distinguished from zero.
    """
    f = measured.freq_hz
    s_measured = np.asarray(np.linalg.svd(measured.G, compute_uv=False), float)
    noise = np.linalg.norm(sigma_of(measured)[0], axis=(1, 2))
    above = s_measured >= 2 * noise[:, None]
    figure, ((axes,),) = style.panels(1, 1, (7.5, 4.0))
    for k in range(s_measured.shape[1]):
        style.plot_points(axes, f, style.in_db(s_measured[:, k]), above[:, k])
    if modelled is not None:
        s_modelled = style.in_db(np.asarray(np.linalg.svd(modelled.G, compute_uv=False), float))
        axes.plot(modelled.freq_hz, s_modelled, color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
    if noise.any():
        axes.plot(f, style.in_db(noise), color=style.TOTAL, lw=1, ls=":", label="sigma of the matrix")
    style.set_log_frequency(axes, f)
    style.label(axes, x=style.frequency_label(measured.rate_is_known), y=f"dB re 1 {style.pretty_unit(measured.unit)}")
    return style.finish(figure, f"Singular values, {title}", (axes,), (axes,), markerscale=2.0)


def _empty(
    response: FrequencyResponse, matrix: PanelMatrix, ticks: Sequence[float], y_label: str
) -> tuple[Figure, Axes]:
    """A panel for each element, inputs across, outputs down, with names and without curves."""
    figure, axes = empty_panels(matrix, ticks)
    outputs = [f"{response.quantity} at {output}" if matrix.rows <= 3 else output for output in response.outputs]
    inputs = zip(response.inputs, response.units_of_inputs, strict=True)
    name_panels(axes, matrix, outputs, [f"{INPUT_NOUN.get(unit, 'torque')} at {source}" for source, unit in inputs])
    style.label_figure(figure, style.frequency_label(response.rate_is_known), y_label)
    return figure, axes


def _band_db(G: ComplexArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """20 log10 of |G| -+ 2 std, not below a thousandth of |G|."""
    magnitude = np.abs(G)
    return style.in_db(np.maximum(magnitude - 2 * std, 1e-3 * magnitude)), style.in_db(magnitude + 2 * std)


def _db_range(curves_db: Iterable[FloatArray], stds_db: Iterable[FloatArray]) -> tuple[float, float]:
    """One range for the matrix: points above 2 sigma, the model there, and the noise down to 30 dB below them."""
    shown = np.concatenate([curve.ravel() for curve in curves_db])
    shown = shown[np.isfinite(shown)]
    if shown.size == 0:
        return -100.0, 0.0
    high, low = float(shown.max()), float(np.percentile(shown, 1))
    noise = [float(np.nanpercentile(std_db, 10)) - 10 for std_db in stds_db if np.isfinite(std_db).any()]
    low = max(min([low, *noise]), low - NOISE_ROOM_DB, high - MAX_RANGE_DB)
    margin = 0.05 * (high - low) + 1
    return low - margin, high + margin


def bode(measured: FrequencyResponse, modelled: FrequencyResponse | None, std: FloatArray | None) -> Figure:
    """A pair of panels for each element, inputs across, outputs down; points are grey below 2 sigma.

    modelled: with the inputs and outputs of `measured`, on any lines.  std (F, n_y, n_u): of it, a band of 2 std.
    """
    n_y, n_u = len(measured.outputs), len(measured.inputs)
    left, right, top, bottom = margins = 0.9, 0.3, 1.0, 0.55
    size = left + n_u * PANEL_WIDTH + right, top + 2 * n_y * PANEL_HEIGHT + bottom
    figure, panels = style.panels(2 * n_y, n_u, size, margins, (0.25, 0.15), sharex=True)
    above = above_2sigma(measured)
    for i, j in np.ndindex(n_y, n_u):
        magnitude, phase = panels[2 * i, j], panels[2 * i + 1, j]
        f, G = measured.freq_hz, measured.G[:, i, j]
        style.plot_points(magnitude, f, style.in_db(G), above[:, i, j])
        style.plot_points(phase, f, np.degrees(np.angle(G)), above[:, i, j])
        if modelled is not None:
            _draw_model(magnitude, phase, modelled, i, j, std)
        _label(magnitude, phase, measured, i, j)
    style.set_log_frequency(panels[0, 0], measured.freq_hz)
    style.label_figure(figure, style.frequency_label(measured.rate_is_known))
    title = f"{measured.quantity} of {measured.configuration.name}"
    return style.finish(figure, title, panels.flat, panels.flat, markerscale=2.0)


def _draw_model(magnitude: Axes, phase: Axes, model: FrequencyResponse, i: int, j: int, std: FloatArray | None) -> None:
    f, G = model.freq_hz, model.G[:, i, j]
    if std is not None:
        looks: dict[str, Any] = {"color": style.FITTED, "alpha": 0.25, "lw": 0, "label": "2 std of the model"}
        magnitude.fill_between(f, *_band_db(G, std[:, i, j]), **looks)
    magnitude.plot(f, style.in_db(G), color=style.FITTED, lw=1.1, zorder=3, label="model")
    lines, degrees = _unwrapped(model)
    phase.plot(lines, degrees[:, i, j], color=style.FITTED, lw=1.1)


def _label(magnitude: Axes, phase: Axes, measured: FrequencyResponse, i: int, j: int) -> None:
    phase.set_ylim(-190, 190)
    phase.yaxis.set_major_locator(MultipleLocator(90))
    if i == 0:
        style.label(magnitude, title=f"by {measured.inputs[j]}")
    if j == 0:
        style.label(magnitude, y=f"dB re 1 {style.pretty_unit(measured.unit)}")
        style.label(phase, y="phase in degrees")
    if j == len(measured.inputs) - 1:
        style.label_row(magnitude, measured.outputs[i])


def levels(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """RMS amplitude in dB of every output: excited lines, nonlinearities of even and odd order, stochastic, noise.

    Levels of an experiment's mean over periods; the power of the noise is subtracted from that of the detection lines.
    """
    n_y = len(response.outputs)
    columns = min(n_y, 3)
    figure, panels = _quality_panels(-(-n_y // columns), columns, 2.3)
    for i, (output, axes) in enumerate(zip(response.outputs, panels.flat, strict=False)):
        _plot_levels(axes, response, quality, i)
        style.label(axes, title=f"{response.quantity} at {output}")
    for spare in panels.flat[n_y:]:
        spare.set_axis_off()
    _label_quality(figure, response, f"RMS amplitude in dB re 1 {style.pretty_unit(response.output_unit)}")
    return style.finish(figure, title, figure.axes, figure.axes, markerscale=2.0)


def coherence(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """1 - multiple coherence of every output, singular values of G, and those of the inputs with their condition."""
    figure, ((lost, gains, inputs),) = _quality_panels(1, 3, 2.6)
    f = response.freq_hz
    for i, output in enumerate(response.outputs):
        unexplained = np.maximum(1 - quality.multiple_coherence[:, i], 1e-16)  # less is rounding
        lost.plot(f, unexplained, lw=0.8, color=style.SERIES[i % len(style.SERIES)], label=style.plain_label(output))
    lost.set_yscale("log")
    gains.plot(f, style.in_db(quality.singular_values), lw=0.8, color=style.MEASURED)
    inputs.plot(f, style.in_db(quality.input_singular_values), lw=0.8, color=style.START)
    style.label(lost, title="1 − multiple coherence")
    style.label(gains, title="singular values of G in dB")
    style.label(inputs, title=f"singular values of the inputs in dB, condition {np.median(quality.condition):.3g}")
    _label_quality(figure, response)
    return style.finish(figure, title, figure.axes, [lost])


def _plot_levels(axes: Axes, response: FrequencyResponse, quality: Quality, i: int) -> None:
    f, excited = response.freq_hz, quality.excited
    axes.plot(f, style.in_db(excited.amplitude[:, i]), **style.DOTS, ms=2, color=style.MEASURED, label="excited lines")
    axes.plot(f, style.in_db(excited.noise[:, i]), lw=0.7, color=style.NOISE, label="noise")
    if quality.stochastic is not None:
        axes.plot(f, style.in_db(quality.stochastic[:, i]), lw=0.7, color=style.TOTAL, label="stochastic nonlinear")
    for lines, color, label in (
        (quality.even, style.FITTED, "nonlinear, even"),
        (quality.odd, style.START, "nonlinear, odd"),
    ):
        if lines is not None:
            level = np.sqrt(np.maximum(lines.amplitude[:, i] ** 2 - lines.noise[:, i] ** 2, 0.0))
            axes.plot(lines.freq_hz, style.in_db(level), **style.DOTS, ms=1.4, color=color, label=label)


def _quality_panels(rows: int, columns: int, panel_height: float) -> tuple[Figure, NDArray[Any]]:
    return style.panels(rows, columns, (style.WIDE, 1.25 + rows * panel_height), spaces=(0.25, 0.25), sharex=True)


def _label_quality(figure: Figure, response: FrequencyResponse, y_label: str = "") -> None:
    style.set_log_frequency(figure.axes[0], response.freq_hz, most=4)
    style.label_figure(figure, style.frequency_label(response.rate_is_known), y_label)
