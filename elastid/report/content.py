"""Contents of the report page: results of all stages, rows of parameters and gear effects, curves of the model."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import digits, format_interval, number, percent, relative_std
from elastid.base.errors import Note, NoteGroup, group_notes, notes_of
from elastid.fit.result import Result
from elastid.report.modes import ModeRow, measured_modes_row
from elastid.response import Response
from elastid.robot import Robot
from elastid.validation.log_comparison import NO_COMPARISON, LogComparison

if TYPE_CHECKING:  # slow imports
    from elastid.design.forecast import Forecast
    from elastid.design.limit_use import LimitUse
    from elastid.experiment.plan.plan import Plan
    from elastid.fit.fitted_robot import FittedRobot
    from elastid.modal.modes import Modes
    from elastid.modal.spec import GeometrySpec
    from elastid.nonlinear.compensated_friction import CompensatedFriction
    from elastid.nonlinear.gear_result import GearNumber, GearResult, GearSheet
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
    def repairs(self) -> dict[str, dict[str, int]]:
        """Counts of repairs and findings in the records, by configuration."""
        return _repairs(measured for measured, _ in self.frf)

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


@dataclass(frozen=True)
class ResponsesContent:
    """Content of the page of measured responses without a robot: responses, modes, friction and provenance."""

    title: str
    responses: tuple[Response, ...]
    modes: tuple[Modes, ...]
    study_text: str
    provenance: Mapping[str, str]
    friction: CompensatedFriction | None = None
    geometry: GeometrySpec | None = None

    @property
    def notes(self) -> tuple[NoteGroup, ...]:
        """Notes of modes and responses; equal notes are grouped."""
        return group_notes((*notes_of(self.modes), *notes_of(self.responses)))

    @property
    def mode_rows(self) -> tuple[ModeRow, ...]:
        """Modes of each response with their shapes, with a drawing if the geometry has their outputs."""
        return tuple(measured_modes_row(modes, self.geometry) for modes in self.modes)

    @property
    def synthesised(self) -> tuple[Response | None, ...]:
        """Modal model of each response; None if it covers only some lines."""
        return tuple(
            replace(response, G=modes.synthesis, notes=(), quality=None, noise=None, total=None)
            if modes.n_modes and len(modes.at_hz) == response.n_lines
            else None
            for response, modes in zip(self.responses, self.modes, strict=True)
        )

    @property
    def repairs(self) -> dict[str, dict[str, int]]:
        """Counts of repairs and findings in the records, by configuration."""
        return _repairs(self.responses)

    @property
    def has_rate(self) -> bool:
        """True if frequencies are in Hz, and not relative to an unknown sampling rate."""
        return all(response.has_rate for response in self.responses)


def _repairs(responses: Iterable[Response]) -> dict[str, dict[str, int]]:
    return {response.configuration.name: dict(response.repairs) for response in responses if response.repairs}


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


# Content of a viscous coefficient: the best linear approximation of sgn(v) is 2 p_v(0) v, p_v the density of v.
WITH_COULOMB = "viscous friction. Coulomb friction of the motor, if any, was not compensated and increases the estimate"


@dataclass(frozen=True)
class ParameterRow:
    """Free parameter in SI: estimate, std, 95 % interval, start, bounds, and true value of a simulated rig.

    deviation: (estimate - truth) / std of the solver's variable, which may be logarithmic.  contains: text on the
    friction in a viscous coefficient.  std_contributions: empty for an exact robot model.  verdict: of the fit.  base:
    effect of a typical base.
    """

    name: str
    unit: str
    estimate: float
    std: float
    interval: tuple[float, float]
    start: float
    bounds: tuple[float, float]
    at_bound: bool
    truth: float | None = None
    deviation: float | None = None
    contains: str = ""
    std_contributions: Mapping[str, float] = field(default_factory=dict)
    verdict: str = ""
    base: str = ""

    @property
    def has_coulomb(self) -> bool:
        """True for viscous friction that may include Coulomb friction."""
        return self.contains.startswith(WITH_COULOMB)

    @property
    def reference(self) -> float:
        """Reference value: the first nonzero of true value, estimate and start."""
        candidates = (self.truth, self.estimate, self.start)
        return next((value for value in candidates if value is not None and value != 0), 1.0)


def parameter_rows(
    result: Result, truth: Mapping[str, float] | None, contents: Mapping[str, str] | None = None
) -> tuple[ParameterRow, ...]:
    """Return a row per parameter of interest, in the order of x; `truth` and `contents` may be incomplete."""
    truths, estimates, stds = truth or {}, result.values, result.std
    std_x, bases = result.std_of_x, result.base_remarks
    rows = []
    verdicts = result.verdicts or ("",) * len(result.parameters.of_interest)
    for i, parameter in enumerate(result.parameters.of_interest):
        name = parameter.name
        true = truths.get(name, truths.get(parameter.stands_for))
        deviation = None
        if true is not None and std_x[i] > 0:
            deviation = float((result.x[i] - parameter.to_x(true)) / std_x[i])
        numbers = name, parameter.unit, estimates[name], stds[name], result.interval(name)
        start, at_bound = (parameter.value, (parameter.lower, parameter.upper)), bool(result.at_bound[i])
        content = (contents or {}).get(name, "")
        contributions = {kind: stds_by_name[name] for kind, stds_by_name in result.std_contributions.items()}
        base = "" if truths else bases.get(name, "")  # the base of a simulated robot is rigid
        rows.append(
            ParameterRow(*numbers, *start, at_bound, true, deviation, content, contributions, verdicts[i], base)
        )
    return tuple(rows)


def gear_table(gears: GearResult, numbers: Sequence[GearNumber] | None = None) -> list[list[str]]:
    """Return headings and a row for each number of all gears, or for the given numbers, in makers' units.

    Columns: interval or upper bound, fraction of the rated torque of the joint, and value of the linear fit.
    """
    has_rated = any(math.isfinite(row.rated_fraction) for row in gears.numbers)
    headings = ["parameter", "meaning", "unit", "estimate", "std", "95 % interval"]
    table = [[*headings, *["of rated torque"] * has_rated, "linear fit"]]
    for row in gears.numbers if numbers is None else numbers:
        fraction = f"{number(100 * row.rated_fraction, 2)} %" if math.isfinite(row.rated_fraction) else "–"
        linear = number(row.linear * row.factor, digits(row.value, row.std)) if math.isfinite(row.linear) else "–"
        table.append([*_number_cells(row), *[fraction] * has_rated, linear])
    return table


def _number_cells(row: GearNumber) -> list[str]:
    unit, factor = row.maker_unit or row.unit, row.factor
    if not row.is_significant:
        return [row.name, row.meaning, unit, f"< {number(factor * row.bound, 2)}", "–", "not significant"]
    value, std = factor * row.value, factor * row.std
    meaning = f"{row.meaning}, phase {math.degrees(row.phase):.0f} deg" if row.order else row.meaning
    n, (low, high) = digits(value, std), row.interval
    ends = " to ".join(format_interval((factor * low, factor * high), n))
    return [row.name, meaning, unit, number(value, n), relative_std(value, std), ends]


def gear_sentence(sheet: GearSheet) -> str:
    """Summarise the stiffness and the significant effects of a gear."""
    texts = []
    for row in sheet.numbers:
        if row.is_significant and row.name[0] in "kHeFr" and not row.name.startswith("H_"):
            unit, std = row.maker_unit or row.unit, row.factor * row.std
            value = row.factor * row.value
            texts.append(f"{row.meaning.partition(',')[0]} {number(value, digits(value, std))} {unit}")
    return "; ".join(texts)


def gear_line(gears: GearResult) -> str:
    """Summarise the gear effects in a sentence, or the reason for their absence."""
    if gears.refused:
        return f"effects not estimated: {gears.refused}"
    nonlinear = [row.name for row in gears.numbers if row.is_significant and not math.isfinite(row.linear)]
    if not nonlinear:
        return "no effect besides stiffness and damping is significant; upper bounds are in gears.h5"
    fraction = f"unexplained position signal {percent(gears.after)} (linear fit {percent(gears.before)})"
    return f"significant effects: {', '.join(nonlinear)} (upper bounds for the others); {fraction}"
