"""The table of friction that was taken out of the responses, a row each motor."""

from __future__ import annotations

from dataclasses import dataclass

from elastid.frf.friction.result import FrictionTakenOut

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
