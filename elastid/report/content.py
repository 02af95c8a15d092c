"""The content of a report as one value, independent of the stages that it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from elastid.base.arrays import FloatArray
from elastid.base.note import NoteGroup, grouped
from elastid.design.forecast import Forecast
from elastid.design.limit_use import LimitUse
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.fit.result import FitResult
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.modes.mode_row import ModeRow
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.validation.comparison import Comparison
from elastid.validation.results import Validation
from elastid.validation.twin_run import NO_TWIN, TwinFindings


@dataclass(frozen=True)
class ReportContent:
    """One identification: its result, the evidence for it, and its provenance.

    verdict: one sentence.  frf: measured and modelled response of each configuration, left-out ones too.
    truth: parameter names to SI values where the rig is simulated.  plan: None where the excitation was not planned
    here; forecast, limit_use and nearest_run (to a limit) belong to it, and robot is drawn in its configurations.
    friction: what was taken out of the responses.  contents: of viscous coefficients, what they contain in words.
    twin: the motors' torque part by part, and the model simulated along a record.
    model_std: for each of frf the standard deviation (F, n_y, n_u) of the model, due to that of its parameters.
    dense: for each of frf the model on lines of its own, among them the measured ones, and that standard deviation.
    provenance: name to text (version, seed, ...), shown as it is; without a date in it the page is reproducible.
    """

    title: str
    verdict: str
    result: FitResult
    frf: tuple[tuple[FrequencyResponse, FrequencyResponse], ...]
    validation: Validation
    modes: tuple[ModeRow, ...]
    study_text: str
    provenance: Mapping[str, str]
    truth: Mapping[str, float] | None = None
    plan: Plan | None = None
    forecast: Forecast | None = None
    robot: Robot | None = None
    limit_use: LimitUse | None = None
    nearest_run: Rehearsal | None = None
    comparison: Comparison | None = None
    model_std: tuple[FloatArray, ...] = ()
    dense: tuple[tuple[FrequencyResponse, FloatArray], ...] = ()
    friction: FrictionTakenOut | None = None
    contents: Mapping[str, str] | None = None
    twin: TwinFindings = NO_TWIN

    @property
    def repairs(self) -> dict[str, dict[str, int]]:
        """Configuration to repairs of its records and findings in them, with their counts; those that have any."""
        return {measured.configuration.name: dict(measured.repairs) for measured, _ in self.frf if measured.repairs}

    @property
    def notes(self) -> tuple[NoteGroup, ...]:
        """Those of the fit, then those of the measured responses; the same from many places once, with a count."""
        notes = (note for measured, _ in self.frf for note in measured.notes)
        return grouped((*self.result.notes, *notes))
