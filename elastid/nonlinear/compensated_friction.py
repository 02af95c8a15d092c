"""CompensatedFriction: the friction torques that are subtracted from the records of a measurement."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.nonlinear.friction_basis import BasisFunction, motion_with_friction
from elastid.nonlinear.motion import Motion
from elastid.record import Record


@frozen_value
class CompensatedFriction:
    """Coefficients f_i of the friction basis functions, torque = -sum f_i phi_i, compensated in the records.

    places (n_m,): examined motors, `motor 1`.  place_units (n_m,): N*m, or N of a linear motor.  shapes (n_f,): basis
    functions; a motor without one is not compensated.  covariance (n_f, n_f): by noise, approximate basis functions,
    and differences between configurations.  before, after (C, n_m): unexplained torque (distortion and noise) without
    and with compensation, Nm (N).  residual_power_ratio (n_m,): 1 without compensation.  accelerance (n_m,): of a motor
    as an inertia, 1 / (kg m^2) (1 / kg); 0 if unknown.
    """

    places: tuple[str, ...]
    place_units: tuple[str, ...]
    shapes: tuple[BasisFunction, ...]
    coulomb_torque: FloatArray = labelled("torque of each basis function, link side", "N*m", "shape")
    covariance: FloatArray = labelled("covariance of the coefficients", "", "shape shape")
    configurations: tuple[str, ...]
    before: FloatArray = labelled("torque that no response explains, median line", "N*m", "configurations places")
    after: FloatArray = labelled("unexplained torque after compensation, median line", "N*m", "configurations places")
    residual_power_ratio: FloatArray = labelled("cross-validated residual power over initial power", "", "places")
    accelerance: FloatArray = labelled("acceleration per torque as an inertia", "", "places")
    notes: tuple[Note, ...] = field(default=())
    swings: tuple[float, ...] = labelled("median motion between two reversals, link side", "rad", "places", default=())

    @property
    def std(self) -> FloatArray:
        """Standard deviation (n_f,) of the coefficients."""
        return np.sqrt(np.diag(self.covariance))

    def compensated_basis(self, location: str) -> tuple[tuple[BasisFunction, float], ...]:
        """Return the basis functions compensated in a motor's torque, each with its coefficient."""
        pairs = zip(self.shapes, self.coulomb_torque.tolist(), strict=True)
        return tuple((shape, f) for shape, f in pairs if shape.place == location and f > 0)

    def compensated_motors(self) -> tuple[str, ...]:
        """Return the motors with compensated friction."""
        return tuple(location for location in self.places if any(shape.place == location for shape in self.shapes))

    def coulomb_friction(self, location: str) -> tuple[float, float]:
        """Return F_c of a motor in fast steady sliding, the sum of its coefficients, and its std; Nm (N).

        The sliding torque of elements that do not slide between two reversals is extrapolated.  The std includes the
        extrapolated torque.
        """
        row = np.array([shape.when_fast * (shape.place == location) for shape in self.shapes])
        swing = np.array([self.swing(location)])
        not_reversed = np.array([(1 - float(shape.reversal(swing)[0])) / 2 for shape in self.shapes])
        std = math.sqrt(max(float(row @ self.covariance @ row), 0.0))
        return float(row @ self.coulomb_torque), math.hypot(std, float((row * not_reversed) @ self.coulomb_torque))

    def swing(self, location: str) -> float:
        """Return the median motion of a motor between two reversals, rad (m), link side; infinite if unknown."""
        return dict(zip(self.places, self.swings, strict=False)).get(location, math.inf)

    def swing_ratio(self, location: str) -> float:
        """Return the motion of a motor between two reversals over its presliding distance, F_c over stiffness."""
        basis = [(shape, f) for shape, f in self.compensated_basis(location) if shape.kind in ("stop", "bristle")]
        stiffness = sum(f / shape.threshold for shape, f in basis)
        return self.swing(location) * stiffness / sum(f for _, f in basis) if basis else math.inf

    def reversal(self, location: str, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the torque (n,) and its std at `distance` (n,) after a reversal out of fast sliding.

        It rises from -F_c to F_c, where all bristles slide again; link side, rad and Nm (m and N).
        """
        return self._curve(location, [shape.reversal(distance) for shape in self.shapes])

    def sliding(self, location: str, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the torque (n,) in steady sliding at `velocity` (n,), and its std; link side, rad/s and Nm."""
        return self._curve(location, [shape.sliding(velocity) for shape in self.shapes])

    def motion(self, record: Record, location: str) -> Motion:
        """Return the motion of a motor under its friction, between the samples of a record."""
        accelerance = float(self.accelerance[self.places.index(location)])
        return motion_with_friction(record, location, self.compensated_basis(location), accelerance)

    def _curve(self, location: str, values: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return a motor's torque (n,) and its std; values: phi (n,) of each basis function."""
        rows = np.stack(values, axis=1) * np.array([shape.place == location for shape in self.shapes])
        variance = np.einsum("ni,ij,nj->n", rows, self.covariance, rows)
        return rows @ self.coulomb_torque, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class FrictionRow:
    """Coulomb friction F_c of a motor in Nm (N), link side, with std and 95 % interval; None without compensation.

    residual_power_ratio: as in `CompensatedFriction`.
    """

    place: str
    unit: str
    residual_power_ratio: float
    coulomb_torque: float | None = None
    std: float | None = None
    interval: tuple[float, float] | None = None


# Std of the Coulomb torque by elements that do not slide, over stiffness times motion of their spring (GMS).
UNSEEN_FACTOR = 6.0


def friction_rows(friction: CompensatedFriction, springs: Mapping[str, float] = {}) -> tuple[FrictionRow, ...]:
    """Return one row for each examined motor, in their order.

    springs: presliding stiffness of motors that a fit has estimated, link side.
    """
    rows, compensated, ratios = [], friction.compensated_motors(), friction.residual_power_ratio.tolist()
    for location, unit, ratio in zip(friction.places, friction.place_units, ratios, strict=True):
        F_c, std = friction.coulomb_friction(location)
        if springs.get(location, 0.0) > 0 and friction.swings:
            std = math.hypot(std, UNSEEN_FACTOR * springs[location] * friction.swing(location))
        interval = (max(F_c - QUANTILE_95 * std, 0.0), F_c + QUANTILE_95 * std)
        rows.append(FrictionRow(location, unit, ratio, *((F_c, std, interval) if location in compensated else ())))
    return tuple(rows)
