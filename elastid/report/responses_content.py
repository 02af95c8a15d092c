"""Content of the page of measured responses without a robot, and its three questions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.display import Questions, number, percent
from elastid.base.errors import NoteGroup, group_notes, notes_of
from elastid.base.statistics import QUANTILE_95
from elastid.report.modes import ModeRow, measured_modes_row
from elastid.response import Response

if TYPE_CHECKING:  # slow imports
    from elastid.modal.modes import Modes
    from elastid.modal.spec import GeometrySpec
    from elastid.nonlinear.compensated_friction import CompensatedFriction


def repairs_by_configuration(responses: Iterable[Response]) -> dict[str, dict[str, int]]:
    """Return the counts of repairs and findings in the records of each configuration that has some."""
    return {response.configuration.name: dict(response.repairs) for response in responses if response.repairs}


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
        return repairs_by_configuration(self.responses)

    @property
    def has_rate(self) -> bool:
        """True if frequencies are in Hz, and not relative to an unknown sampling rate."""
        return all(response.has_rate for response in self.responses)


MAX_MODES = 3  # configurations whose modes the first screen lists


def questions_of_responses(content: ResponsesContent) -> Questions:
    """Answer the three questions of the page of responses without a robot."""
    warnings = sum(note.first.severity == "warning" for note in content.notes)
    stds = [float(np.nanmedian(modes.relative_std)) for modes in content.modes if np.isfinite(modes.relative_std).any()]
    good = [f"Noise is {percent(max(stds))} of the response at a line." if stds else "The noise is unknown."]
    good += [f"Warnings below: {warnings}."] if warnings else []
    with_modes = [modes for modes in content.modes if modes.n_modes]
    modes = []
    for mode_set in with_modes[:MAX_MODES]:
        low, high = (number(float(mode_set.freq_hz[i]), 4) for i in (0, -1))
        count = f"{mode_set.n_modes} modes from {low} to" if mode_set.n_modes > 1 else "one mode at"
        modes.append(f"{mode_set.configuration}: {count} {high} {mode_set.frequency_unit}.")
    n_more = len(with_modes) - MAX_MODES
    modes += [f"{n_more} further configurations: below."] if n_more > 0 else []
    return (
        ("Are the responses good?", tuple(good)),
        ("Which modes are there?", tuple(modes) or ("No significant mode.",)),
        ("What next?", (_action_of_damping(with_modes),)),
    )


def _action_of_damping(rows: Sequence[Modes]) -> str:
    if not rows:
        return "Measure longer, or hit more often: a factor of four halves the noise."
    widths = [QUANTILE_95 * modes.zeta_std / modes.zeta for modes in rows]
    modes, width = max(zip(rows, widths, strict=True), key=lambda pair: float(pair[1].max()))
    index = int(width.argmax())
    return (
        f"The damping at {number(float(modes.freq_hz[index]), 4)} {modes.frequency_unit} has the widest interval, "
        f"±{percent(float(width[index]))}; a record four times as long, or four times the hits, halves it."
    )
