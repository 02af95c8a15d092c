"""Contents of the report page: results of all stages, rows of parameters and gear effects, curves of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import number
from elastid.base.errors import Note, NoteGroup, group_notes, notes_of
from elastid.fit.result import Result
from elastid.report.modes import ModeRow
from elastid.report.responses_content import repairs_by_configuration
from elastid.response import Response
from elastid.robot import Robot
from elastid.validation.log_comparison import NO_COMPARISON, LogComparison

if TYPE_CHECKING:  # slow imports
    from elastid.design.forecast import Forecast
    from elastid.design.limit_use import LimitUse
    from elastid.experiment.plan.plan import Plan
    from elastid.fit.fitted_robot import FittedRobot
    from elastid.nonlinear.compensated_friction import CompensatedFriction
    from elastid.nonlinear.gear_result import GearResult
    from elastid.validation.comparison import Comparison
    from elastid.validation.frf_error import FrfError, Validation
    from elastid.validation.measured_modes import MeasuredModes


# Types of the values for figures in fit.h5.
MODES, DENSE = tuple[ModeRow, ...], tuple[tuple[Response, FloatArray], ...]


@dataclass(frozen=True)
class ReportContent:
    """Content of the page of an identification: result, validation, and provenance.

    verdict: one sentence.  frf: measured and modelled response of each configuration, including validation
    configurations.  truth: true values by parameter (SI) of a simulated rig.  plan, forecast, limit_use: None without a
    planned excitation.  friction: compensated in the responses.  contents: texts on viscous coefficients.
    log_comparison: torque balances, and simulation along a record.  gears: None without the stage.  dense: for each
    response in frf, the model on a denser grid with its standard deviation (L, n_y, n_u).  provenance: text by name,
    without a date, so that the page is reproducible.
    """

    title: str
    verdict: str
    result: Result
    frf: tuple[tuple[Response, Response], ...]
    validation: Validation
    modes: tuple[ModeRow, ...]
    study_text: str
    provenance: Mapping[str, str]
    truth: Mapping[str, float] | None = None
    plan: Plan | None = None
    forecast: Forecast | None = None
    robot: Robot | None = None
    limit_use: LimitUse | None = None
    comparison: Comparison | None = None
    dense: tuple[tuple[Response, FloatArray], ...] = ()
    friction: CompensatedFriction | None = None
    contents: Mapping[str, str] | None = None
    log_comparison: LogComparison = NO_COMPARISON
    gears: GearResult | None = None
    measured_modes: tuple[MeasuredModes, ...] = ()

    @property
    def agreements(self) -> tuple[FrfError, ...]:
        """Errors of the linear model by configuration; none if effects of the gears explain its misfit."""
        return () if self.gears is not None and self.gears.explains_misfit else tuple(self.validation.configurations)

    @property
    def summary(self) -> str:
        """Number of configurations and experiments, and the robot's time."""
        n = len(self.frf)
        phrases = [f"{n} configuration{'s' if n != 1 else ''}"]
        if self.plan is not None:
            records = sum(self.plan.realisations) * len(self.plan.inputs)
            phrases += [f"{records} records", f"{number(self.plan.robot_time_s, 3)} s of robot time"]
        return " · ".join(phrases)

    @property
    def repairs(self) -> dict[str, dict[str, int]]:
        """Counts of repairs and findings in the records, by configuration."""
        return repairs_by_configuration(measured for measured, _ in self.frf)

    @property
    def notes(self) -> tuple[NoteGroup, ...]:
        """Notes of the fit, on missing modes, and of the measured responses; equal notes are grouped."""
        notes = tuple(note for measured, _ in self.frf for note in measured.notes)
        notes = notes if self.gears is None else self.gears.unanswered_notes(notes)
        return group_notes((*self.result.shown_notes, *self.missing_modes, *notes))

    @property
    def missing_modes(self) -> tuple[Note, ...]:
        """Notes on missing modes of the model; empty if one cause explains the residuals and the modes."""
        return () if self.result.has_single_cause else notes_of(self.measured_modes)


N_OVERALL = 200  # lines over the whole band
N_RESONANCE, HALF_WIDTHS = 17, 4.0  # lines near each resonance, within so many half-widths (damping ratio times f)
MAX_VALUES = 330_000  # of all elements and configurations: 20 configurations of six axes give a page below 10 MB


def model_lines(
    freq_hz: FloatArray, resonances_hz: Sequence[float], zeta: Sequence[float], max_lines: int = MAX_VALUES
) -> FloatArray:
    """Return increasing frequencies: the measured lines freq_hz (F,), further lines, and more near each resonance.

    If there are more than `max_lines`, lines that were not measured are omitted evenly.
    """
    low, high = float(freq_hz[0]), float(freq_hz[-1])
    resonances = [
        f * (1 + max(ratio, 1e-4) * np.linspace(-HALF_WIDTHS, HALF_WIDTHS, N_RESONANCE))
        for f, ratio in zip(resonances_hz, zeta, strict=True)
    ]
    between = np.geomspace(low, high, N_OVERALL) if low > 0 else np.linspace(low, high, N_OVERALL)
    all_hz = np.unique(np.concatenate([between, *resonances]))
    further = np.setdiff1d(all_hz[(all_hz > low) & (all_hz < high)], freq_hz)
    n_free = min(max(max_lines - len(freq_hz), 0), len(further))
    return np.union1d(freq_hz, further[np.linspace(0, len(further) - 1, n_free).astype(int)])


def dense_models(fitted: FittedRobot) -> tuple[tuple[Response, FloatArray], ...]:
    """Evaluate the model of each measured configuration on `model_lines`, with standard deviations (L, n_y, n_u)."""
    models = []
    max_lines = MAX_VALUES // max(sum(G.G[0].size for G in fitted.measured), 1)
    for model, measured in zip(fitted.models, fitted.measured, strict=True):
        mode = model.modes()
        lines = model_lines(measured.freq_hz, mode.freq_hz.tolist(), mode.zeta.tolist(), max_lines)
        response = replace(model.response(lines, sampled=True), has_rate=measured.has_rate)
        models.append((response, model.response_std(lines)))
    return tuple(models)
