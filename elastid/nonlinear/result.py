"""FrictionTakenOut: friction at the motors, found in the records of a measurement and taken out of its responses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.nonlinear.motion import Motion
from elastid.nonlinear.shapes import Shape, motion_under
from elastid.record import Record


@frozen_value
class FrictionTakenOut:
    """Levels f_i of shapes of friction, torque = -sum f_i phi_i, that were taken out of the records' torque.

    places (n_m,): the motors that were looked at, `motor 1`.  place_units (n_m,): N*m, or N where a motor slides.
    shapes (n_f,): each with its motor; of a motor without shapes nothing was taken out.  levels (n_f,): in Nm (N), link
    side.  covariance (n_f, n_f): of the levels by noise, by what no shape has and by their difference between
    configurations; standard deviations are those of a normal distribution.
    configurations (C,).  before, after (C, n_m): amplitude of the torque that no response explains (Nm) at a line, the
    median of the lines, with friction in it and without: nonlinear distortion and noise.  kept_share (n_m,): share
    of its power that is left in realisations that the levels were not fitted to, 1 where nothing was taken out.
    accelerance (n_m,): acceleration per torque a of a motor as an inertia, 1 / (kg m^2) (1 / kg), 0 where unknown.
    highest_hz (C,): the highest excited line, above which a motor moves so.
    notes: what was taken out of which motor, or why nothing was.
    """

    places: tuple[str, ...]
    place_units: tuple[str, ...]
    shapes: tuple[Shape, ...]
    levels: FloatArray = labelled("level of each shape, link side", "N*m", "shape")
    covariance: FloatArray = labelled("covariance of the levels", "", "shape shape")
    configurations: tuple[str, ...]
    before: FloatArray = labelled("torque that no response explains, median line", "N*m", "configurations places")
    after: FloatArray = labelled("the same with friction taken out", "N*m", "configurations places")
    kept_share: FloatArray = labelled("share of its power left in other realisations", "", "places")
    accelerance: FloatArray = labelled("acceleration per torque as an inertia", "", "places")
    highest_hz: FloatArray = labelled("highest excited line", "Hz", "configurations")
    notes: tuple[Note, ...] = field(default=())

    def __post_init__(self) -> None:
        """Check the shapes."""
        n_m, n_f, C = len(self.places), len(self.shapes), len(self.configurations)
        expected: dict[str, tuple[int, ...]] = {"levels": (n_f,), "covariance": (n_f, n_f)}
        expected |= {"before": (C, n_m), "after": (C, n_m), "highest_hz": (C,)}
        of_motors = ("kept_share", "accelerance")
        for name, shape in (expected | dict.fromkeys(of_motors, (n_m,))).items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"friction: {name} has shape {getattr(self, name).shape}, expected {shape}")

    @property
    def std(self) -> FloatArray:
        """Standard deviation (n_f,) of the levels."""
        return np.sqrt(np.diag(self.covariance))

    def taken_shapes(self, place: str) -> tuple[tuple[Shape, float], ...]:
        """The shapes that were taken out of a motor's torque, each with its level."""
        pairs = zip(self.shapes, self.levels.tolist(), strict=True)
        return tuple((shape, level) for shape, level in pairs if shape.place == place and level > 0)

    def taken_places(self) -> tuple[str, ...]:
        """The motors that friction was taken out of."""
        return tuple(place for place in self.places if any(shape.place == place for shape in self.shapes))

    def sliding_level(self, place: str) -> tuple[float, float]:
        """F_c in Nm (N) of fast steady sliding at a motor, the sum of its levels, and its standard deviation."""
        row = np.array([shape.when_fast * (shape.place == place) for shape in self.shapes])
        return float(row @ self.levels), math.sqrt(max(float(row @ self.covariance @ row), 0.0))

    def reversal(self, place: str, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque (n,) after a reversal out of fast sliding, at `distance` (n,) from it, and its standard deviation.

        From -F_c at distance 0 to F_c where all bristles slide again; link side, rad and Nm (m and N).
        """
        return self._curve(place, [shape.reversal(distance) for shape in self.shapes])

    def sliding(self, place: str, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque (n,) in steady sliding at `velocity` (n,), and its standard deviation; link side, rad/s and Nm."""
        return self._curve(place, [shape.sliding(velocity) for shape in self.shapes])

    def motion(self, record: Record, place: str) -> Motion:
        """The motion of a motor under its friction."""
        a = float(self.accelerance[self.places.index(place)])
        return motion_under(record, place, self.taken_shapes(place), a, float(self.highest_hz.max()))

    def _curve(self, place: str, values: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        of_place = np.array([shape.place == place for shape in self.shapes])
        rows = np.stack(values, axis=1) * of_place
        return rows @ self.levels, np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", rows, self.covariance, rows), 0.0))


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
        interval = (max(level - QUANTILE_95 * std, 0.0), level + QUANTILE_95 * std)
        rows.append(FrictionRow(place, unit, kept, level, std, interval))
    return tuple(rows)
