"""The response matrix of one configuration: magnitude, phase and singular values, beside a model where there is one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.report.figures.panel_matrix import PanelMatrix, empty_panels, name_panels
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
    figure, axes = _empty(measured, matrix, ticks, title, f"|G| in dB re 1 {style.pretty_unit(measured.unit)}")
    drawn, spread = (modelled, std) if dense is None else dense
    if drawn is not None and spread is not None:
        band = matrix.band(*_band_db(drawn.G, spread), drawn.freq_hz)
        axes.fill_between(*band, color=style.FITTED, alpha=0.25, lw=0)
    style.plot_points(axes, *matrix.placed(f, Ghat_db), above, matrix.inside(Ghat_db))
    if drawn is not None and modelled is not None:
        axes.plot(
            *matrix.curve(drawn.freq_hz, style.in_db(drawn.G)),
            color=style.FITTED,
            lw=1.1,
            zorder=3,
            label="fitted model",
        )
        left = matrix.curve(f, style.in_db(measured.G - modelled.G))
        axes.plot(*left, color=style.RESIDUAL, lw=0.5, zorder=1, label="|measured − model|")
    for label, (std_db, color, dashes) in levels.items():
        axes.plot(*matrix.curve(f, std_db), color=color, lw=1.0, ls=dashes, zorder=1.5, label=label)
    style.add_legend(figure, (axes,), markerscale=2.0)
    return figure


def frf_phase(measured: FrequencyResponse, modelled: FrequencyResponse | None, title: str) -> Figure:
    """Phase of G in degrees of every element, wrapped to (-180, 180]; the model's line is broken where it wraps."""
    phase = np.degrees(np.angle(measured.G))
    matrix = PanelMatrix(measured.freq_hz, (-190.0, 190.0), *phase.shape[1:])
    ticks = np.arange(-180.0, 181.0, 90.0 if len(measured.outputs) <= 3 else 180.0).tolist()
    figure, axes = _empty(measured, matrix, ticks, title, "phase of G in degrees")
    everywhere = np.ones(phase.shape, bool)
    style.plot_points(axes, *matrix.placed(measured.freq_hz, phase), above_2sigma(measured), everywhere)
    if modelled is not None:
        axes.plot(*matrix.curve(*_unwrapped(modelled)), color=style.FITTED, lw=1.1, label="fitted model")
    style.add_legend(figure, (axes,), markerscale=2.0)
    return figure


def _unwrapped(modelled: FrequencyResponse) -> tuple[FloatArray, FloatArray]:
    """Every line twice, (2 F,), and the phase (2 F, n_y, n_u) in degrees: NaN the second time where it wraps."""
    phase = np.degrees(np.angle(modelled.G))
    again = phase.copy()
    again[:-1][np.abs(np.diff(phase, axis=0)) > 180] = np.nan
    return np.repeat(modelled.freq_hz, 2), np.stack([phase, again], axis=1).reshape(-1, *phase.shape[1:])


def _levels(measured: FrequencyResponse, std: FloatArray | None) -> dict[str, tuple[FloatArray, str, str]]:
    """Standard deviations in dB (F, n_y, n_u) with colour and dashes, by their label."""
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
    s_modelled = None if modelled is None else np.asarray(np.linalg.svd(modelled.G, compute_uv=False), float)
    lines = f if modelled is None else modelled.freq_hz
    noise = np.linalg.norm(sigma_of(measured)[0], axis=(1, 2))
    above = s_measured >= 2 * noise[:, None]
    figure, ((axes,),) = style.panels(1, 1, (7.5, 4.0))
    for k in range(s_measured.shape[1]):
        style.plot_points(axes, f, style.in_db(s_measured[:, k]), above[:, k])
        if s_modelled is not None:
            axes.plot(lines, style.in_db(s_modelled[:, k]), color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
    if noise.any():
        axes.plot(f, style.in_db(noise), color=style.TOTAL, lw=1, ls=":", label="sigma of the matrix")
    style.lighten(axes)
    style.set_log_frequency(axes, f)
    style.label(axes, x=style.frequency_label(measured.rate_is_known), y=f"dB re 1 {style.pretty_unit(measured.unit)}")
    style.add_title(figure, f"Singular values, {title}")
    style.add_legend(figure, (axes,), markerscale=2.0)
    return figure


def _empty(
    response: FrequencyResponse, matrix: PanelMatrix, ticks: Sequence[float], title: str, y_label: str
) -> tuple[Figure, Axes]:
    """A panel for each element, inputs across, outputs down, with names and title, and without curves."""
    figure, axes = empty_panels(matrix, ticks)
    outputs = [f"{response.quantity} at {output}" if matrix.rows <= 3 else output for output in response.outputs]
    inputs = zip(response.inputs, response.units_of_inputs, strict=True)
    name_panels(axes, matrix, outputs, [f"{INPUT_NOUN.get(unit, 'torque')} at {source}" for source, unit in inputs])
    style.label_figure(figure, style.frequency_label(response.rate_is_known), y_label)
    style.add_title(figure, title)
    return figure, axes


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
