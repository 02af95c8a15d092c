r"""The temperature of a joint from the power that friction and motor turn into heat, and friction that follows it.

.. math:: C \dot T = P - h (T - T_a), \quad P = \tau_f v + r u^2, \qquad
          T_{k+1} = T_a + (T_k - T_a) e^{-x} + \frac{P_k}{h} (1 - e^{-x}), \quad x = h \Delta t / C

exact over a step of constant power. A gear that warms with its motor is a second node, P shared between them,

.. math:: T = T_a + \frac{1}{h} \sum_i w_i\, \theta_i, \qquad \dot\theta_i = (P - \theta_i) / T_i, \quad
          w_1 = \frac{s}{1 - T_2 / T_1}, \quad w_2 = 1 - w_1

with s = 0 to 1 for any location in the joint: both w are positive where P enters. With s = 1, w_2 is negative: the
other node warms this location, such as the housing with its thermometer. The friction torque of test runs is modelled
as c_0 + c_1 u + c_2 u^2. The relative temperature u has the time constants of the thermometer, and is 1 in the steady
state of the largest power. Without a thermometer, temperatures in kelvin and h are not identifiable.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_banded

from elastid.base.arrays import FloatArray, IntArray, frozen_value, values_by_name
from elastid.base.errors import DataError, FitError, Note
from elastid.friction_record import FrictionRecord, WarmUpLog
from elastid.friction_study.constant_velocity import PassRegression, passes_of
from elastid.friction_study.least_squares import FALSE_ALARM, minimise, terms_p_value
from elastid.friction_study.motion_signals import alike_speeds


@frozen_value
class WarmUp:
    """A log with its test passes.

    test (m,): index of its times at which one was made, at test_speed (m,), with its torque (m,) and std (m,).
    """

    log: WarmUpLog
    test: IntArray
    test_speed: FloatArray
    torque: FloatArray
    torque_std: FloatArray


# Smallest std of a thermometer, in K; relative error of a friction torque as a parabola of the temperature; log std of
# the slowest time constant, above which a warm-up was too short.
BEST_THERMOMETER, PARABOLA, MAX_LOG_STD = 0.05, 0.01, 0.3


@dataclass(frozen=True)
class ThermalModel:
    """Time constants (n_nodes,) in s, their fractions (n_nodes,), h in W/K, and the std of the logarithms of both.

    h is NaN without a thermometer; fractions are then those of the friction torque.
    """

    time_constants: FloatArray
    fractions: FloatArray
    h: float
    log_std: FloatArray
    cost: float
    dof: int


def fit_warm_up(warm_up: WarmUp) -> ThermalModel:
    """Return the thermal model with one node, or with two where an F test at 1 % finds the second.

    Raises DataError where nothing warms up or nothing was measured, FitError where no start leads to an optimum.
    """
    log, has_series = warm_up.log, len(warm_up.torque) > 0
    has_readings = bool(np.isfinite(log.temperature).any())
    if np.any(np.diff(log.time_s) <= 0) or not np.any(log.power > 0) or not (has_readings or has_series):
        text = "it takes times that increase, power that is positive, and readings of a thermometer or test passes"
        raise DataError("friction/warm-up", f"{text}; correct the log's clock and signs, or log them", "warm-up")
    problem = _Problem(warm_up, has_readings, has_series)
    single = problem.fit()
    double = replace(problem, nodes=2).fit(float(single.time_constants[0]))
    chance = terms_p_value(single.cost, double.cost, single.dof - double.dof, max(double.dof, 1))
    return double if double.dof > 0 and chance < FALSE_ALARM else single


@dataclass(frozen=True)
class _Problem:
    """Unknowns x by name: ln T_1, ln(T_2 / T_1), s of thermometer and friction torques, ln h, start over its std.

    is_kelvin: temperatures were measured.  The three coefficients of the parabola of the torques are eliminated.
    """

    warm_up: WarmUp
    is_kelvin: bool
    has_series: bool
    nodes: int = 1

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        has_fraction = {"share": self.is_kelvin, "level_share": self.has_series}
        second = ("ratio", *(name for name, is_there in has_fraction.items() if is_there))
        return ("constant", *(second if self.nodes == 2 else ()), *(("h", "start") if self.is_kelvin else ()))

    def thermal_parameters(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float, float]:
        """Return time constants (nodes,), s, fractions (nodes,) of thermometer and friction torques, h, start, degC."""
        value, log = values_by_name(self.names, x), self.warm_up.log
        ratio = math.exp(value.get("ratio", 0.0))
        constants = math.exp(value["constant"]) * np.array([1.0, ratio])[: self.nodes]
        first = np.array([[value.get(name, 1.0)] for name in ("share", "level_share")]) / max(1 - ratio, 1e-9)
        fractions, torque_fractions = np.ones((2, 1)) if self.nodes == 1 else np.hstack([first, 1 - first])
        start = log.start_degc + max(log.start_std, 1e-6) * value.get("start", 0.0)
        return constants, fractions, torque_fractions, math.exp(value.get("h", 0.0)), start

    def residual(self, x: FloatArray) -> FloatArray:
        """Return residuals (n,) of temperatures, friction torques and the start, of variance 1."""
        warm_up, (constants, fractions, torque_fractions, h, start) = self.warm_up, self.thermal_parameters(x)
        residuals = []
        if self.is_kelvin:
            log, T = warm_up.log, temperature(warm_up.log, constants, fractions, h, start)
            read, std = np.isfinite(log.temperature), max(log.temperature_std, BEST_THERMOMETER)
            residuals += [(log.temperature - T)[read] / std, x[-1:]]
        if self.has_series:
            weight = 1 / np.hypot(warm_up.torque_std, PARABOLA * warm_up.torque)
            A, b = self.series(constants, torque_fractions) * weight[:, None], warm_up.torque * weight
            residuals.append(b - A @ np.linalg.lstsq(A, b, rcond=None)[0])
        return np.concatenate(residuals)

    def series(self, constants: FloatArray, fractions: FloatArray) -> FloatArray:
        """Return columns (m, 3 n_speeds) of the parabolas."""
        speeds, index = np.unique(np.round(self.warm_up.test_speed, 9), return_inverse=True)
        heat = _heat(self.warm_up.log, constants, fractions)[self.warm_up.test] / self.warm_up.log.power.max()
        return np.hstack([np.eye(len(speeds))[index] * heat[:, None] ** power for power in range(3)])

    def fit(self, constant: float | None = None) -> ThermalModel:
        """Return the best of a few starts; constant: with one thermal node. Raise FitError without an optimum."""
        log, span = self.warm_up.log, float(np.ptp(self.warm_up.log.time_s))
        lead = float(np.log(max(log.power.mean(), 1e-3) / 20.0))  # h such that the mean power warms by 20 K
        bounds = {"constant": (np.log(span / 200), np.log(5.0 * span)), "ratio": (np.log(1e-3), np.log(0.9))}
        # Further thermal nodes can raise a fraction slightly above 1.
        bounds |= {"share": (0.0, 1.2), "level_share": (0.0, 1.2), "h": (lead - 10, lead + 10), "start": (-10, 10)}
        low, high = np.array([bounds[name] for name in self.names]).T
        starts = [
            {"constant": np.log(T), "ratio": np.log(ratio), "share": s, "level_share": 0.6, "h": lead, "start": 0.0}
            for T in ((0.05 * span, 0.2 * span, 0.6 * span) if constant is None else (constant,))
            for ratio, s in ((1 / 8, 0.6), (1 / 4, 1.0), (1 / 30, 0.6))[: 1 if constant is None else 3]
        ]
        within = [np.array([float(start[name]) for name in self.names]) for start in starts]
        ends = [end for end in minimise(self.residual, within, bounds=(low, high)) if np.isfinite(end.cost)]
        if not ends:
            raise FitError("friction/warm-up", "no start leads to an optimum; check torques, temperatures", "warm-up")
        end = min(ends, key=lambda end: end.cost)
        constants, fractions, torque_fractions, h, _ = self.thermal_parameters(end.x)
        eliminated = np.linalg.matrix_rank(self.series(constants, torque_fractions)) if self.has_series else 0
        rows = ("h",), ("constant",), ("constant", "ratio")  # ln T_2 = ln T_1 + ln ratio
        pick = np.array([[float(name in row) for name in self.names] for row in rows])
        log_std = np.sqrt(np.diag(pick @ np.nan_to_num(end.covariance, posinf=1e12) @ pick.T))[: 1 + self.nodes]
        fractions, h = (fractions, h) if self.is_kelvin else (torque_fractions, math.nan)
        return ThermalModel(constants, fractions, h, log_std, end.cost, end.dof - eliminated)


def warm_up_note(model: ThermalModel, warm_up: WarmUp, location: str) -> tuple[Note, ...]:
    """Return a note if a warm-up is too short to identify its slowest time constant."""
    std, constant = float(model.log_std[1]), float(model.time_constants[0])  # of the slowest
    seconds = float(np.ptp(warm_up.log.time_s))
    if std < MAX_LOG_STD and constant < seconds:
        return ()
    text = (
        f"{seconds / 60:.3g} min show a time constant of {constant / 60:.3g} min to {std:.0%} only, so that the final "
        "temperature is extrapolated: log two to three time constants, or a pause in which the joint cools"
    )
    return (Note("friction/warm-up", text, location),)


def _heat(log: WarmUpLog, constants: FloatArray, fractions: FloatArray) -> FloatArray:
    """Return sum w_i theta_i (n + 1,) in W, from a joint at ambient temperature."""
    steps, total = np.diff(log.time_s), np.zeros(len(log.time_s))
    for T_i, w in zip(constants, fractions, strict=True):
        decay = np.exp(-steps / T_i)
        recursion = np.array([np.ones(len(total)), np.append(-decay, 0.0)])  # theta_k+1 - decay_k theta_k = .
        total += w * solve_banded((1, 0), recursion, np.append(0.0, log.power * (1 - decay)), check_finite=False)
    return total


def temperature(log: WarmUpLog, constants: FloatArray, fractions: FloatArray, h: float, start: float) -> FloatArray:
    """Return T (n + 1,) in degC; a joint at rest is as warm inside as outside, and cools with its slowest constant."""
    fading, measured = np.exp(-(log.time_s - log.time_s[0]) / constants.max()), log.ambient_degc
    ambient = start if math.isnan(measured) else measured
    return np.asarray(ambient + (start - ambient) * fading + _heat(log, constants, fractions) / h)


def warm_up_of(log: WarmUpLog, tests: Sequence[FrictionRecord]) -> WarmUp:
    """Return the log with the friction torque of each test pass."""
    pairs = [passes_of(record) for record in tests]
    speeds = [float(np.mean([abs(run.velocity.mean()) for run in pair])) for pair in pairs]
    solved = [PassRegression.of(pair, True, 0.0).solve() for pair in pairs]
    torques = np.array([(values[0], np.sqrt(covariance[0, 0])) for values, covariance in solved]).reshape(-1, 2)
    samples = np.searchsorted(log.time_s[1:], [record.start_s for record in tests], side="right")
    return WarmUp(log, samples, alike_speeds(np.array(speeds)), torques[:, 0], torques[:, 1])
