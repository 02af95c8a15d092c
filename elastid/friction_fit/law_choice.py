"""The parts of the law that levels can tell, one after the other, and for each other part why not and what would."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.friction_fit.levels import Levels
from elastid.friction_fit.spec import LawSpec, Part
from elastid.friction_fit.static_curve import START_DECAY_K, CurveFit, Terms, fit_curve

# Chance that a part is taken into a law that does not have it.
FALSE_ALARM = 0.01
# A number wider than this share of itself (95 % of a normal distribution: it may as well be 0) is not known.
MAX_RELATIVE_STD = 0.5
# Reasons of parts that are not missing: nobody looked for them, or the data show that they are not there.
NOT_ASKED, ABSENT = "not asked for", "the levels do not show it"
# Conditions closer than this are one: in K, and as a share of the largest load.
TEMPERATURE_STEP_K, LOAD_STEP = 2.0, 0.05
# Speeds that a Stribeck curve beside viscous friction needs, and the part of nu_s that the lowest must reach.
MIN_SPEEDS, LOWEST_SPEED = 5, 1 / 3


@dataclass(frozen=True)
class Held:
    """A part of the law without numbers: why, and what would give them."""

    part: str
    reason: str


@dataclass(frozen=True)
class _Part:
    """Numbers that come together: how they enter the terms, and why the conditions cannot tell them ("" if they can).

    is_tested: by F.  Not so a number that would otherwise be held at one that nobody measured: it is free where it can
    be told at all, since the intervals of the others would not hold the truth.
    """

    name: str
    key: Part
    add: Callable[[Terms], Terms]
    refusal: str
    is_tested: bool = True


def choose_law(levels: Levels, spec: LawSpec) -> tuple[CurveFit, tuple[Held, ...]]:
    """The law with the parts that the levels tell, and the parts that were left out with their reasons.

    Raises FitError for a part that is asked for (`yes`) and cannot be told, and where there are too few levels.
    """
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
    """The law with one more part, or why not."""
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
    chance = f_distribution.sf(
        (fit.cost - wider.cost) / len(new) / max(1.0, wider.cost / wider.dof), len(new), wider.dof
    )
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
    """Why a number of the new part is not known; a slope over temperature or direction may be zero, others not."""
    std = dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True))
    for name in names:
        if name in (
            "temperature.stribeck_velocity",
            "temperature.stiction",
            "directions.coulomb",
            "directions.viscous",
        ):
            continue
        value = fit.values[name]
        if not std[name] < MAX_RELATIVE_STD * abs(value) or value <= 0:
            return f"{name} would be {value:.3g} +- {std[name]:.2g}, which says nothing; more speeds around it would"
    return None


def _parts(levels: Levels, spec: LawSpec) -> tuple[_Part, ...]:
    """In the order in which they are tried."""
    speeds = _distinct(np.log(levels.speed), 0.05)
    temperatures = _distinct(levels.temperature[np.isfinite(levels.temperature)], TEMPERATURE_STEP_K)
    loads = _distinct(levels.load / max(float(levels.load.max()), 1e-300), LOAD_STEP)
    few_speeds = (
        "" if speeds >= MIN_SPEEDS else f"{speeds} speeds; a Stribeck curve beside viscous friction needs {MIN_SPEEDS}"
    )
    one_way = "" if {1.0, -1.0} <= set(levels.direction.tolist()) else f"{ABSENT}: the directions are alike"
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
        kept = {name: value for name, value in (dict(terms.held) | (held or {})).items() if name not in searched}
        return replace(terms, linear=(*terms.linear, *linear), searched=(*terms.searched, *searched), held=kept)

    return added


def _distinct(values: FloatArray, step: float) -> int:
    """How many values there are that lie further apart than a step."""
    ordered = np.sort(values)
    return 0 if not len(ordered) else 1 + int(np.sum(np.diff(ordered) > step))
