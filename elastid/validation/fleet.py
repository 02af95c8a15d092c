r"""Parameters over a fleet: which robots differ from the others, and which numbers drift, beyond their intervals.

.. math:: z_r = \frac{\bar x_r - \mathrm{med}_s\, \bar x_s}
          {\sqrt{\sigma_r^2 + \tfrac{\pi}{2} \overline{\sigma_s^2} / R}}, \qquad z_{slope} = \hat b / \sigma_b

of the logarithms of positive parameters, with the weighted mean over a robot's dates and a weighted line over them. The
median is of all R robots, so that one odd robot of three does not make the others odd; since the robot itself is one of
them, the std is a little too large, never too small.
The false discovery rate of all differences and trends together is held by Benjamini and Hochberg (Journal of the Royal
Statistical Society B 57, 1995).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.stats import norm

from elastid.base.arrays import FloatArray

Kind: TypeAlias = Literal["differs", "drifts"]

# Meaning of a drift, by the letters of the parameter and whether it grows.
MEANINGS = {
    ("k", False): "the spring softens",
    ("b", True): "the backlash opens",
    ("Fc", True): "Coulomb friction grows",
    ("Fs", True): "stiction grows",
    ("f", True): "viscous friction grows",
    ("fm", True): "viscous friction grows",
}


@dataclass(frozen=True)
class FleetValue:
    """A parameter of a robot on a day, counted from any first one."""

    robot: str
    day: float
    parameter: str
    value: float
    std: float


@dataclass(frozen=True)
class Finding:
    """A robot whose parameter differs from the others', or drifts.

    change: relative to the median, or from first to last date; where a parameter is not positive absolute.
    z: over its std.  p: chance of as much without a difference.
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
        """The kind of wear where a spring, a friction or a backlash drifts; empty for others."""
        return MEANINGS.get((self.parameter.partition("_")[0], self.z > 0), "") if self.kind == "drifts" else ""

    @property
    def words(self) -> str:
        """The finding in a sentence."""
        size = f"{self.change:+.2%}" if self.is_relative else f"{self.change:+.3g}"
        if self.kind == "drifts":
            how = f"{self.meaning}, {size}" if self.meaning else size
            return f"{self.parameter} of {self.robot} drifts: {how} from the first date to the last ({self.z:+.1f} std)"
        return f"{self.parameter} of {self.robot} is {size} off the median of the fleet ({self.z:+.1f} std)"


def find_changes(values: Sequence[FleetValue], false_discovery_rate: float) -> tuple[Finding, ...]:
    """Differences and trends, the surest first.  Numbers without a std are left out."""
    known = [value for value in values if math.isfinite(value.std) and value.std > 0]
    names = list(dict.fromkeys(value.parameter for value in known))
    tests: list[Finding] = []
    for name in names:
        own = [value for value in known if value.parameter == name]
        tests += [*_differences(name, own), *_trends(name, own)]
    tests.sort(key=lambda finding: (finding.p, finding.parameter, finding.robot))
    # Those with a p up to the largest p_(i) <= rate i / n.
    ends = [i for i, test in enumerate(tests, start=1) if test.p <= false_discovery_rate * i / len(tests)]
    return tuple(tests[: max(ends, default=0)])


def _differences(name: str, values: Sequence[FleetValue]) -> list[Finding]:
    """Every robot against the median of all."""
    robots = list(dict.fromkeys(value.robot for value in values))
    if len(robots) < 3:  # of two, either may be the odd one
        return []
    is_relative = all(value.value > 0 for value in values)
    means = np.array([_mean([v for v in values if v.robot == robot], is_relative) for robot in robots])
    off = means[:, 0] - np.median(means[:, 0])
    std = np.sqrt(means[:, 1] + math.pi / 2 * means[:, 1].mean() / len(robots))
    return [
        _finding("differs", robot, name, change, deviation, is_relative)
        for robot, change, deviation in zip(robots, off.tolist(), std.tolist(), strict=True)
    ]


def _trends(name: str, values: Sequence[FleetValue]) -> list[Finding]:
    """The line over its dates of every robot that has two."""
    is_relative = all(value.value > 0 for value in values)
    findings = []
    for robot in dict.fromkeys(value.robot for value in values):
        own = [value for value in values if value.robot == robot]
        x, variance = _numbers(own, is_relative)
        day = np.array([value.day for value in own])
        if np.ptp(day) == 0:
            continue
        w = 1 / variance
        centred = day - float(w @ day) / w.sum()
        information = float(w @ centred**2)
        span = float(np.ptp(day))
        slope = float((w * centred) @ x) / information
        findings.append(_finding("drifts", robot, name, slope * span, span / math.sqrt(information), is_relative))
    return findings


def _mean(values: Sequence[FleetValue], is_relative: bool) -> tuple[float, float]:
    """Weighted mean over dates and its variance."""
    x, variance = _numbers(values, is_relative)
    total = np.sum(1 / variance)
    return float(np.sum(x / variance) / total), float(1 / total)


def _numbers(values: Sequence[FleetValue], is_relative: bool) -> tuple[FloatArray, FloatArray]:
    """Numbers (n,) or their logarithms, and variances."""
    x, std = np.array([value.value for value in values]), np.array([value.std for value in values])
    return (np.log(x), (std / x) ** 2) if is_relative else (x, std**2)


def _finding(kind: Kind, robot: str, name: str, off: float, std: float, is_relative: bool) -> Finding:
    z, change = off / std, math.expm1(off) if is_relative else off
    return Finding(kind, robot, name, change, is_relative, z, float(2 * norm.sf(abs(z))))
