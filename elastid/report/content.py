"""All that a report shows, as values; what comes from which stage is the caller's affair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, frozen
from elastid.experiment.design.forecast import Forecast
from elastid.experiment.limits import Peaks
from elastid.experiment.plan import Plan
from elastid.experiment.rehearsal import Rehearsal
from elastid.fit.result import FitResult
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.validation.comparison import Comparison
from elastid.validation.frequency import Validation

# Coordinates that the mode table names: those that move so much of the furthest one's way, and at most so many.
HALF, MOST = 0.5, 4


@dataclass(frozen=True)
class ModeRow:
    """Natural frequencies (n_m,) in Hz and damping ratios (n_m,) of the identified model in one configuration.

    frequency_std, damping_std (n_m,): what the parameters' uncertainty makes of them; empty where not known.
    coordinates (n,), shapes (n, n_m): what moves, the largest part of each mode 1; empty where not known.
    """

    configuration: str
    frequency_hz: FloatArray
    damping_ratio: FloatArray
    frequency_std: FloatArray = field(default_factory=lambda: np.empty(0))
    damping_std: FloatArray = field(default_factory=lambda: np.empty(0))
    coordinates: tuple[str, ...] = ()
    shapes: ComplexArray = field(default_factory=lambda: np.empty((0, 0), complex))

    def __post_init__(self) -> None:
        """Freeze the arrays and check shapes."""
        for name in ("frequency_hz", "damping_ratio", "frequency_std", "damping_std"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "shapes", frozen(self.shapes, np.complex128))
        n_m = len(self.frequency_hz)
        if self.coordinates and self.shapes.shape != (len(self.coordinates), n_m):
            raise ValueError(f"shapes are {self.shapes.shape}, of {len(self.coordinates)} coordinates in {n_m} modes")

    @property
    def modes(self) -> list[tuple[float, float, float, float, str]]:
        """Mode by mode: frequency, its standard deviation, damping ratio, its standard deviation, and what moves most.

        NaN where a standard deviation is not known.
        """
        unknown = [np.nan] * len(self.frequency_hz)
        columns = (self.frequency_hz, self.frequency_std, self.damping_ratio, self.damping_std)
        numbers = [list(column) if len(column) else unknown for column in columns]
        return list(zip(*numbers, self._movers, strict=True))

    @property
    def _movers(self) -> list[str]:
        """The coordinates that move at least half as far as the furthest, furthest first, with their direction."""
        if not self.coordinates:
            return [""] * len(self.frequency_hz)
        words = []
        for shape in self.shapes.T:
            order = [i for i in np.argsort(-np.abs(shape), kind="stable") if abs(shape[i]) >= HALF][:MOST]
            words.append(", ".join(f"{self.coordinates[i]} {shape[i].real:+.2f}" for i in order))
        return words


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
    peaks: Peaks | None = None
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
