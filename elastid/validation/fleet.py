r"""Parameters of a fleet: robots that differ from the others and parameters that drift, beyond natural scatter.

Robots of one type, and dates, differ by more than the std sigma of a fit.  The model of the logarithms of positive
parameters has random effects; its statistics are a robot's mean over its T dates, and the slope of its line over them:

.. math:: x_{rt} = \mu + u_r + b_r t + v_{rt} + e_{rt}, \qquad
          u_r \sim (0, \tau_u^2), \quad v_{rt} \sim (0, \tau_v^2), \quad e_{rt} \sim (0, \sigma_{rt}^2),

.. math:: t_r = \frac{\bar x_r - \mathrm{mean}_{s \ne r}\, \bar x_s}
          {\sqrt{\tau_u^2 + \sigma_r^2 + (\tau_u^2 + \overline{\sigma_s^2}) / (R - 1)}},
          \qquad t_{slope} = \hat b_r / \sigma_b .

The spread between robots is estimated without the tested robot.  Spreads of parameters of one kind, such as springs,
are moderated as the variances in the t test of Smyth (Statistical Applications in Genetics and Molecular Biology 3,
2004).  t has Student's distribution with the degrees of freedom of the spread.  The method of Benjamini and Hochberg
(Journal of the Royal Statistical Society B 57, 1995) limits the false discovery rate of all differences and trends.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from scipy.special import stdtr

from elastid.base.arrays import FloatArray

Kind: TypeAlias = Literal["differs", "drifts"]

# Meaning of a drift, by the letters of the parameter and whether it increases.
MEANINGS = {
    ("k", False): "the spring softens", ("b", True): "the backlash opens", ("Fc", True): "Coulomb friction grows",
    ("Fs", True): "stiction grows", ("f", True): "viscous friction grows", ("fm", True): "viscous friction grows",
    ("Fb", True): "running torque behind the gear grows", ("Fcl", True): "friction by load grows",
    ("H", True): "hysteresis grows", ("Hw", True): "hysteresis grows", ("lost", True): "lost motion grows",
    ("e", True): "transmission error grows", ("r", True): "ripple of the torque grows",
}  # fmt: skip

# Prior of the spread of stiffness between new gears of one type, 1 to 3 %, and its degrees of freedom. Of 200 fleets of
# 8 good robots with a spread of 1.5 %, 4 have a finding with three dates and 9 with one; a gear that is 10 % soft is
# found in 192 and 196 (scripts/studies/results.csv; among 64 robots in all, with a finding in 8).
NATURAL_STIFFNESS = 0.017
NATURAL_DOF = 6.0
# Most degrees of freedom by other parameters of the same kind, whose spreads are equal within a third.
MAX_SHARED_DOF = 8.0


@dataclass(frozen=True)
class FleetValue:
    """Parameter of a robot on a day, which is counted from an arbitrary date."""

    robot: str
    day: float
    parameter: str
    value: float
    std: float


@dataclass(frozen=True)
class Finding:
    """Robot whose parameter differs from the others', or drifts.

    change: from the mean of the others, or from first to last date; absolute unless is_relative.  z: over its std,
    which includes the natural spread.  p: probability of such a change without a difference.
    """

    kind: Kind
    robot: str
    parameter: str
    change: float
    is_relative: bool
    z: float
    p: float

    @property
    def meaning(self) -> str:
        """Kind of wear of a drifting spring, friction or backlash; empty for others."""
        return MEANINGS.get((_letters(self.parameter), self.z > 0), "") if self.kind == "drifts" else ""

    @property
    def sentence(self) -> str:
        """Finding as a sentence."""
        change = f"{self.change:+.2%}" if self.is_relative else f"{self.change:+.3g}"
        z = f"{self.z:+.{0 if abs(self.z) > 100 else 1}f}"
        if self.kind == "drifts":
            text = f"{self.meaning}, {change}" if self.meaning else change
            return f"{self.parameter} of {self.robot} drifts: {text} from the first date to the last ({z} std)"
        return f"{self.parameter} of {self.robot} is {change} off the mean of the others ({z} std)"


# Sum of squares in excess of the fits' variance, and its degrees of freedom.
_Excess: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class _Series:
    """Values x (T,) of a robot's parameter, or their logarithms, over T days, with variances and weighted mean.

    excess: of the differences between dates, from a line with more than two dates, from the mean with two.
    """

    robot: str
    day: FloatArray
    x: FloatArray
    variance: FloatArray
    mean: float
    variance_of_mean: float
    excess: _Excess


@dataclass(frozen=True)
class _Parameter:
    """Parameter with the series of R robots."""

    name: str
    is_relative: bool
    series: tuple[_Series, ...]

    def between_robots(self) -> _Excess:
        """Return the excess of the robots' means."""
        spread = np.var([s.mean for s in self.series], ddof=1) - np.mean([s.variance_of_mean for s in self.series])
        return float((len(self.series) - 1) * spread), len(self.series) - 1.0

    def between_dates(self, series: _Series | None = None) -> _Excess:
        """Return the excess of the dates, without the tested series if it has two dates only."""
        return _total_excess(s.excess for s in self.series if s is not series or len(s.day) > 2)


def find_changes(values: Sequence[FleetValue], false_discovery_rate: float) -> tuple[Finding, ...]:
    """Return the significant differences and trends, the most significant first; values without a std are ignored."""
    parameters = _parameters(values)
    tests = list[Finding]()
    for parameter in parameters:
        tests += (*_differences(parameter, parameters), *_trends(parameter, parameters))
    from scipy.stats import false_discovery_control  # slow to load, and rarely needed

    tests.sort(key=lambda finding: (finding.p, finding.parameter, finding.robot))
    rates = false_discovery_control([test.p for test in tests]) if tests else ()
    return tuple(test for test, rate in zip(tests, rates, strict=True) if rate <= false_discovery_rate)


def _parameters(values: Sequence[FleetValue]) -> list[_Parameter]:
    """Return the values with a std by parameter and robot; logarithms if all are positive."""
    measured = [value for value in values if math.isfinite(value.std) and value.std > 0]
    parameters = []
    for name in dict.fromkeys(value.parameter for value in measured):
        rows = [value for value in measured if value.parameter == name]
        is_relative = all(value.value > 0 for value in rows)
        robots = dict.fromkeys(value.robot for value in rows)
        series = tuple(_series([value for value in rows if value.robot == r], r, is_relative) for r in robots)
        parameters.append(_Parameter(name, is_relative, series))
    return parameters


def _series(values: Sequence[FleetValue], robot: str, is_relative: bool) -> _Series:
    day, x, std = (np.array([getattr(v, field) for v in values]) for field in ("day", "value", "std"))
    variance = (std / x) ** 2 if is_relative else std**2
    x = np.log(x) if is_relative else x
    sum_of_squares, dof = 0.0, 0.0
    if len(x) > 1 and np.ptp(day) > 0:
        A = np.column_stack([np.ones_like(day), (day - day[0]) / np.ptp(day)])[:, : 1 + (len(x) > 2)]
        H = A @ np.linalg.pinv(A)
        e = x - H @ x
        sum_of_squares, dof = float(e @ e - variance @ (1 - np.diag(H))), float(len(x) - A.shape[1])
    mean_variance = float(1 / np.sum(1 / variance))
    mean = mean_variance * float(np.sum(x / variance))
    return _Series(robot, day, x, variance, mean, mean_variance, (sum_of_squares, dof))


def _differences(parameter: _Parameter, parameters: Iterable[_Parameter]) -> list[Finding]:
    """Return the test of each robot's mean against the others' means."""
    if len(parameter.series) < 3:  # of two robots, each may be the different one
        return []
    kind_excess = [p.between_robots() for p in _same_kind(parameter, parameters) if len(p.series) > 1]
    if parameter.is_relative and _letters(parameter.name) == "k":
        kind_excess.append((NATURAL_DOF * NATURAL_STIFFNESS**2, NATURAL_DOF))
    findings = []
    for s in parameter.series:
        others = tuple(peer for peer in parameter.series if peer is not s)
        spread, dof = _moderated(replace(parameter, series=others).between_robots(), kind_excess)
        mean, variance = np.mean([(peer.mean, peer.variance_of_mean) for peer in others], axis=0)
        std = math.sqrt(spread + s.variance_of_mean + (spread + variance) / len(others))
        findings.append(_finding("differs", s.robot, parameter, s.mean - float(mean), std, dof))
    return findings


def _trends(parameter: _Parameter, parameters: Iterable[_Parameter]) -> list[Finding]:
    """Return the test of the slope of each robot with two or more dates."""
    kind_excess = [p.between_dates() for p in _same_kind(parameter, parameters)]
    findings = []
    for s in parameter.series:
        (spread, dof), span = _moderated(parameter.between_dates(s), kind_excess), float(np.ptp(s.day))
        if span == 0 or not dof:  # the spread between dates is unknown
            continue
        w = 1 / (s.variance + spread)
        centred = s.day - float(w @ s.day) / w.sum()
        information = float(w @ centred**2)
        change = float((w * centred) @ s.x) / information * span
        findings.append(_finding("drifts", s.robot, parameter, change, span / math.sqrt(information), dof))
    return findings


def _total_excess(excesses: Iterable[_Excess]) -> _Excess:
    sums, dofs = zip((0.0, 0.0), *excesses, strict=True)
    return sum(sums), sum(dofs)


def _moderated(excess: _Excess, kind_excess: Iterable[_Excess]) -> tuple[float, float]:
    """Return variance and dof of an excess moderated by its kind's, which has at most `MAX_SHARED_DOF`."""
    total, dof = _total_excess(kind_excess)
    weight = min(1.0, MAX_SHARED_DOF / dof) if dof else 0.0
    total, dof = _total_excess([excess, (weight * total, weight * dof)])
    return (max(total / dof, 0.0) if dof else 0.0), dof


def _same_kind(parameter: _Parameter, parameters: Iterable[_Parameter]) -> list[_Parameter]:
    letters = _letters(parameter.name)
    others = (p for p in parameters if p is not parameter and p.is_relative and parameter.is_relative)
    return [p for p in others if _letters(p.name) == letters]


def _letters(name: str) -> str:
    """Return the kind of a parameter by its name: k of k_1, e of e2_1."""
    letters = name.partition("_")[0]
    return letters[0] if letters[0] in "er" and letters[1:].replace(".", "").isdigit() else letters


def _finding(kind: Kind, robot: str, parameter: _Parameter, difference: float, std: float, dof: float) -> Finding:
    z, change = difference / std, math.expm1(difference) if parameter.is_relative else difference
    p = float(2 * stdtr(dof or math.inf, -abs(z)))
    return Finding(kind, robot, parameter.name, change, parameter.is_relative, z, p)
