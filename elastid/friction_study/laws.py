"""StaticLaw: sliding friction of one place as a robot's file has it, its parts added where levels show them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.friction_study.least_squares import FALSE_ALARM, chance_of_terms
from elastid.friction_study.levels import Levels
from elastid.friction_study.spec import LawSpec, Part
from elastid.friction_study.stribeck import START_DECAY_K, CurveFit, Terms, fit_curve
from elastid.record import drive_unit, motion_unit
from elastid.robot.friction import Directions, Friction, LoadDependence, MeasuredRange, TemperatureDependence


@dataclass(frozen=True)
class StaticLaw:
    """The law through levels, and the parts that could not be identified from them."""

    levels: Levels
    fit: CurveFit
    held: tuple[Held, ...]

    @classmethod
    def of(cls, levels: Levels, spec: LawSpec) -> StaticLaw:
        """The law that the levels identify; FitError as `choose_law`."""
        fit, held = choose_law(levels, spec)
        return cls(levels, fit, held)

    @property
    def names(self) -> tuple[str, ...]:
        """The numbers as a robot's file names them: stiction, not its excess over Coulomb friction."""
        return tuple(name.replace("excess", "stiction") for name in self.fit.names)

    @property
    def values(self) -> dict[str, float]:
        """The numbers by name, SI, at the reference temperature."""
        raw = np.array([self.fit.values[name] for name in self.fit.names])
        return dict(zip(self.names, (self._sum @ raw).tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """Of the numbers (n, n)."""
        return np.asarray(self._sum @ self.fit.covariance @ self._sum.T)

    @property
    def intervals(self) -> dict[str, tuple[float, float, float, float]]:
        """Of each number by name value, std, and the ends of its 95 % interval."""
        reach, stds = self.fit.reach, np.sqrt(np.diag(self.covariance)).tolist()
        numbers = zip(self.values.items(), stds, strict=True)
        return {name: (x, std, x - reach * std, x + reach * std) for (name, x), std in numbers}

    @property
    def measured(self) -> MeasuredRange:
        """The ranges of the conditions."""
        levels, known = self.levels, self.levels.known_temperatures
        load = _range(levels.load) if levels.load.any() else None
        return MeasuredRange(_range(levels.speed), load, _range(known) if len(known) else None)

    @property
    def viscous(self) -> float:
        """The viscous friction that a robot's file has next to the law."""
        return max(0.0, self.values.get("viscous", 0.0))

    def to_friction(self) -> Friction:
        """The law as a robot's file has it; its presliding is another's."""
        value, eta = self.values, self.fit.values
        load, temperature, directions = None, None, None
        if "load.coulomb" in value or "load.stiction" in value:
            load = LoadDependence(
                max(0.0, value.get("load.coulomb", 0.0)),
                value.get("load.stiction"),
                value.get("load.stribeck_velocity"),
            )
        if "temperature.viscous" in value or "temperature.stiction" in value:
            temperature = TemperatureDependence(
                self.fit.T_0, value.get("temperature.stiction", 0.0), value.get("temperature.stribeck_velocity", 0.0),
                max(0.0, value.get("temperature.viscous", 0.0)), eta.get("temperature.decay", 20.0),
            )  # fmt: skip
        if "directions.coulomb" in value:
            directions = Directions(value["directions.coulomb"], value["directions.viscous"])
        return Friction(
            value["coulomb"], value.get("stiction"), value.get("stribeck_velocity"),
            max(0.0, value.get("quadratic", 0.0)), eta.get("exponent", 2.0),
            load=load, temperature=temperature, directions=directions, measured=self.measured,
        )  # fmt: skip

    @property
    def _sum(self) -> FloatArray:
        """Excess numbers to stiction: D_s + F_c."""
        names = self.fit.names
        T = np.eye(len(names))
        for i, name in enumerate(names):
            if name.endswith("excess") and name.replace("excess", "coulomb") in names:
                T[i, names.index(name.replace("excess", "coulomb"))] = 1.0
        return T

    def learnt_from(self, name: str) -> str:
        """The conditions that identify a number."""
        levels, unit = self.levels, motion_unit("velocity", self.levels.slides)
        speeds = f"{levels.n_levels} levels from {levels.speed.min():.3g} to {levels.speed.max():.3g} {unit}"
        if name.startswith("temperature"):
            known = levels.known_temperatures
            return f"{speeds}, {known.min():.3g} to {known.max():.3g} degC"
        if name.startswith("load"):
            return f"{speeds}, loads of {levels.load.min():.3g} to {levels.load.max():.3g} {drive_unit(levels.slides)}"
        return f"{speeds}, both directions" if name.startswith("directions") else speeds


def _range(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


# Reasons of parts that are not missing: they were not asked for, or the data show that they are absent.
NOT_ASKED, ABSENT = "not asked for", "the levels do not show it"
# Temperatures closer than this are the same condition.
TEMPERATURE_STEP_K = 2.0
# Speeds that a Stribeck curve with viscous friction needs, and the part of nu_s that the lowest must reach.
MIN_SPEEDS, LOWEST_SPEED = 5, 1 / 3


@dataclass(frozen=True)
class Held:
    """A part of the law without numbers: why, and what would give them."""

    part: str
    reason: str


@dataclass(frozen=True)
class _Part:
    """Numbers that come together: how they enter the terms, and the reason why the conditions cannot identify them.

    refusal: that reason, "" without one.  is_tested: by F.  Not so a number that would otherwise be held at one that
    was not measured: it is free where it can be identified at all, since the intervals of the others would not hold the
    truth.
    """

    name: str
    key: Part
    add: Callable[[Terms], Terms]
    refusal: str
    is_tested: bool = True


def choose_law(levels: Levels, spec: LawSpec) -> tuple[CurveFit, tuple[Held, ...]]:
    """The law with the parts that levels identify, and the others with reasons; FitError where such a one is `yes`."""
    fit = fit_curve(levels, Terms(("coulomb", "viscous") if np.ptp(levels.speed) > 0 else ("coulomb",), (), {}))
    waiting, held = list(_parts(levels, spec)), dict[str, str]()
    # A part may show only after a later one: what was refused by its numbers is tried once more.
    for _ in range(2):
        held.clear()
        for part in tuple(waiting):
            wider, reason = _tried(levels, fit, part)
            if wider is None:
                held.setdefault(part.name, reason)  # a later number of the same part has the same reason, or a lesser
                continue
            fit = wider
            waiting.remove(part)
            held.pop(part.name, None)
    taken = {part.name for part in _parts(levels, spec)} - {part.name for part in waiting}
    for part in waiting:
        if part.key == "yes" and part.name not in taken:
            raise FitError(f"friction of {levels.place}: law.{part.name} cannot be identified: {held[part.name]}")
    # Of a part that is there, a further number that does not show is no refusal.
    shown = {name: reason for name, reason in held.items() if name not in taken or not reason.startswith(ABSENT)}
    return fit, tuple(Held(name, reason) for name, reason in shown.items())


def _tried(levels: Levels, fit: CurveFit, part: _Part) -> tuple[CurveFit | None, str]:
    if part.key == "no":
        return None, NOT_ASKED
    if part.refusal:
        return None, part.refusal
    terms = part.add(fit.terms)
    if terms == fit.terms:
        return None, "it needs a Stribeck curve, which the levels do not show"
    try:
        wider = fit_curve(levels, terms)
    except FitError as error:
        return None, str(error)
    new = [name for name in wider.names if name not in fit.names]
    chance = chance_of_terms(fit.cost, wider.cost, len(new), wider.dof)
    if part.is_tested and chance > FALSE_ALARM and part.key == "auto":
        return None, f"{ABSENT} (chance {chance:.2g} without it); more or quieter levels might"
    wide = _widest(wider, new)
    if wide is not None:
        return None, wide
    if "stribeck_velocity" in new:
        nu_s, lowest = wider.values["stribeck_velocity"], float(levels.speed.min())
        if lowest > LOWEST_SPEED * nu_s:
            return None, (
                f"the lowest speed of {lowest:.3g} is above a third of the Stribeck velocity (about {nu_s:.3g}); "
                f"measure at {LOWEST_SPEED * nu_s:.2g} and below"
            )
    return wider, ""


def _widest(fit: CurveFit, names: list[str]) -> str | None:
    """The reason why a number of the new part is not known; a slope over temperature or direction may be zero."""
    std = dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True))
    for name in names:
        if name.startswith("directions") or name in ("temperature.stribeck_velocity", "temperature.stiction"):
            continue
        value = fit.values[name]
        if not std[name] < 0.5 * abs(value) or value <= 0:  # a 95 % interval with 0
            return f"{name} would be {value:.3g} +- {std[name]:.2g}, which says nothing; more speeds around it would"
    return None


def _parts(levels: Levels, spec: LawSpec) -> tuple[_Part, ...]:
    speeds = _distinct(np.log(levels.speed), 0.05)
    temperatures = _distinct(levels.known_temperatures, TEMPERATURE_STEP_K)
    loads = _distinct(levels.load / max(float(levels.load.max()), 1e-300), 0.05)
    few_speeds = (
        "" if speeds >= MIN_SPEEDS else f"{speeds} speeds; a Stribeck curve with viscous friction needs {MIN_SPEEDS}"
    )
    one_way = "" if {1.0, -1.0} <= set(levels.direction.tolist()) else f"{ABSENT}: both directions have the same levels"
    one_load = "" if loads > 1 else "one load; measure in another posture or with a payload"
    two_loads = "" if loads > 2 else f"{loads} loads; a Stribeck velocity of the load's own needs three"
    one_T = "" if temperatures > 1 else "one temperature; measure cold and warm, and log the temperature"
    two_T = "" if temperatures > 2 else f"{temperatures} temperatures; an exponential decay needs three, far apart"
    return (
        _Part("stribeck", spec.stribeck, _with(("excess",), ("stribeck_velocity",), {"exponent": 2.0}), few_speeds),
        _Part("directions", spec.directions, _with(("directions.coulomb", "directions.viscous")), one_way),
        _Part("load", spec.load, _with(("load.coulomb",)), one_load),
        _Part("load", spec.load, _with(("load.excess",), after="stribeck_velocity"), one_load),
        _Part(
            "load", spec.load, _with((), ("load.stribeck_velocity",), after="load.excess"), one_load or two_loads
        ),
        _Part(
            "temperature", spec.temperature,
            _with(("temperature.viscous",), held={"temperature.decay": START_DECAY_K}), one_T,
        ),
        _Part(
            "temperature", spec.temperature,
            _with(("temperature.stiction",), ("temperature.stribeck_velocity",), after="stribeck_velocity"), one_T,
        ),
        _Part(
            "temperature", spec.temperature,
            _with((), ("temperature.decay",), after="temperature.viscous"), one_T or two_T, is_tested=False,
        ),
        _Part(
            "exponent", spec.exponent,
            _with((), ("exponent",), after="stribeck_velocity"), few_speeds, is_tested=False,
        ),
        _Part("quadratic", spec.quadratic, _with(("quadratic",)), few_speeds),
    )  # fmt: skip


def _with(
    linear: tuple[str, ...], searched: tuple[str, ...] = (), held: dict[str, float] | None = None, after: str = ""
) -> Callable[[Terms], Terms]:
    """Adds numbers to terms, if they have the one that these come after."""

    def added(terms: Terms) -> Terms:
        if after and after not in (*terms.linear, *terms.searched):
            return terms
        still = {name: value for name, value in (dict(terms.held) | (held or {})).items() if name not in searched}
        return replace(terms, linear=(*terms.linear, *linear), searched=(*terms.searched, *searched), held=still)

    return added


def _distinct(values: FloatArray, step: float) -> int:
    ordered = np.sort(values)
    return 0 if not len(ordered) else 1 + int(np.sum(np.diff(ordered) > step))
