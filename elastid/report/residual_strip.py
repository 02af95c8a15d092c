"""Table of the residuals of all FRF elements in all configurations: the coloured strip of the page's first screen."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.validation.frf_error import FrfError


@dataclass(frozen=True)
class Cell:
    """Residual of an FRF element in one configuration: over its standard deviation (NaN if unknown), or in dB."""

    configuration: int
    name: str
    value: float

    @property
    def severity(self) -> int:
        """Class of the value, 0 (noise or unknown) to 3."""
        return int(np.searchsorted((1.3, 2.0, 4.0), self.value)) if math.isfinite(self.value) else 0


@dataclass(frozen=True)
class Strip:
    """A row of cells per configuration, the quantity of the cells (measure), and the worst cell.

    kind: the first word of all inputs and outputs, for example motor.  outputs, inputs: the other words, as titles of
    the cells; empty if configurations differ.
    """

    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    measure: str
    worst: Cell | None
    kind: str = ""
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


def residual_strip(agreements: Sequence[FrfError]) -> Strip:
    """Return residual over noise of every element in every configuration; errors in dB if the noise is unknown."""
    has_noise = any(np.isfinite(agreement.rms_sigma).any() for agreement in agreements)
    rows = []
    for q, agreement in enumerate(agreements):
        values = agreement.rms_sigma if has_noise else agreement.rms_log_db
        names = [f"{source} → {output}" for output in agreement.outputs for source in agreement.inputs]
        cells = tuple(Cell(q, name, float(value)) for name, value in zip(names, values.flat, strict=True))
        rows.append((agreement.configuration, cells))
    every = [cell for _, cells in rows for cell in cells if math.isfinite(cell.value)]
    worst = max(every, key=lambda cell: cell.value, default=None)
    return Strip(tuple(rows), "residual / noise" if has_noise else "error, dB", worst, *_titles(agreements))


def _titles(agreements: Sequence[FrfError]) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Return `kind`, `outputs` and `inputs` of a `Strip`."""
    sides = {(tuple(agreement.outputs), tuple(agreement.inputs)) for agreement in agreements}
    if len(sides) != 1:
        return "", (), ()
    ((outputs, inputs),) = sides
    places = [name.partition(" ") for name in (*outputs, *inputs)]
    kinds = {kind if space else "" for kind, space, _ in places}
    if len(kinds) != 1 or "" in kinds:
        return "", outputs, inputs
    titles, n = tuple(title for _, _, title in places), len(outputs)
    return kinds.pop(), titles[:n], titles[n:]
