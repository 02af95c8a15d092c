"""Which figures a report has, in the order in which they are read. Pure matplotlib: values in, Figure out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from elastid.report.content import ReportContent
from elastid.report.figures.design import information, postures
from elastid.report.figures.fit import identifiability, multistart
from elastid.report.figures.limits import excitation, peaks_against_limits, time_signals
from elastid.report.figures.mode_shapes import mode_shapes
from elastid.report.figures.mode_sketches import mode_sketches
from elastid.report.figures.parameters import forest
from elastid.report.figures.response_quality import coherence, levels
from elastid.report.figures.responses import configuration_title, frf_magnitude, frf_phase
from elastid.report.figures.singular_values import singular_values
from elastid.report.figures.validation import errors, left_out_errors, replay_title, replayed
from elastid.report.modes.mode_row import ModeRow
from elastid.report.parameter_rows import parameter_rows
from elastid.response import FrequencyResponse

# Begins the section of a figure of one configuration.
CONFIGURATION = "configuration "


@dataclass(frozen=True)
class Drawing:
    """A figure with a file-safe name, the section of the page that it belongs to, and a caption."""

    name: str
    section: str
    caption: str
    figure: Figure


def drawings(content: ReportContent) -> Iterator[Drawing]:
    """The figures of a report, drawn one by one so that only one is in memory."""
    rows = parameter_rows(content.result, content.truth)
    if rows:
        yield Drawing("parameters", "parameters", "Start, estimate and 95 % interval of every parameter.", forest(rows))
    judged = [np.concatenate([a.rms_log_db.ravel(), a.rms_sigma.ravel()]) for a in content.validation.configurations]
    if any(np.isfinite(values).any() for values in judged):
        caption = "How far the model is off, by configuration (down) and element (across); 1 sigma and less is noise."
        yield Drawing("errors", "validation", caption, errors(content.validation))
    modes = {row.configuration: row for row in content.modes if row.coordinates and len(row.frequency_hz)}
    replays = {replay.configuration: replay for replay in content.validation.replays}
    model_std = content.model_std or (None,) * len(content.frf)
    for name, (measured, modelled), std in zip(_file_names(content), content.frf, model_std, strict=True):
        configuration = measured.configuration.name
        title = configuration_title(measured, configuration in {a.configuration for a in content.validation.left_out})
        yield Drawing(
            f"{name}-magnitude",
            f"{CONFIGURATION}{configuration}",
            f"{configuration}: magnitude of the frequency responses, measured and modelled.",
            frf_magnitude(measured, modelled, title, std),
        )
        yield Drawing(
            f"{name}-phase",
            f"{CONFIGURATION}{configuration}",
            f"{configuration}: phase of the frequency responses, measured and modelled.",
            frf_phase(measured, modelled, title),
        )
        yield Drawing(
            f"{name}-singular-values",
            f"{CONFIGURATION}{configuration}",
            f"{configuration}: singular values of the response matrix, measured and modelled.",
            singular_values(measured, modelled, title),
        )
        if configuration in replays:
            yield Drawing(
                f"{name}-replay",
                f"{CONFIGURATION}{configuration}",
                f"{configuration}: the record that fits worst, and the model under the torque that was measured; "
                "right: where they are furthest apart.",
                replayed(replays[configuration], replay_title(replays[configuration])),
            )
        if configuration in modes:
            yield _modes(name, modes[configuration], title, measured.rate_is_known)
        yield from _quality(name, measured, title)
    if content.comparison is not None and content.comparison.rows[0].misfit.size:
        yield Drawing(
            "comparison",
            "comparison",
            "Error of every model on each configuration when it was left out of the fit.",
            left_out_errors(content.comparison),
        )
    if content.result.starts:
        yield Drawing("multistart", "fit", "Cost at which every start of the fit ended.", multistart(content.result))
    if len(rows) > 1:
        yield Drawing(
            "identifiability",
            "fit",
            "Correlations near 1 or −1 mean that the data tell only a combination of two parameters.",
            identifiability(content.result),
        )
    yield from _plan(content)
    yield from _limits(content)
    if content.plan is not None:
        yield Drawing("excitation", "excitation", "Torque injected in the first experiment.", excitation(content.plan))


def _modes(name: str, row: ModeRow, title: str, rate_is_known: bool) -> Drawing:
    """As sketches of the robot; as bars where it has no extent, or nothing of it is seen to move."""
    section = f"{CONFIGURATION}{row.configuration}"
    if row.drawing is None:
        caption = f"{row.configuration}: who moves in each mode of the identified model, motors free."
        return Drawing(f"{name}-modes", section, caption, mode_shapes(row, title, rate_is_known))
    caption = (
        f"{row.configuration}: the modes of the identified model, motors free. Grey: at rest; blue and orange: the two "
        "ends of the swing, enlarged to one size; motors, behind their gears, are not drawn."
    )
    return Drawing(f"{name}-modes", section, caption, mode_sketches(row, row.drawing, title, rate_is_known))


def _quality(name: str, measured: FrequencyResponse, title: str) -> Iterator[Drawing]:
    if measured.quality is None:
        return
    configuration, quality = measured.configuration.name, measured.quality
    yield Drawing(
        f"{name}-levels",
        f"{CONFIGURATION}{configuration}",
        f"{configuration}: the outputs, what nonlinearity adds to them, and noise.",
        levels(measured, quality, title),
    )
    yield Drawing(
        f"{name}-coherence",
        f"{CONFIGURATION}{configuration}",
        f"{configuration}: what part of each output no input explains; singular values of responses and inputs.",
        coherence(measured, quality, title),
    )


def _plan(content: ReportContent) -> Iterator[Drawing]:
    """What was expected before the robot moved, and where it stood."""
    if content.forecast is not None:
        caption = "Expected information: by configuration and frequency, and by configuration and parameter."
        yield Drawing("information", "plan", caption, information(content.forecast))
    if content.robot is not None and content.plan is not None:
        configurations = content.plan.configurations
        angles = [", ".join(f"{a:.0f}°" for a in np.degrees(c.angles)) for c in configurations]
        counts = [f"{angle}; {M} realisations" for angle, M in zip(angles, content.plan.realisations, strict=True)]
        caption = "The robot in each configuration; driven joints' angles."
        yield Drawing("configurations", "plan", caption, postures(content.robot, configurations, counts))


def _limits(content: ReportContent) -> Iterator[Drawing]:
    """How much of the robot's limits the plan uses."""
    if content.peaks is None or not np.isfinite(content.peaks.limit).any():
        return
    caption = "Largest value of any run in the rehearsal, in % of the motor's limit."
    yield Drawing("peaks", "plan", caption, peaks_against_limits(content.peaks))
    if content.nearest is not None:
        caption = (
            f"The run that comes closest to a limit, on the nominal robot (dashed: limit; "
            f"shaded: the {content.peaks.margin:.0%} of it that are kept free; grey: not measured)."
        )
        yield Drawing("limits", "plan", caption, time_signals(content.nearest, content.peaks, content.plan))


def _file_names(content: ReportContent) -> list[str]:
    """frf-<configuration> of letters, digits, dots and dashes; numbered where two would be the same file."""
    names: list[str] = []
    for measured, _ in content.frf:
        name = "frf-" + re.sub(r"[^A-Za-z0-9._-]+", "-", measured.configuration.name)
        if name.lower() in (other.lower() for other in names):
            name = f"{name}-{len(names) + 1}"
        names.append(name)
    return names
