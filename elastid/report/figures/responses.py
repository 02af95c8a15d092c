"""The response matrix of one configuration: magnitude, phase and singular values, beside a model where there is one."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import above_2sigma, sigma_of, smoothed_std

# The y range ends at most so many dB below the points that count, and below the highest.
NOISE_ROOM_DB, MAX_RANGE_DB = 30.0, 120.0
# The band of the model ends at this part of |G|.
MIN_BAND = 1e-3


# The noun of an input by its unit.
INPUT_NOUN = {"N": "force", "V": "voltage", "A": "current"}


def configuration_title(measured: FrequencyResponse, left_out: bool) -> str:
    """Name, angles of the driven joints, and whether the configuration was fitted; of a structure the name."""
    if not measured.configuration.angles.size:
        return measured.configuration.name
    angles = ", ".join(f"{angle:.4g}°" for angle in np.degrees(measured.configuration.angles))
    return f"{measured.configuration.name} ({angles}), {'left out of the fit' if left_out else 'fitted'}"


def frf_magnitude(
    measured: FrequencyResponse, modelled: FrequencyResponse | None, title: str, std: FloatArray | None = None
) -> Figure:
    """|G| in dB of every element (n_y rows, n_u columns) on one y range.

    Measured: points, grey below 2 sigma.  Model: line, with a band of 2 std.  Standard deviations of noise, of noise
    and nonlinear distortion, and of the model: dashed and dotted.  |Ghat - G|: thin.
    std (F, n_y, n_u): of the model, due to the uncertainty of its parameters.
    """
    above = above_2sigma(measured)
    f = measured.freq_hz
    Ghat_db = style.in_db(measured.G)
    model = None if modelled is None else (style.in_db(modelled.G), style.in_db(measured.G - modelled.G))
    levels = {
        label: (style.in_db(smoothed_std(measured, covariance)[0]), color, dashes)
        for covariance, label, color, dashes in (
            (measured.noise, "std of noise", style.NOISE, "--"),
            (measured.total, "std of noise + nonlinear", style.TOTAL, ":"),
        )
        if covariance is not None
    }
    band = None if std is None or modelled is None else _band_db(modelled.G, std)
    if std is not None:
        levels["std of the model"] = (style.in_db(std), style.START, "-.")

    def draw(axes: Axes, i: int, j: int) -> None:
        style.plot_points(axes, f, Ghat_db[:, i, j], above[:, i, j])
        if band is not None:
            axes.fill_between(f, band[0][:, i, j], band[1][:, i, j], color=style.FITTED, alpha=0.25, lw=0)
        if model is not None:
            axes.plot(f, model[0][:, i, j], color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
            axes.plot(f, model[1][:, i, j], color=style.RESIDUAL, lw=0.5, zorder=1, label="|measured − model|")
        for label, (std_db, color, dashes) in levels.items():
            axes.plot(f, std_db[:, i, j], color=color, lw=1.0, ls=dashes, zorder=1.5, label=label)

    figure, corner = _matrix(measured, title, f"|G| in dB re 1 {style.pretty_unit(measured.unit)}", draw)
    stds_db = [std_db for std_db, _, _ in levels.values()]
    shown = [np.where(above, curve, np.nan) for curve in (Ghat_db, *(() if model is None else model[:1]))]
    low, high = _db_range(shown, stds_db)
    style.set_db_ticks(corner, low, high, most=6 if len(measured.outputs) <= 3 else 4)
    return figure


def frf_phase(measured: FrequencyResponse, modelled: FrequencyResponse | None, title: str) -> Figure:
    """Phase of G in degrees of every element, wrapped to (-180, 180]; the model's line is broken where it wraps."""
    above, f = above_2sigma(measured), measured.freq_hz

    def draw(axes: Axes, i: int, j: int) -> None:
        style.plot_points(axes, f, np.degrees(np.angle(measured.G[:, i, j])), above[:, i, j])
        if modelled is None:
            return
        phase = np.degrees(np.angle(modelled.G[:, i, j]))
        wraps = np.flatnonzero(np.abs(np.diff(phase)) > 180) + 1
        broken = np.insert(f, wraps, np.nan), np.insert(phase, wraps, np.nan)
        axes.plot(*broken, color=style.FITTED, lw=1.1, label="fitted model")

    figure, corner = _matrix(measured, title, "phase of G in degrees", draw)
    corner.set_ylim(-190, 190)
    corner.yaxis.set_major_locator(MultipleLocator(90 if len(measured.outputs) <= 3 else 180))
    return figure


def singular_values(measured: FrequencyResponse, modelled: FrequencyResponse | None, title: str) -> Figure:
    """min(n_y, n_u) singular values of G in dB by frequency; grey below 2 sigma of the whole matrix.

    Noise lifts small singular values: below the Frobenius norm of sigma they cannot be distinguished from zero.
    """
    f = measured.freq_hz
    s_measured = np.asarray(np.linalg.svd(measured.G, compute_uv=False), float)
    s_modelled = None if modelled is None else np.asarray(np.linalg.svd(modelled.G, compute_uv=False), float)
    noise = np.linalg.norm(sigma_of(measured)[0], axis=(1, 2))
    above = s_measured >= 2 * noise[:, None]
    figure, ((axes,),) = style.panels(1, 1, (7.5, 4.0))
    for k in range(s_measured.shape[1]):
        style.plot_points(axes, f, style.in_db(s_measured[:, k]), above[:, k])
        if s_modelled is not None:
            axes.plot(f, style.in_db(s_modelled[:, k]), color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
    if noise.any():
        axes.plot(f, style.in_db(noise), color=style.TOTAL, lw=1, ls=":", label="sigma of the matrix")
    style.lighten(axes)
    style.set_log_frequency(axes, f)
    style.label(axes, x=style.frequency_label(measured.rate_is_known), y=f"dB re 1 {style.pretty_unit(measured.unit)}")
    style.add_title(figure, f"Singular values, {title}")
    style.add_legend(figure, (axes,), markerscale=2.0)
    return figure


def _matrix(
    response: FrequencyResponse, title: str, y_label: str, draw: Callable[[Axes, int, int], None]
) -> tuple[Figure, Axes]:
    """A panel for each element, inputs across, outputs down, axes shared, one legend; and the corner panel."""
    n_y, n_u = len(response.outputs), len(response.inputs)
    panel_width, panel_height = float(np.clip(8.6 / n_u, 1.5, 6.0)), float(np.clip(5.4 / n_y, 1.1, 3.2))
    left, right, top, bottom = margins = 0.75, 0.3, 1.0, 0.55
    size = left + n_u * panel_width + right, top + n_y * panel_height + bottom
    figure, panels = style.panels(n_y, n_u, size, margins, (0.06, 0.09), sharex=True, sharey=True)
    for (i, j), axes in np.ndenumerate(panels):
        draw(axes, i, j)
        style.lighten(axes)
    for axes, output in zip(panels[:, -1], response.outputs, strict=True):
        style.label_row(axes, f"{response.quantity} at {output}" if n_y <= 3 else output)
    for axes, source, unit in zip(panels[0], response.inputs, response.units_of_inputs, strict=True):
        style.label(axes, title=f"{INPUT_NOUN.get(unit, 'torque')} at {source}")
    corner: Axes = panels[0, 0]
    style.set_log_frequency(corner, response.freq_hz, most=6 if n_u <= 3 else 3)
    style.label_figure(figure, style.frequency_label(response.rate_is_known), y_label)
    style.add_title(figure, title)
    style.add_legend(figure, panels.flat, markerscale=2.0)
    return figure, corner


def _band_db(G: ComplexArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """20 log10 of |G| -+ 2 std, not below a thousandth of |G|."""
    magnitude = np.abs(G)
    return style.in_db(np.maximum(magnitude - 2 * std, MIN_BAND * magnitude)), style.in_db(magnitude + 2 * std)


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
