"""The table of a joint: every number that was identified, with its name, interval and the data that tell it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from elastid.base.units import of_translation
from elastid.friction_fit.at_rest import AtRest
from elastid.friction_fit.motion import MotionFriction
from elastid.friction_fit.result import FrictionNumber
from elastid.friction_fit.shooting import LuGreFit
from elastid.friction_fit.static_law import StaticLaw
from elastid.friction_fit.warm_up import ThermalModel, WarmUp
from elastid.robot.friction_numbers import TERMS

Truth = Mapping[str, float]
# Half the width of a 95 % interval in std, of numbers with many degrees of freedom.
Z_95 = 1.959964
# Numbers of a regression that are no friction: beginning of the name, symbol, meaning, unit of what turns.
OTHERS = {
    "inertia": ("J", "J", "inertia", "kg*m^2"),
    "offset": ("o", "o", "offset of the torque", "N*m"),
    "gravity.cos": ("G", "G", "gravity, cos q", "N*m"),
    "gravity.sin": ("H", "H", "gravity, sin q", "N*m"),
}
DIRECTED = ("coulomb", "viscous")


def numbers_of_law(joint: str, law: StaticLaw, truth: Truth) -> Iterator[FrictionNumber]:
    """Numbers of the static law, and of each direction where they differ."""
    slides, rows = law.levels.slides, {number.name: number for number in law.numbers}
    reach = (law.numbers[0].high - law.numbers[0].value) / law.numbers[0].std
    for number in rows.values():
        term = TERMS[number.name]
        name = term.name(joint)
        yield FrictionNumber(
            name, term.symbol, term.meaning, number.unit, number.value, number.std, number.low, number.high,
            number.learnt_from, truth.get(name),
        )  # fmt: skip
    names = list(law.names)
    for name in DIRECTED:
        if f"directions.{name}" in rows and name in rows:
            pair = [names.index(name), names.index(f"directions.{name}")]
            values = np.array([law.values[names[i]] for i in pair])
            covariance = law.covariance[np.ix_(pair, pair)]
            yield from _directed(joint, name, slides, values, covariance, reach, rows[name].learnt_from)


def numbers_of_motion(joint: str, motion: MotionFriction, truth: Truth) -> Iterator[FrictionNumber]:
    """Numbers of the regression of a motion."""
    fit, slides = motion.chosen, motion.motion.slides
    learnt = f"the motion, {len(motion.plateaus)} plateaus, up to {motion.passband_hz:g} Hz"
    for name, value in zip(fit.names, fit.values.tolist(), strict=True):
        term = TERMS.get(name)
        prefix, symbol, meaning, _ = OTHERS.get(name, ("", "", "", ""))
        if term is not None:
            key, symbol, meaning = term.name(joint), term.symbol, term.meaning
        else:
            key = f"{prefix}_m{joint}"
        std = fit.std(name)
        low, high = value - Z_95 * std, value + Z_95 * std
        yield FrictionNumber(key, symbol, meaning, motion.unit(name), value, std, low, high, learnt, truth.get(key))
    for name in DIRECTED:
        if name in fit.names and f"directions.{name}" in fit.names:
            pair = [fit.names.index(name), fit.names.index(f"directions.{name}")]
            covariance = fit.covariance[np.ix_(pair, pair)]
            yield from _directed(joint, name, slides, fit.values[pair], covariance, Z_95, learnt)


def numbers_at_rest(joint: str, found: AtRest, slides: bool, truth: Truth) -> Iterator[FrictionNumber]:
    """Stiffness and damping of the bristles."""
    learnt = f"responses at rest, {len(found.points)} amplitudes"
    std = np.sqrt(np.diag(found.covariance))
    for key, value, error in (("stiffness", found.sigma_0, std[0]), ("damping", found.sigma_1, std[1])):
        low, high = value - Z_95 * float(error), value + Z_95 * float(error)
        yield _bristle(joint, key, value, float(error), (low, high), slides, learnt, truth)


def numbers_of_bristles(joint: str, found: LuGreFit, slides: bool, truth: Truth) -> Iterator[FrictionNumber]:
    """The same by multiple shooting."""
    for key, name in (("stiffness", "sigma_0"), ("damping", "sigma_1")):
        value, ends = found.values[name], found.interval(name)
        std = value * math.log(ends[1] / value) / Z_95
        yield _bristle(joint, key, value, std, ends, slides, "loops, by multiple shooting", truth)


def numbers_of_heat(joint: str, model: ThermalModel, warm_up: WarmUp) -> Iterator[FrictionNumber]:
    """Time constants, and heat given off where kelvins are known."""
    n = len(model.time_constants)
    read = int(np.isfinite(warm_up.readings).sum())
    learnt = (
        f"{read} readings, {len(warm_up.level)} test passes in {(warm_up.time_s[-1] - warm_up.time_s[0]) / 60:.3g} min"
    )
    for i, T in enumerate(model.time_constants.tolist()):
        std = T * float(model.log_std[1 + i])
        name = f"Tc{i + 1 if n > 1 else ''}_m{joint}"
        yield FrictionNumber(name, "C / h", "time constant of warming", "s", T, std, *_by_log(T, std), learnt)
    if model.scale == "kelvin":
        std = model.h * float(model.log_std[0])
        yield FrictionNumber(f"h_m{joint}", "h", "heat given off", "W/K", model.h, std, *_by_log(model.h, std), learnt)


def _by_log(value: float, std: float) -> tuple[float, float]:
    """Ends of a 95 % interval that is symmetric in the logarithm."""
    reach = math.exp(Z_95 * std / value)
    return value / reach, value * reach


def _bristle(
    joint: str,
    key: str,
    value: float,
    std: float,
    ends: tuple[float, float],
    slides: bool,
    learnt: str,
    truth: Truth,
) -> FrictionNumber:
    term = TERMS[f"lugre.{key}"]
    name = term.name(joint)
    return FrictionNumber(
        name, term.symbol, term.meaning, term.unit_at(slides), value, std, *ends, learnt, truth.get(name)
    )


def _directed(
    joint: str, name: str, slides: bool, values: np.ndarray, covariance: np.ndarray, reach: float, learnt: str
) -> Iterator[FrictionNumber]:
    """Forwards and backwards: mean and half difference, summed and subtracted."""
    term = TERMS[name]
    for sign, mark, word in ((1.0, "+", "forwards"), (-1.0, "-", "backwards")):
        a = np.array([1.0, sign])
        value, std = float(a @ values), float(np.sqrt(a @ covariance @ a))
        unit = of_translation(term.unit) if slides else term.unit
        yield FrictionNumber(
            f"{term.name(joint)}{mark}", f"{term.symbol}{mark}", f"{term.meaning} {word}", unit, value, std,
            value - reach * std, value + reach * std, learnt,
        )  # fmt: skip
