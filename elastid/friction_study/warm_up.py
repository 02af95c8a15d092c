r"""The temperature of a joint from the power that friction and motor turn into heat, and friction that follows it.

.. math:: C \dot T = P - h (T - T_a), \quad P = \tau_f v + r u^2, \qquad
          T_{k+1} = T_a + (T_k - T_a) e^{-x} + \frac{P_k}{h} (1 - e^{-x}), \quad x = h \Delta t / C

exact over a step of constant power. A gear that warms with its motor is a second node, P shared between them:

.. math:: T = T_a + \frac{1}{h} \sum_i w_i\, \theta_i, \qquad \dot\theta_i = (P - \theta_i) / T_i, \quad w_1 + w_2 = 1

Known: readings of a thermometer, levels of test passes, or both. With levels alone the law's dependence on temperature
must be known; where it is not, kelvins cannot be known either, and the levels at each test speed follow a relative
temperature u, 1 where the largest power would lead: level = c_0 + c_1 u + c_2 u^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError, FitError
from elastid.friction.static import Conditions
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.least_squares import FALSE_ALARM, Optimum, chance_of_terms, minimise
from elastid.friction_study.passes import Pass, alike_speeds, passes_of
from elastid.record import FrictionRecord, WarmUpLog

# Level(speed (m,), temperature (m,)) of a law, Nm.
LevelOf = Callable[[FloatArray, FloatArray], FloatArray]
Scale = Literal["kelvin", "relative"]


@frozen_value
class WarmUp:
    """A warm-up: power (n,) in W from time_s[k] to time_s[k + 1] (n + 1,), in an ambient of ambient_degc.

    readings (n + 1,): of a thermometer in degC, NaN where there is none, with reading_std.
    test (m,): index of time_s at which a test pass was made, at test_speed (m,), with its level (m,) and std (m,).
    load (m,): |torque| that each test pass carried, Nm; None where none is known.
    """

    time_s: FloatArray
    power: FloatArray
    ambient_degc: float
    start_degc: float
    readings: FloatArray
    reading_std: float
    test: FloatArray
    test_speed: FloatArray
    level: FloatArray
    level_std: FloatArray
    load: FloatArray | None = None

    def __post_init__(self) -> None:
        n, m = len(self.power), len(self.level)
        if len(self.time_s) != n + 1 or len(self.readings) != n + 1:
            raise ValueError(f"warm-up: {n} powers need {n + 1} times and readings")
        if not {len(self.test), len(self.test_speed), len(self.level_std)} == {m}:
            raise ValueError(f"warm-up: {m} levels need as many tests, speeds and stds")
        if np.any(np.diff(self.time_s) <= 0):
            raise DataError("warm-up: its times do not increase; sort the log, or correct its clock")

    @property
    def tests(self) -> np.ndarray:
        """Indices of the tests."""
        return self.test.astype(np.int64)


@dataclass(frozen=True)
class ThermalModel:
    """Time constants (n_nodes,) in s, their shares (n_nodes,), h in W/K, with the covariance of their logarithms.

    h is NaN and scale `relative` where kelvins cannot be known; then series (n_speeds, 3) are c_0, c_1, c_2 at each
    test speed.
    """

    scale: Scale
    time_constants: FloatArray
    shares: FloatArray
    h: float
    log_std: FloatArray
    cost: float
    dof: int
    speeds: FloatArray
    series: FloatArray
    power_at_one: float

    def temperature(self, warm_up: WarmUp) -> FloatArray:
        """T (n + 1,) in degC along a warm-up; relative: u."""
        heat = _heat(warm_up, self.time_constants, self.shares)
        if self.scale == "relative":
            return np.asarray(heat / self.power_at_one)
        return _kelvin(warm_up, self.time_constants, self.shares, self.h)

    def levels(self, warm_up: WarmUp, level_of: LevelOf | None) -> FloatArray:
        """Levels (m,) at the tests of a warm-up."""
        at_tests = self.temperature(warm_up)[warm_up.tests]
        if self.scale == "kelvin":
            if level_of is None:
                raise ValueError("a model in kelvins needs a law to give levels")
            return level_of(warm_up.test_speed, at_tests)
        place = [int(np.argmin(np.abs(self.speeds - speed))) for speed in warm_up.test_speed]
        return np.asarray(np.sum(self.series[place] * np.vander(at_tests, 3, increasing=True), axis=1))


def level_over_heat(law: StaticLaw | None, warm_up: WarmUp) -> LevelOf | None:
    """The law's level at test passes under their loads; None where the law does not depend on temperature."""
    if law is None or not any(name.startswith("temperature") for name in law.names):
        return None
    fit, load = law.fit, 0.0 if warm_up.load is None else warm_up.load

    def level(speed: FloatArray, temperature: FloatArray) -> FloatArray:
        zeros = np.zeros_like(speed)
        return fit.torque(Conditions(speed, zeros, zeros + load, temperature))

    return level


def fit_warm_up(warm_up: WarmUp, level_of: LevelOf | None = None) -> ThermalModel:
    """The thermal model with one node, or with two where an F test at 1 % finds the second.

    level_of: the law's level at speeds and temperatures, where its dependence on temperature is known.
    Raises DataError where nothing warms up or nothing was measured, FitError where no start leads to an optimum.
    """
    has_readings = bool(np.isfinite(warm_up.readings).any())
    if not has_readings and not len(warm_up.level):
        raise DataError("warm-up: neither a thermometer nor test passes; log one of them")
    if not np.any(warm_up.power > 0):
        text = "the power is nowhere positive, so that nothing warms; check the signs of torque and speed"
        raise DataError(f"warm-up: {text}")
    fit = _fit_kelvin if has_readings or level_of is not None else _fit_relative
    single, double = fit(warm_up, level_of, 1), fit(warm_up, level_of, 2)
    if double.dof < 1:
        return single
    return double if chance_of_terms(single.cost, double.cost, 2, double.dof) < FALSE_ALARM else single


def _fit_kelvin(warm_up: WarmUp, level_of: LevelOf | None, nodes: int) -> ThermalModel:
    read = np.isfinite(warm_up.readings)

    def residual(x: FloatArray) -> FloatArray:
        constants, shares = _nodes(x, nodes)
        T = _kelvin(warm_up, constants, shares, float(np.exp(x[0])))
        # A thermometer is never better than 0.05 K.
        parts = [(warm_up.readings - T)[read] / max(warm_up.reading_std, 0.05)] if read.any() else []
        if level_of is not None:
            parts.append((warm_up.level - level_of(warm_up.test_speed, T[warm_up.tests])) / warm_up.level_std)
        return np.concatenate(parts)

    # h such that the mean power warms by 20 K.
    end = _search(warm_up, residual, nodes, np.log(warm_up.power.mean() / 20.0))
    constants, shares = _nodes(end.x, nodes)
    return ThermalModel(
        "kelvin", constants, shares, float(np.exp(end.x[0])), np.sqrt(np.diag(end.covariance)), end.cost, end.dof,
        np.zeros(0), np.zeros((0, 3)), math.nan,
    )  # fmt: skip


def _fit_relative(warm_up: WarmUp, level_of: LevelOf | None, nodes: int) -> ThermalModel:
    """Levels at each speed are a parabola of the heat; its three numbers are eliminated."""
    speeds, place = np.unique(np.round(warm_up.test_speed, 9), return_inverse=True)

    def columns(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        heat = _heat(warm_up, *_nodes(x, nodes))[warm_up.tests] / warm_up.power.max()
        by_speed = np.eye(len(speeds))[place]
        A = np.hstack([by_speed * heat[:, None] ** power for power in range(3)]) / warm_up.level_std[:, None]
        return A, np.asarray(np.linalg.lstsq(A, warm_up.level / warm_up.level_std, rcond=None)[0])

    def residual(x: FloatArray) -> FloatArray:
        A, c = columns(x)
        return np.asarray(warm_up.level / warm_up.level_std - A @ c)

    end = _search(warm_up, residual, nodes, None)
    _, c = columns(end.x)
    constants, shares = _nodes(end.x, nodes)
    log_std = np.append(0.0, np.sqrt(np.diag(end.covariance))[1:])  # without kelvins there is no h
    return ThermalModel(
        "relative", constants, shares, math.nan, log_std, end.cost, end.dof - 3 * len(speeds), speeds,
        c.reshape(3, -1).T, float(warm_up.power.max()),
    )  # fmt: skip


def _search(warm_up: WarmUp, residual: Callable[[FloatArray], FloatArray], nodes: int, log_h: float | None) -> Optimum:
    """x = (ln h, ln T_1[, ln T_2, logit w_1]), the best of three starts."""
    span = float(warm_up.time_s[-1] - warm_up.time_s[0])
    low, high = np.log(1 / 200 * span), np.log(5.0 * span)  # of time constants
    lead = 0.0 if log_h is None else log_h
    second = [(low, high), (-4.0, 4.0)] if nodes == 2 else []
    bounds = np.array([(lead - 10, lead + 10), (low, high), *second]).T
    starts = [
        [lead, np.log(share * span), *([np.log(share * span / 8), 0.0] if nodes == 2 else [])]
        for share in (0.05, 0.2, 0.6)
    ]
    within = [np.clip(start, bounds[0] + 1e-6, bounds[1] - 1e-6) for start in starts]
    ends = [end for end in minimise(residual, within, bounds=tuple(bounds)) if np.isfinite(end.cost)]
    if not ends:
        raise FitError("warm-up: no start leads to an optimum; check its levels and temperatures")
    return min(ends, key=lambda end: end.cost)


def _nodes(x: FloatArray, nodes: int) -> tuple[FloatArray, FloatArray]:
    if nodes == 1:
        return np.exp(x[1:2]), np.ones(1)
    share = 1 / (1 + np.exp(-x[3]))
    return np.exp(x[1:3]), np.array([share, 1 - share])


def _heat(warm_up: WarmUp, constants: FloatArray, shares: FloatArray) -> FloatArray:
    """sum w_i theta_i (n + 1,) in W, from a joint at ambient temperature."""
    steps = np.diff(warm_up.time_s)
    total = np.zeros(len(warm_up.time_s))
    for T_i, w in zip(constants, shares, strict=True):
        decay, theta, path = np.exp(-steps / T_i), 0.0, [0.0]
        for fade, power in zip(decay.tolist(), warm_up.power.tolist(), strict=True):
            theta = theta * fade + power * (1 - fade)
            path.append(theta)
        total += w * np.array(path)
    return total


def _kelvin(warm_up: WarmUp, constants: FloatArray, shares: FloatArray, h: float) -> FloatArray:
    """T (n + 1,) in degC; the excess over ambient at the start fades with the same constants."""
    elapsed = warm_up.time_s - warm_up.time_s[0]
    fading = np.sum([w * np.exp(-elapsed / T_i) for T_i, w in zip(constants, shares, strict=True)], axis=0)
    above = warm_up.start_degc - warm_up.ambient_degc
    return np.asarray(warm_up.ambient_degc + above * fading + _heat(warm_up, constants, shares) / h)


def warm_up_of(log: WarmUpLog, tests: Sequence[FrictionRecord]) -> WarmUp:
    """The log with the level of each test pass: half the difference of both ways over angles that both cover."""
    pairs = [_common(sorted(passes_of(record), key=lambda each: -each.direction)) for record in tests]
    speeds = [(forth.velocity.mean() - back.velocity.mean()) / 2 for forth, back in pairs]
    levels = [(forth.torque.mean() - back.torque.mean()) / 2 for forth, back in pairs]
    stds = [np.hypot(*(np.std(each.torque) / np.sqrt(len(each.torque)) for each in pair)) / 2 for pair in pairs]
    samples = np.searchsorted(log.time_s, [record.start_s for record in tests], side="right") - 1
    return WarmUp(
        log.time_s, log.power, log.ambient_degc, log.start_degc, log.temperature, log.temperature_std,
        np.clip(samples, 0, len(log.time_s) - 1), alike_speeds(np.array(speeds)), np.array(levels), np.array(stds),
        np.array([record.load_torque for record in tests]),
    )  # fmt: skip


def _common(pair: Sequence[Pass]) -> list[Pass]:
    low = max(float(each.position.min()) for each in pair)
    high = min(float(each.position.max()) for each in pair)
    if high <= low:
        return list(pair)
    inside = [(each.position >= low) & (each.position <= high) for each in pair]
    names = ("position", "velocity", "acceleration", "torque")
    each_inside = zip(pair, inside, strict=True)
    return [replace(each, **{name: getattr(each, name)[own] for name in names}) for each, own in each_inside]
