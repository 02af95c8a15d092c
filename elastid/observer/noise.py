"""The noise that a filter reckons with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.observer.joint import FollowedJoint

# How far the bristle's deflection may be off for each length z_s = F_c / sigma_0 that it has slipped, as a random walk:
# a filter that takes its bristle for certain gets F_c wrong at every stop.
SLIP_NOISE = 0.1


@dataclass(frozen=True)
class FilterNoise:
    """Standard deviations of what a filter does not know, one side of the gear, SI.

    angle: of a sample of the motor's angle; encoder counts have count / sqrt(12).  torque: white, of a sample.
    correlated: of w, in torque.  link: of a sample of the link's torque.  drift: of what is followed, in a root second;
    of the logarithms relative.  slip: of the bristle in z_s, for each z_s of slip.
    """

    angle: float
    torque: float
    correlated: float = 0.0
    link: float = 0.0
    drift: Mapping[str, float] = field(default_factory=dict)
    slip: float = SLIP_NOISE

    def vector(self, joint: FollowedJoint, rate_hz: float) -> FloatArray:
        """The arguments (5 + n_followed,) of a filter's step: variances of a sample."""
        fade = math.exp(-2 / (rate_hz * joint.correlation_s)) if joint.correlation_s > 0 else 1.0
        drift = [self.drift.get(name, 0.0) ** 2 / rate_hz for name in joint.followed]
        return np.array(
            [self.angle**2, self.torque**2, self.correlated**2 * (1 - fade), self.link**2, self.slip**2, *drift]
        )

    def scaled(self, **factors: float) -> FilterNoise:
        """With some of angle, torque, correlated, link multiplied by factors."""
        return replace(self, **{name: getattr(self, name) * factor for name, factor in factors.items()})
