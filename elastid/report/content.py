"""All that a report shows, as values; what comes from which stage is the caller's affair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from elastid.base.arrays import FloatArray
from elastid.design.forecast import Forecast
from elastid.design.limits import LimitUse
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.fit.result import FitResult
from elastid.report.modes.mode_row import ModeRow
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.validation.agreement import Validation
from elastid.validation.compare import Comparison


@dataclass(frozen=True)
class ReportContent:
    """One identification: what was found, how far it can be trusted, and what it came from.

    verdict: one sentence.  frf: measured and modelled response of each configuration, left-out ones too.
    truth: parameter names to SI values where the rig is simulated.  plan: None where the excitation was not planned
    here.  forecast: what that plan was expected to tell.  robot: drawn in the plan's configurations.  peaks: of its
    rehearsal; nearest: the run that came closest to a limit.  comparison: of models.  model_std: for each of frf the
    standard deviation (F, n_y, n_u) of the model, by what is not known of its parameters.  provenance: name to text
    (version, seed, ...), shown as it is, so without a date the page is reproducible.
    """

    title: str
    verdict: str
    warnings: tuple[str, ...]
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
    peaks: LimitUse | None = None
    nearest: Rehearsal | None = None
    comparison: Comparison | None = None
    model_std: tuple[FloatArray, ...] = ()

    @property
    def repairs(self) -> dict[str, dict[str, int]]:
        """Configuration to what was mended or noticed in its records, and how often; those with anything."""
        return {measured.configuration.name: dict(measured.repairs) for measured, _ in self.frf if measured.repairs}

    @property
    def all_warnings(self) -> tuple[str, ...]:
        """The warnings given, those of the fit and the notes of the measured responses, each once."""
        notes = (note for measured, _ in self.frf for note in measured.notes)
        return tuple(dict.fromkeys((*self.warnings, *self.result.warnings, *notes)))
