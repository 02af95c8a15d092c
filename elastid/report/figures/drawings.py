"""Catalogue of the figures of each kind of study, in reading order, with captions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.escape import file_name
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.report.content import ReportContent
from elastid.report.figures import fit, friction
from elastid.report.parameter_row import parameter_rows
from elastid.report.responses_content import ResponsesContent
from elastid.response import Response
from elastid.robot import Robot
from elastid.validation.log_comparison import NO_COMPARISON, LogComparison

if TYPE_CHECKING:
    from elastid.friction_study.friction_tracking import TrackedFriction
    from elastid.friction_study.result import FrictionResult, JointFriction

CONFIGURATION = "configuration "  # first word of the section of a figure of one configuration


@dataclass(frozen=True)
class Drawing:
    """Figure to be drawn later, with a file-safe name, its section of the page, and a caption.

    draw(): returns the figure; it pickles, so that several processes can draw.  on_page: False for a file only, if the
    page has the same content in a table or an interactive plot, or for figures of single configurations.
    """

    name: str
    section: str
    caption: str
    draw: Callable[[], Figure]
    on_page: bool = True


def drawings(content: ReportContent) -> Iterator[Drawing]:
    """Yield the figures of a report."""
    rows = parameter_rows(content.result, content.truth, content.contents)
    if rows:
        caption = "Start, estimate and 95 % interval of every parameter."
        yield Drawing("parameters", "parameters", caption, partial(fit.forest, rows), on_page=False)
    if content.log_comparison.balances:
        worst = max(content.log_comparison.balances, key=lambda balance: balance.unexplained_fraction)
        caption = f"{worst.place}, {worst.log}: {fit.TORQUE_CAPTION}"
        yield Drawing("torque", "torque", caption, partial(fit.torque_balance_figure, worst), on_page=False)
    yield from friction_drawings(content.friction, content.robot)
    if content.gears is not None and content.gears.sheets:
        caption = (
            "Torsion of each gear over one load cycle up to the largest torque of the records, with its 95 % band; "
            "straight line: stiffness at zero torque."
        )
        yield Drawing("gears", "gears", caption, partial(fit.hysteresis, content.gears, content.robot))
    yield from _configurations(content)
    if len(rows) > 1:
        caption = "Red: +1, blue: −1. Near ±1, the data determine only a combination of the two parameters."
        yield Drawing("identifiability", "fit", caption, partial(fit.identifiability, content.result))
    if content.forecast is not None:
        caption = (
            "Fraction of the expected Fisher information by fitted configuration and octave, in %, averaged over all "
            "parameters."
        )
        yield Drawing("information", "plan", caption, partial(fit.information, content.forecast))
    if content.limit_use is not None and np.isfinite(content.limit_use.limit).any():
        caption = "Largest peak in each configuration, in % of the limits of the motor."
        yield Drawing("peaks", "plan", caption, partial(fit.limit_use, content.limit_use))


def friction_drawings(compensated: CompensatedFriction | None, robot: Robot | None = None) -> Iterator[Drawing]:
    """Yield the figure of compensated friction, with F_c of the robot model."""
    if compensated is not None and compensated.configurations:
        caption = (
            "Compensated friction of each motor (link side), with its 95 % band. Its shape near zero velocity is "
            "selected by cross-validation. Dashed: F_c of the robot model, if stated. Lower panels: torque amplitude "
            "of noise and distortion, before and after compensation."
        )
        yield Drawing("friction", "friction", caption, partial(friction.compensation_figure, compensated, robot))


def _configurations(content: ReportContent) -> Iterator[Drawing]:
    for i, tool in enumerate(content.validation.predictions, start=1):
        caption = f"{tool.sentence}; band of two standard deviations of the prediction."
        yield Drawing(f"tool-{i}", "why", caption, partial(fit.bode, tool.measured, tool.predicted, tool.std))
    files = [f"frf-{file_name(measured.configuration.name)}" for measured, _ in content.frf]
    models = content.dense or [(modelled, None) for _, modelled in content.frf]
    for file, (measured, _), model in zip(files, content.frf, models, strict=True):
        yield response_drawing(file, measured, *model)


def response_drawing(
    file: str, measured: Response, modelled: Response | None, std: FloatArray | None = None
) -> Drawing:
    """Return the figure of magnitude and phase of a response and of a model on its own lines."""
    suffix = "" if modelled is None else ", measured and modelled"
    caption = f"magnitude and phase of the frequency responses{suffix}."
    draw = partial(fit.bode, measured, modelled, std)
    return configuration_drawing(measured.configuration.name, file, caption, draw, False)


def drawings_of_responses(content: ResponsesContent) -> Iterator[Drawing]:
    """Yield the figures of measured responses without a model."""
    yield from friction_drawings(content.friction)
    files = [f"frf-{file_name(response.configuration.name)}" for response in content.responses]
    for file, response, modes, model in zip(files, content.responses, content.modes, content.synthesised, strict=True):
        name, quality = response.configuration.name, response.quality
        title = fit.configuration_title(response, left_out=False)
        if len(modes.at_hz):
            caption = (
                "poles over the order of the estimator, and singular values of the response (mode indicator "
                "functions). Poles of noise change with the order; vertical lines mark the accepted modes."
            )
            draw = partial(fit.stabilisation_diagram, modes, title)
            yield configuration_drawing(name, f"{file}-stabilisation", caption, draw)
        yield response_drawing(file, response, model)
        if quality is not None:
            caption = (
                "spectra of the outputs, of their nonlinear distortion and of noise; unexplained fraction of each "
                "output; singular values of responses and inputs."
            )
            draw = partial(fit.quality_figure, response, quality, title)
            yield configuration_drawing(name, f"{file}-quality", caption, draw)


def configuration_drawing(
    configuration: str, name: str, caption: str, draw: Callable[[], Figure], on_page: bool = True
) -> Drawing:
    """Return a figure of one configuration."""
    return Drawing(name, f"{CONFIGURATION}{configuration}", f"{configuration}: {caption}", draw, on_page)


JOINT = "joint "  # first word of the section of a figure of one joint
NamedFigure: TypeAlias = tuple[str, str, Callable[[], Figure]]  # file-safe name, caption, and drawing function


def friction_study_drawings(
    result: FrictionResult,
    filters: Sequence[TrackedFriction] = (),
    log_comparison: LogComparison = NO_COMPARISON,
    left_out: LogComparison = NO_COMPARISON,
) -> Iterator[Drawing]:
    """Yield the figures of all joints and of validation logs."""
    if left_out.balances:
        caption = "unexplained torque of the validation logs, relative to the rms torque, in each octave."
        yield Drawing("left-out", "left-out", caption, partial(fit.octaves_figure, left_out.balances))
    for joint in result.joints:
        file = f"friction-{file_name(joint.joint)}"
        trackings = [tracked for tracked in filters if tracked.joint == joint.joint]
        balances = [balance for balance in log_comparison.balances if balance.place == f"{JOINT}{joint.joint}"]
        draws = [partial(fit.torque_balance_figure, balance) for balance in balances]
        torques: list[NamedFigure] = [("torque", fit.TORQUE_CAPTION, draw) for draw in draws]
        for name, caption, draw in (*_joint_figure(joint), *torques, *map(_filter_figure, trackings)):
            yield Drawing(f"{file}-{name}", f"{JOINT}{joint.joint}", f"Joint {joint.joint}: {caption}", draw)


def _joint_figure(joint: JointFriction) -> Iterator[NamedFigure]:
    if joint.static is not None:
        caption = (
            "friction over speed: torques of the constant-velocity runs and the friction model, with 95 % intervals. "
            "Shaded: measured speeds; dashed: extrapolation, not reliable. Below: residual of each run."
        )
        yield "curve", caption, partial(friction.friction_curve, joint.static)
    if joint.motion is not None:
        from elastid.report.figures import friction_records

        caption = "torque minus inertia and gravity torques, over velocity and over time."
        yield "motion", caption, partial(friction_records.friction_motion, joint.motion)


def _filter_figure(tracked: TrackedFriction) -> NamedFigure:
    from elastid.report.figures import friction_records

    joint = tracked.filtered
    errors = [f"{name.replace('_', ' ')} ({100 * joint.tolerances[name]:.2g} %)" for name in joint.consider_parameters]
    with_errors = f", which include the tolerances of {', '.join(errors)}" if errors else ""
    caption = (
        f"friction tracked by a Kalman filter, with 95 % bands{with_errors}. "
        "Below: normalised innovations squared (NIS), and their autocorrelation. "
        f"{tracked.verdict.capitalize()}."
    )
    return "filter", caption, partial(friction_records.friction_filter, tracked)
