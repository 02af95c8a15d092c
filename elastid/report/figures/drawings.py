"""The catalogue of figures of an elastic study and of responses, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.escape import file_names
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.content import ReportContent, parameter_rows
from elastid.report.figures.design import (
    configuration_sketches,
    excitation,
    information,
    limit_use,
    nearest_run_signals,
)
from elastid.report.figures.fit import forest, identifiability, modification_shares, multistart_costs
from elastid.report.figures.friction import friction_curves
from elastid.report.figures.modes import mode_shapes, mode_sketches
from elastid.report.figures.response_quality import coherence, levels
from elastid.report.figures.responses import configuration_title, frf_magnitude, frf_phase, singular_values
from elastid.report.figures.validation import (
    RUN_CAPTION,
    TORQUE_CAPTION,
    left_out_errors,
    model_errors,
    replay_signals,
    torque_balance_figure,
    twin_run_figure,
)
from elastid.report.modes import ModeRow
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.validation.twin_run import TORQUE, TwinRun

# Begins the section of a figure of one configuration.
CONFIGURATION = "configuration "


@dataclass(frozen=True)
class Drawing:
    """A figure to draw, with a file-safe name, the section of the page that it belongs to, and a caption.

    draw(): the figure; it pickles, so that figures can be drawn in several processes.  on_page: not where the page
    shows the same to explore or in a table, nor of every single configuration: these are files only.
    """

    name: str
    section: str
    caption: str
    draw: Callable[[], Figure]
    on_page: bool = True


def drawings(content: ReportContent) -> Iterator[Drawing]:
    """The figures of a report, to be drawn."""
    rows = parameter_rows(content.result, content.truth, content.contents)
    if rows:
        caption = "Start, estimate and 95 % interval of every parameter."
        yield Drawing("parameters", "parameters", caption, partial(forest, rows), on_page=False)
    judged = [np.concatenate([a.rms_log_db.ravel(), a.rms_sigma.ravel()]) for a in content.validation.configurations]
    if any(np.isfinite(values).any() for values in judged):
        caption = "Error of the model by configuration (down) and element (across); 1 sigma and less is noise."
        yield Drawing("errors", "validation", caption, partial(model_errors, content.validation), on_page=False)
    if content.twin.balances:
        worst = max(content.twin.balances, key=lambda balance: balance.left)
        caption = f"{worst.place}, {worst.log}: {TORQUE_CAPTION}"
        yield Drawing("torque", "torque", caption, partial(torque_balance_figure, worst), on_page=False)
    yield from twin_drawings(content.twin.runs)
    yield from friction_drawings(content.friction, content.robot)
    yield from (replace(drawing, on_page=False) for drawing in _configurations(content))
    if content.comparison is not None and content.comparison.rows[0].misfit.size:
        caption = "Error of every model on each configuration when it was left out of the fit."
        yield Drawing("comparison", "comparison", caption, partial(left_out_errors, content.comparison))
    if content.result.starts:
        caption = "Cost at which every start of the fit ended."
        differ = content.result.hits < len(content.result.starts)  # else a sentence of the page says it
        yield Drawing("multistart", "fit", caption, partial(multistart_costs, content.result), on_page=differ)
    if len(rows) > 1:
        caption = "Correlations near 1 or −1: the data determine only a combination of the two parameters."
        yield Drawing("identifiability", "fit", caption, partial(identifiability, content.result))
    if any(not index.place for index in content.result.indices):
        caption = "Share of what V has beyond the noise that each would explain, were it free or read so, alone."
        yield Drawing("modification_indices", "why", caption, partial(modification_shares, content.result))
    yield from _plan(content)
    yield from _limits(content)
    if content.plan is not None:
        caption = "Torque injected in the first experiment."
        yield Drawing("excitation", "excitation", caption, partial(excitation, content.plan), on_page=False)


def twin_drawings(runs: Iterable[TwinRun]) -> Iterator[Drawing]:
    """Of each run that was not lost, the motor whose torque is furthest off."""
    for i, run in enumerate(run for run in runs if run.signals):
        motor = max(run.of(TORQUE), key=lambda signal: signal.error).place
        caption = f"{run.log}, {motor}: {RUN_CAPTION}"
        yield Drawing(f"twin-{i + 1}", "twin", caption, partial(twin_run_figure, run, motor), on_page=False)


def friction_drawings(friction: FrictionTakenOut | None, robot: Robot | None = None) -> Iterator[Drawing]:
    """Of friction that was searched for in records, with that of the robot's file; none where it could not be."""
    if friction is not None and friction.configurations:
        caption = (
            "Friction over the distance from a reversal out of steady sliding, or over velocity where it depends on "
            "that alone (link side), with F_c of the robot's file where it has one; amplitude of the torque that no "
            "response explains, with friction and without."
        )
        yield Drawing("friction", "friction", caption, partial(friction_curves, friction, robot))


def _configurations(content: ReportContent) -> Iterator[Drawing]:
    """Responses, replay, modes and quality of the measurement, configuration by configuration."""
    modes = {row.configuration: row for row in content.modes if row.coordinates and len(row.frequency_hz)}
    replays = {replay.configuration: replay for replay in content.validation.replays}
    left_out = {agreement.configuration for agreement in content.validation.left_out}
    model_std = content.model_std or (None,) * len(content.frf)
    dense = content.dense or (None,) * len(content.frf)
    files = file_names([measured.configuration.name for measured, _ in content.frf], "frf")
    for file, (measured, modelled), std, model in zip(files, content.frf, model_std, dense, strict=True):
        name = measured.configuration.name
        title = configuration_title(measured, name in left_out)
        yield from response_drawings(file, measured, modelled, title, std, model)
        if name in replays:
            caption = (
                "the record with the worst fit, and the model under the measured torque; right: enlarged where the "
                "error is largest."
            )
            yield of_configuration(name, f"{file}-replay", caption, partial(replay_signals, replays[name]))
        if name in modes:
            yield _modes(file, modes[name], title, measured.rate_is_known)
        yield from quality_drawings(file, measured, title)


def response_drawings(
    file: str,
    measured: FrequencyResponse,
    modelled: FrequencyResponse | None,
    title: str,
    std: FloatArray | None = None,
    dense: tuple[FrequencyResponse, FloatArray] | None = None,
) -> Iterator[Drawing]:
    """Magnitude, phase and singular values; std: of the model; dense: model and std on lines of its own."""
    compared = "" if modelled is None else ", measured and modelled"
    shown = measured, modelled, title
    model = modelled if dense is None else dense[0]
    for kind, quantity, draw in (
        ("magnitude", "magnitude of the frequency responses", partial(frf_magnitude, *shown, std, dense)),
        ("phase", "phase of the frequency responses", partial(frf_phase, measured, model, title)),
        ("singular-values", "singular values of the response matrix", partial(singular_values, measured, model, title)),
    ):
        drawing = of_configuration(measured.configuration.name, f"{file}-{kind}", f"{quantity}{compared}.", draw)
        yield replace(drawing, on_page=False)


def of_configuration(configuration: str, name: str, caption: str, draw: Callable[[], Figure]) -> Drawing:
    """A figure of one configuration."""
    return Drawing(name, f"{CONFIGURATION}{configuration}", f"{configuration}: {caption}", draw)


def _modes(file: str, row: ModeRow, title: str, rate_is_known: bool) -> Drawing:
    """As sketches of the robot; as bars where it has no extent, or none of its points moves."""
    if row.drawing is None:
        caption = "shapes of the modes of the identified model, motors free."
        draw = partial(mode_shapes, row, title, rate_is_known)
    else:
        caption = (
            "the modes of the identified model, motors free. Grey: at rest; blue and orange: the two ends of the "
            "swing, enlarged to one size; motors, behind their gears, are not drawn."
        )
        draw = partial(mode_sketches, row, row.drawing, title, rate_is_known)
    return of_configuration(row.configuration, f"{file}-modes", caption, draw)


def quality_drawings(file: str, measured: FrequencyResponse, title: str) -> Iterator[Drawing]:
    """Levels and coherence of a measurement that has them."""
    name, quality = measured.configuration.name, measured.quality
    if quality is None:
        return
    caption = "levels of the outputs, of their nonlinear distortion and of noise."
    yield of_configuration(name, f"{file}-levels", caption, partial(levels, measured, quality, title))
    caption = "share of each output that no input explains; singular values of responses and inputs."
    yield of_configuration(name, f"{file}-coherence", caption, partial(coherence, measured, quality, title))


def _plan(content: ReportContent) -> Iterator[Drawing]:
    """Expected information and configurations."""
    if content.forecast is not None:
        caption = "Expected information: by configuration and frequency, and by configuration and parameter."
        yield Drawing("information", "plan", caption, partial(information, content.forecast))
    if content.robot is not None and content.plan is not None:
        configurations = content.plan.configurations
        angles = [", ".join(f"{a:.0f}°" for a in np.degrees(c.angles)) for c in configurations]
        counts = [f"{angle}; {M} realisations" for angle, M in zip(angles, content.plan.realisations, strict=True)]
        caption = "The robot in each configuration; driven joints' angles."
        draw = partial(configuration_sketches, content.robot, configurations, counts)
        yield Drawing("configurations", "plan", caption, draw, on_page=False)


def _limits(content: ReportContent) -> Iterator[Drawing]:
    """Use of the robot's limits by the plan."""
    if content.limit_use is None or not np.isfinite(content.limit_use.limit).any():
        return
    caption = "Largest value of any run in the rehearsal, in % of the motor's limit."
    yield Drawing("peaks", "plan", caption, partial(limit_use, content.limit_use))
    if content.nearest_run is not None:
        caption = (
            f"The run that comes closest to a limit, on the nominal robot (dashed: limit; "
            f"shaded: the {content.limit_use.margin:.0%} of it that are kept free; grey: not measured)."
        )
        draw = partial(nearest_run_signals, content.nearest_run, content.limit_use, content.plan)
        yield Drawing("limits", "plan", caption, draw, on_page=False)
