"""StaticLaw: what was identified of the sliding friction of one place, as numbers of a robot's file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.units import of_translation
from elastid.friction_fit.law_choice import Held, choose_law
from elastid.friction_fit.levels import Levels
from elastid.friction_fit.spec import LawSpec
from elastid.friction_fit.static_curve import CurveFit
from elastid.robot.friction import Directions, Friction, LoadDependence, MeasuredRange, TemperatureDependence

# Units of the numbers, of a place that turns.
UNITS = {
    "coulomb": "N*m",
    "stiction": "N*m",
    "viscous": "N*m*s/rad",
    "quadratic": "N*m*s^2/rad^2",
    "stribeck_velocity": "rad/s",
    "exponent": "",
    "load.coulomb": "",
    "load.stiction": "",
    "load.stribeck_velocity": "rad/s",
    "temperature.stiction": "N*m/K",
    "temperature.stribeck_velocity": "rad/(s*K)",
    "temperature.viscous": "N*m*s/rad",
    "temperature.decay": "K",
    "directions.coulomb": "N*m",
    "directions.viscous": "N*m*s/rad",
}


@dataclass(frozen=True)
class Number:
    """One number of a law with its 95 % interval, and the conditions that it was learnt from."""

    name: str
    unit: str
    value: float
    std: float
    low: float
    high: float
    learnt_from: str


@dataclass(frozen=True)
class StaticLaw:
    """The law through levels, and the parts that could not be told from them."""

    levels: Levels
    fit: CurveFit
    held: tuple[Held, ...]

    @classmethod
    def of(cls, levels: Levels, spec: LawSpec) -> StaticLaw:
        """The law that the levels tell; FitError as `choose_law`."""
        fit, held = choose_law(levels, spec)
        return cls(levels, fit, held)

    @property
    def names(self) -> tuple[str, ...]:
        """The numbers as a robot's file names them: stiction, not its excess over Coulomb friction."""
        return tuple(name.replace("excess", "stiction") for name in self.fit.names)

    @property
    def values(self) -> dict[str, float]:
        """The numbers by name, SI, at the reference temperature."""
        return dict(zip(self.names, (self._sum @ self._raw).tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """Of the numbers (n, n)."""
        return np.asarray(self._sum @ self.fit.covariance @ self._sum.T)

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All numbers with 95 % intervals."""
        reach = self.fit.reach
        found = []
        for name, value, std in zip(
            self.names, self.values.values(), np.sqrt(np.diag(self.covariance)).tolist(), strict=True
        ):
            unit = of_translation(UNITS[name]) if self.levels.slides and UNITS[name] else UNITS[name]
            low, high = value - reach * std, value + reach * std
            found.append(Number(name, unit, value, std, low, high, self._learnt_from(name)))
        return tuple(found)

    @property
    def measured(self) -> MeasuredRange:
        """The ranges of the conditions."""
        known = self.levels.temperature[np.isfinite(self.levels.temperature)]
        return MeasuredRange(
            _range(self.levels.speed),
            _range(self.levels.load) if self.levels.load.any() else None,
            _range(known) if len(known) else None,
        )

    @property
    def viscous(self) -> float:
        """The viscous friction that stands beside the law in a robot's file."""
        return max(0.0, self.values.get("viscous", 0.0))

    def to_friction(self) -> Friction:
        """The law as a robot's file has it; its presliding is another's."""
        value, eta = self.values, self.fit.values
        coulomb = value["coulomb"]
        load, temperature, directions = None, None, None
        if "load.coulomb" in value or "load.stiction" in value:
            load = LoadDependence(
                max(0.0, value.get("load.coulomb", 0.0)),
                value.get("load.stiction"),
                value.get("load.stribeck_velocity"),
            )
        if "temperature.viscous" in value or "temperature.stiction" in value:
            temperature = TemperatureDependence(
                self.fit.T_0,
                value.get("temperature.stiction", 0.0),
                value.get("temperature.stribeck_velocity", 0.0),
                max(0.0, value.get("temperature.viscous", 0.0)),
                eta.get("temperature.decay", 20.0),
            )
        if "directions.coulomb" in value:
            directions = Directions(value["directions.coulomb"], value["directions.viscous"])
        return Friction(
            coulomb,
            value.get("stiction"),
            value.get("stribeck_velocity"),
            max(0.0, value.get("quadratic", 0.0)),
            eta.get("exponent", 2.0),
            load=load,
            temperature=temperature,
            directions=directions,
            measured=self.measured,
        )

    @property
    def _raw(self) -> FloatArray:
        return np.array([self.fit.values[name] for name in self.fit.names])

    @property
    def _sum(self) -> FloatArray:
        """Excess numbers to stiction: D_s + F_c."""
        names = self.fit.names
        T = np.eye(len(names))
        for i, name in enumerate(names):
            if name.endswith("excess") and name.replace("excess", "coulomb") in names:
                T[i, names.index(name.replace("excess", "coulomb"))] = 1.0
        return T

    def _learnt_from(self, name: str) -> str:
        levels, unit = self.levels, "m/s" if self.levels.slides else "rad/s"
        speeds = f"{levels.n_levels} levels from {levels.speed.min():.3g} to {levels.speed.max():.3g} {unit}"
        if name.startswith("temperature"):
            known = levels.temperature[np.isfinite(levels.temperature)]
            return f"{speeds}, {known.min():.3g} to {known.max():.3g} degC"
        if name.startswith("load"):
            return f"{speeds}, loads of {levels.load.min():.3g} to {levels.load.max():.3g} {_load_unit(levels)}"
        return f"{speeds}, both directions" if name.startswith("directions") else speeds


def _load_unit(levels: Levels) -> str:
    return "N" if levels.slides else "N*m"


def _range(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())
