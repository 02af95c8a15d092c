"""Figures of identified parameters, plans, gears, frequency responses, torque balances and fleets."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.display import degrees
from elastid.design.forecast import Forecast
from elastid.design.limit_use import QUANTITIES, LimitUse
from elastid.fit.result import Result
from elastid.nonlinear.gear_result import ARCMIN, GearResult, GearSheet
from elastid.report.figures import style
from elastid.report.figures.style import Cells, Curve, Panel, in_db
from elastid.report.parameter_row import ParameterRow
from elastid.response import Quality, Response
from elastid.robot import Robot
from elastid.validation.log_comparison import (
    DRY,
    ELASTICITY,
    FRICTION,
    GRAVITY,
    INERTIA,
    MIN_POWER_SHARE,
    RIGID_BODY,
    VISCOUS,
    TorqueBalance,
)
from elastid.validation.residual_tests import above_2sigma

if TYPE_CHECKING:
    from elastid.modal.modes import Modes
    from elastid.validation.command_replay import JointError  # slow imports: simulation, SciPy's statistics
    from elastid.validation.fleet import FleetValue


def forest(rows: Sequence[ParameterRow]) -> Figure:
    """Draw start and estimate relative to a reference (left) and the deviation in percent (right).

    The reference is the true value if it is known, else the estimate. Bars are 95 % intervals.
    """
    y, reference = np.arange(float(len(rows))), np.array([row.reference for row in rows])
    truths = [np.nan if row.truth is None else row.truth for row in rows]
    values = np.array([(row.estimate, *row.interval, truth) for row, truth in zip(rows, truths, strict=True)])
    start = np.array([row.start for row in rows]) / reference
    bounds = np.array([row.bounds for row in rows]).T / reference
    ratios = values / reference[:, None]
    finite = np.concatenate([start, ratios[:, 0], ratios[:, 3]])
    finite = finite[np.isfinite(finite) & (finite > 0)]
    low, high = min(0.5, *finite) / 1.15, max(2.0, *finite) * 1.15
    marks = [Curve(start, y, "start", style.START, True, looks={"mfc": "none", "mew": 1})]
    pairs = zip(bounds, (bounds > low) & (bounds < high), strict=True)
    marks += [Curve(end[rows], y[rows], "bound", style.WEAK, True, looks=_BAR) for end, rows in pairs if rows.any()]
    at_bound = np.array([row.at_bound for row in rows])
    percent = 100 * np.sign(reference)[:, None] * (ratios - 1)  # larger values are on the right
    half = (percent[:, 2] - percent[:, 1]) / 2
    typical = float(np.percentile(half[np.isfinite(half) & (half > 0)], 25)) if (half > 0).any() else 1.0
    extent = np.abs(percent[:, :3])
    largest = float(np.clip(extent[np.isfinite(extent)].max(initial=typical), 1.5 * typical, 300.0))
    ends = -1.3 * largest, 1.3 * largest
    beyond = np.abs(percent[:, 0]) > ends[1]
    edge = Curve(0.92 * ends[1] * np.sign(percent[beyond, 0]), y[beyond], "estimate off the scale", style.FITTED, True)
    has_truth = [row.truth is not None for row in rows]
    ref = "truth" if all(has_truth) else "truth (estimate where none is known)" if any(has_truth) else "estimate"
    panels = [
        Panel([*marks, *_values(ratios, at_bound)], f"ratio to the {ref}", x_ends=(low, high)),
        Panel(
            [*_values(percent, at_bound), *[edge] * bool(beyond.any())], f"deviation from the {ref} in %", x_ends=ends
        ),
    ]
    left_margin, heights = 0.4 + 0.075 * max(len(row.name) for row in rows), [0.26 * len(rows) + 0.3]
    figure = style.matrix("Parameters", [panels], heights, left=left_margin, sharey=True)
    ratio, deviation = figure.axes
    style.set_names(ratio.yaxis, [row.name for row in rows])
    ratio.set_ylim(len(rows) - 0.4, -0.6)
    ratio.set_xscale("log")
    style.set_plain_ticks(ratio.xaxis, style.round_ticks(low, high, 7))
    deviation.set_xscale("symlog", linthresh=typical)  # 0.1 % and 100 % can be read in one figure
    deviation.set_xlim(*ends)
    decades = [10.0**k for k in range(math.ceil(math.log10(typical)), 4) if 10.0**k <= ends[1]]
    style.set_plain_ticks(deviation.xaxis, [*(-tick for tick in reversed(decades)), 0.0, *decades])
    return figure


_BAR = {"marker": "|", "ms": 10, "mew": 1.4}


def _values(values: FloatArray, at_bound: BoolArray) -> list[Curve]:
    """Return curves of values (n, 4) at rows 0, 1, 2 ...: estimate, ends of the interval, truth (NaN if unknown)."""
    y = np.arange(float(len(values)))
    between = np.column_stack([values[:, 1:3], np.full(len(y), np.nan)]).ravel()
    curves = [Curve(between, np.repeat(y, 3), "95 % interval")]
    for rows, text, ink in ((~at_bound, "estimate", style.MEASURED), (at_bound, "estimate at its bound", style.FITTED)):
        curves += [Curve(values[rows, 0], y[rows], text, ink, True)] if rows.any() else []
    truth = Curve(values[:, 3], y, "truth", style.TRUTH, True, looks=_BAR)
    return [*curves, *[truth] * bool(np.isfinite(values[:, 3]).any())]


def identifiability(result: Result) -> Figure:
    """Draw the correlations of the estimates, with numbers where |r| > 0.9."""
    n = len(result.parameters.of_interest)
    r, names = result.correlation[:n, :n], result.parameters.free_names[:n]
    cells = Cells(r, names, names, (-1.0, 1.0), lambda v: f"{v:.2f}" if 0.9 < abs(v) < 1 else "", "RdBu_r")
    return style.matrix("Correlation of the estimates", [[Panel(cells=cells)]])


def information(forecast: Forecast) -> Figure:
    """Draw fractions of the expected Fisher information in percent, by configuration and octave."""
    names, f = forecast.configurations, forecast.freq_hz
    octave = np.floor(np.log2(f / f[0]) + 1e-9).astype(int)
    by_octave, edges = np.zeros((len(names), octave[-1] + 1)), f[0] * 2.0 ** np.arange(octave[-1] + 1)
    np.add.at(by_octave.T, octave, 100 * forecast.information_fraction.mean(axis=2).T)

    def text(value: float) -> str:
        return f"{value:.0f}" if value >= 0.5 else ""

    cells = Cells(by_octave, names, [f"{edge:.3g}" for edge in edges], (0.0, max(float(by_octave.max()), 1.0)), text)
    return style.matrix("Expected information in %", [[Panel(x="start of the octave in Hz", cells=cells)]])


def limit_use(use: LimitUse) -> Figure:
    """Draw peaks in % of the limits: configurations (rows) by motors (columns), a panel per limited quantity."""
    kinds = np.flatnonzero(np.isfinite(use.limit).any(axis=(0, 2)))
    motors = [name.removeprefix("motor ") for name in use.inputs]
    percent = 100 * np.where(np.isfinite(use.limit), use.used, np.nan)
    panels = [
        Panel(x="motor", title=QUANTITIES[kind],
              cells=Cells(percent[:, kind], () if i else use.configurations, motors, (0.0, 130.0)))
        for i, kind in enumerate(kinds)
    ]  # fmt: skip
    return style.matrix(f"Peak values in % of the limits (design limit {1 - use.margin:.0%})", [panels])


def hysteresis(gears: GearResult, robot: Robot | None) -> Figure:
    """Draw two panels per gear: torsion with its 95 % band, and its difference from a linear spring."""
    above, below = [], []
    for sheet in gears.sheets:
        slides = robot is not None and robot.slides(f"motor {sheet.joint}")
        factor, angle, torque = (1e3, "mm", "N") if slides else (ARCMIN, "arcmin", "N·m")
        stiffness = sheet.number(f"k_{sheet.joint}")
        linear = sheet.torque / (math.inf if stiffness is None else stiffness.value)
        straight = Curve(sheet.torque, factor * linear, "k at zero torque", style.WEAK, looks={"ls": "--"})
        label, title = f"torque of the gear in {torque}", f"joint {sheet.joint}"
        above.append(Panel([*_loop(sheet, 0.0 * linear, factor), straight], label, f"torsion in {angle}", title))
        below.append(Panel(_loop(sheet, linear, factor), label, f"less torque / k, {angle}", title))
    return style.matrix("Torsion of the gears over their torque", style.in_columns(above, below))


def _loop(sheet: GearSheet, subtracted: FloatArray, factor: float) -> list[Curve]:
    y, half = factor * (sheet.torsion - subtracted), len(sheet.torque) // 2
    curves = []
    for half_loop in (slice(None, half), slice(half, None)):
        rising = np.argsort(sheet.torque[half_loop])
        x, torsion, std = (x_all[half_loop][rising] for x_all in (sheet.torque, y, factor * sheet.torsion_std))
        band = style.band_95(torsion, std)
        curves.append(Curve(x, torsion, "torsion, to and fro", style.FITTED, band=band, band_label="95 % band"))
    return curves


def configuration_title(measured: Response, left_out: bool) -> str:
    """Return name, joint angles and role in the fit of a configuration; the name only without a robot."""
    if not measured.configuration.angles.size:
        return measured.configuration.name
    angles = degrees(measured.configuration.angles.tolist())
    return f"{measured.configuration.name} ({angles}), {'left out of the fit' if left_out else 'fitted'}"


def bode(measured: Response, modelled: Response | None, std: FloatArray | None) -> Figure:
    """Draw magnitude and phase per FRF element, a column per input and a row per output; below 2 sigma grey.

    modelled: same inputs and outputs, any lines.  std (F, n_y, n_u): of the model, drawn as a band of 2 std.
    """
    rows = []
    above, label = above_2sigma(measured), style.frequency_label(measured.has_rate)
    n_y, n_u = len(measured.outputs), len(measured.inputs)
    for i in range(n_y):
        magnitude, phase = [], []
        for j, source in enumerate(measured.inputs):
            curve = _measured(measured, above[:, i, j], measured.G[:, i, j])
            curves_of_model = ([], []) if modelled is None else _modelled(modelled, i, j, std)
            names = (measured.outputs[i], "degrees") if j == 0 else ("", "")
            title = f"by {source}" if i == 0 else ""
            lines = measured.freq_hz
            magnitude.append(Panel([*curve[0], *curves_of_model[0]], y=names[0], title=title, frequency=lines))
            last, ends = label if i == n_y - 1 else "", (-190.0, 190.0)
            phase.append(Panel([*curve[1], *curves_of_model[1]], last, names[1], frequency=lines, y_ends=ends))
        rows += [magnitude, phase]
    unit = style.pretty_unit(measured.unit)
    title = f"{measured.quantity} of {measured.configuration.name}, dB re 1 {unit} and phase"
    return style.matrix(title, rows, [1.2] * len(rows), 1.2 + 3.4 * n_u, sharex=True)


def _measured(measured: Response, above: BoolArray, G: ComplexArray) -> tuple[list[Curve], list[Curve]]:
    kinds = ((above, "measured", style.MEASURED), (~above, "measured, below 2 sigma", style.WEAK))
    f = measured.freq_hz
    magnitude, phase = (
        [Curve(f[rows], values[rows], text, ink, True) for rows, text, ink in kinds if rows.any()]
        for values in (in_db(G), np.degrees(np.angle(G)))
    )
    return magnitude, phase


def _modelled(model: Response, i: int, j: int, std: FloatArray | None) -> tuple[list[Curve], list[Curve]]:
    """Return curves of magnitude with its band (at least 1e-3 of the magnitude) and of phase, broken at wraps."""
    G, f = model.G[:, i, j], model.freq_hz
    size, phase, band = np.abs(G), np.degrees(np.angle(G)), None
    if std is not None:
        spread = 2 * std[:, i, j]
        band = in_db(np.maximum(size - spread, 1e-3 * size)), in_db(size + spread)
    next_phase = phase.copy()
    next_phase[:-1][np.abs(np.diff(phase)) > 180] = np.nan
    magnitude = Curve(f, in_db(G), "model", style.FITTED, band=band, band_label="2 std of the model")
    return [magnitude], [Curve(np.repeat(f, 2), np.stack([phase, next_phase], axis=1).ravel(), "model", style.FITTED)]


def quality_figure(response: Response, quality: Quality, title: str) -> Figure:
    """Draw rms amplitudes of every output in dB, 1 - multiple coherence, and singular values of G and the inputs.

    Amplitudes of the mean over periods on excited lines, of the noise, and of nonlinear distortion of even and odd
    order; the noise power is subtracted from the power at the detection lines.
    """
    f, label = response.freq_hz, style.frequency_label(response.has_rate)
    unit = f"dB re 1 {style.pretty_unit(response.output_unit)}"
    panels = [
        Panel(_amplitudes(f, quality, i), label, unit, f"{response.quantity} at {output}", frequency=f)
        for i, output in enumerate(response.outputs)
    ]
    incoherent = [
        Curve(f, np.maximum(1 - coherence, 1e-16), color=style.SERIES[i % len(style.SERIES)])  # rounding errors
        for i, coherence in enumerate(quality.multiple_coherence.T)
    ]
    panels.append(Panel(incoherent, label, title="1 − multiple coherence", frequency=f, scale="log"))
    for sigma, name in ((quality.singular_values, "G"), (quality.input_singular_values, "the inputs")):
        caption = f"singular values of {name}, dB; condition {np.median(sigma[:, 0] / sigma[:, -1]):.3g}"
        panels.append(Panel([Curve(f, in_db(column)) for column in sigma.T], label, title=caption, frequency=f))
    return style.matrix(title, style.in_columns(panels))


def _amplitudes(f: FloatArray, quality: Quality, i: int) -> list[Curve]:
    excited = quality.excited
    curves = [
        Curve(f, in_db(excited.amplitude[:, i]), "excited lines", dots=True),
        Curve(f, in_db(excited.noise[:, i]), "noise", style.NOISE),
    ]
    if quality.stochastic is not None:
        curves.append(Curve(f, in_db(quality.stochastic[:, i]), "stochastic nonlinear", style.TOTAL))
    for lines, ink, name in ((quality.even, style.FITTED, "even"), (quality.odd, style.START, "odd")):
        if lines is not None:
            amplitude = np.sqrt(np.maximum(lines.amplitude[:, i] ** 2 - lines.noise[:, i] ** 2, 0.0))
            curves.append(Curve(lines.freq_hz, in_db(amplitude), f"nonlinear, {name}", ink, True))
    return curves


def stabilisation_diagram(modes: Modes, title: str) -> Figure:
    """Draw poles by frequency and model order with lines at the modes, and the singular values of the response."""
    diagram, stable = modes.diagram, "stable in frequency (1 %) and damping (5 %)"
    poles = [
        Curve(diagram.freq_hz[rows], diagram.order[rows], text, ink, True)
        for rows, text, ink in ((~diagram.stable, "pole", style.WEAK), (diagram.stable, stable, style.MEASURED))
    ]
    top = float(diagram.order.max(initial=1))
    lines = [Curve([f, f], [0.0, top], "mode", style.FITTED) for f in modes.freq_hz]
    values = [Curve(modes.at_hz, column, color=style.WEAK) for column in in_db(modes.indicators).T]
    ends = float(modes.at_hz[0]), float(modes.at_hz[-1])
    below = Panel(values, style.frequency_label(modes.has_rate), "singular values, dB", x_ends=ends)
    rows = [[Panel([*lines, *poles], y="order", x_ends=ends)], [below]]
    return style.matrix(f"Stabilisation diagram, {title}", rows, sharex=True)


COLORS = {
    INERTIA: style.TOTAL, RIGID_BODY: style.TOTAL, GRAVITY: style.MEASURED, VISCOUS: style.NOISE, DRY: style.START,
    ELASTICITY: style.TRUTH,
}  # fmt: skip
TORQUE_CAPTION = (
    "torque of the log and of the model for the measured motion; terms of the model; by octave, the unexplained "
    "fraction of the mean square, with and without friction, and the fraction of the torque's power."
)


def torque_balance_figure(balance: TorqueBalance) -> Figure:
    """Draw measured and modelled torque, the model terms, and the unexplained fraction by octave."""
    step = style.thinned(len(balance.measured))
    t = (np.arange(len(balance.measured)) / balance.rate_hz)[step]
    modelled = balance.measured - balance.residual
    signals = [(balance.measured, style.MEASURED, "measured"), (modelled, style.FITTED, "model")]
    if any(name in FRICTION for name in balance.parts):
        signals.insert(0, (modelled - balance.torque_sum(FRICTION), style.WEAK, "model without friction"))
    signals.append((balance.residual, style.RESIDUAL, "measured − model"))
    total = [Curve(t, torque[step], text, ink) for torque, ink, text in signals]
    terms = [
        Curve(t, torque[step], name, COLORS[name]) for name, torque in zip(balance.parts, balance.torques, strict=True)
    ]
    curves = [
        Curve(np.arange(len(balance.bands)), [100 * max(getattr(band, key), 1e-7) for band in balance.bands], text, ink,
              looks={"marker": "o", "ls": ":"})
        for key, ink, text in (
            ("unexplained_fraction", style.RESIDUAL, "unexplained"),
            ("unexplained_without_friction", style.WEAK, "unexplained without friction"),
            ("power", style.MEASURED, "fraction of the torque's power"),
        )
    ]  # fmt: skip
    unit, time = style.pretty_unit(balance.unit), "time in s" if balance.has_rate else "time in samples"
    below = Panel(curves, style.frequency_label(balance.has_rate), "%", scale="log")
    title = f"{balance.place}, {balance.log}: {100 * balance.unexplained_fraction:.2g} % of the mean square unexplained"
    figure = style.matrix(title, [[Panel(total, y=unit)], [Panel(terms, time, unit)], [below]])
    style.set_names(figure.axes[-1].xaxis, [f"{band.low_hz:.3g}–{band.high_hz:.3g}" for band in balance.bands])
    return figure


def octaves_figure(balances: Sequence[TorqueBalance]) -> Figure:
    """Draw the ratio of unexplained to measured rms torque in percent, by axis and octave."""
    edges = sorted({band.high_hz for balance in balances for band in balance.bands})
    label = f"octave below {'Hz' if all(balance.has_rate for balance in balances) else 'sampling rates'}"
    values = np.full((len(balances), len(edges)), np.nan)
    for i, balance in enumerate(balances):
        for band in (band for band in balance.bands if band.power >= MIN_POWER_SHARE):
            values[i, edges.index(band.high_hz)] = 100 * math.sqrt(band.unexplained_fraction)
    names, columns = [f"{row.place}, {row.log}" for row in balances], [f"{edge:.3g}" for edge in edges]
    panel = Panel(x=label, title="unexplained torque, % of its rms", cells=Cells(values, names, columns))
    return style.matrix("Unexplained torque by octave", [[panel]])


def command_errors_figure(joints: Sequence[JointError]) -> Figure:
    """Draw the error of the model relative to the best trivial predictor, by joint and octave."""
    edges = [high for _, high, _ in joints[0].octaves]
    ratio = np.array([[100 * x[0] / max(min(x[1:]), 1e-300) for *_, x in row.octaves] for row in joints])
    cells = Cells(ratio, [row.joint for row in joints], [f"{edge:.3g}" for edge in edges])
    panel = Panel(x="octave below Hz", title="rms error, % of the best trivial predictor", cells=cells)
    return style.matrix("Error of the positions from commands alone", [[panel]])


def fleet_parameter(name: str, unit: str, values: Sequence[FleetValue], conspicuous: Collection[str]) -> Figure:
    """Draw a parameter with 95 % intervals: one column per robot, dates from left to right, findings marked."""
    robots, days = list(dict.fromkeys(value.robot for value in values)), sorted({value.day for value in values})
    width, curves = 0.6 / max(1, len(days)), []
    for is_marked in (False, True):
        if points := [value for value in values if (value.robot in conspicuous) == is_marked]:
            x = np.array([robots.index(v.robot) + width * (days.index(v.day) - (len(days) - 1) / 2) for v in points])
            y, std = np.array([(value.value, value.std) for value in points]).T
            text = "differs or drifts" if is_marked else "robot, dates from left to right"
            curves.append(Curve(x, y, text, style.FITTED if is_marked else style.TOTAL, True, style.band_95(y, std)))
    unit_text, names_fit = f" in {style.pretty_unit(unit)}" if unit else "", len(robots) <= 40
    panel = Panel(curves, "" if names_fit else "robot", f"{name}{unit_text}", columns=robots if names_fit else ())
    figure = style.matrix(f"{name} over the fleet", [[panel]])
    figure.axes[0].ticklabel_format(axis="y", useOffset=False)
    return figure
