"""The tables of friction: what was taken out of the responses, a row each motor, and the numbers of a law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from elastid.base.numbers import digits, interval_of, number
from elastid.nonlinear.result import FrictionTakenOut

if TYPE_CHECKING:
    from elastid.friction_study.result import FrictionNumber

# Quantile of 95 % intervals.
_Z_95 = 1.96


@dataclass(frozen=True)
class FrictionRow:
    """Sliding friction F_c of a motor in Nm (N), link side, with std and 95 % interval; None where none was taken out.

    kept_share: of the power of the unexplained torque that is left in realisations which the levels were not fitted to.
    """

    place: str
    unit: str
    kept_share: float
    level: float | None = None
    std: float | None = None
    interval: tuple[float, float] | None = None


def friction_rows(friction: FrictionTakenOut) -> tuple[FrictionRow, ...]:
    """One row for each motor that was looked at, in their order."""
    rows, taken = [], friction.taken_places()
    for place, unit, kept in zip(friction.places, friction.place_units, friction.kept_share.tolist(), strict=True):
        if place not in taken:
            rows.append(FrictionRow(place, unit, kept))
            continue
        level, std = friction.sliding_level(place)
        interval = (max(level - _Z_95 * std, 0.0), level + _Z_95 * std)
        rows.append(FrictionRow(place, unit, kept, level, std, interval))
    return tuple(rows)


# Of the table of an identified friction law, as `number_cells` fills it.
NUMBER_HEADINGS = ("number", "symbol", "value", "std", "95 % interval", "unit", "learnt from")


def number_cells(each: FrictionNumber) -> tuple[str, ...]:
    """One identified number as texts under NUMBER_HEADINGS."""
    places = digits(each.value, each.std)
    interval = " … ".join(interval_of((each.low, each.high), places))
    value, std = number(each.value, places), number(each.std, 2)
    return each.name, each.symbol, value, std, interval, each.unit, each.learnt_from
