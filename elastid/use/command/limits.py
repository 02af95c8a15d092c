"""Limits of the motors that a move keeps, link side, and which of them a motion comes nearest to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.units import of_translation
from elastid.robot import Robot

KINDS = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "torque": "N*m"}


@frozen_value
class MotionLimits:
    """angle (n_u, 2), velocity, acceleration, jerk, torque (n_u,): link side, infinite where there is none."""

    angle: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    torque: FloatArray

    @classmethod
    def of(cls, robot: Robot) -> MotionLimits:
        """Those of the driven joints."""
        limits = [joint.limits for joint in robot.driven]
        angle = np.array([each.angle for each in limits], float)
        return cls(angle, *(np.array([getattr(each, kind) for each in limits], float) for kind in KINDS))

    @property
    def range(self) -> tuple[FloatArray, FloatArray]:
        """Middle and half width (n_u,) of the angles; 0 and infinite where one end is free."""
        finite = np.asarray(np.isfinite(self.angle).all(axis=1))
        low, high = np.where(finite[:, None], self.angle, 0.0).T
        return (low + high) / 2, np.where(finite, (high - low) / 2, np.inf)

    def narrowed(self, parts: dict[str, FloatArray]) -> MotionLimits:
        """With a part (n_u,) of each kind that is named."""
        return replace(self, **{kind: getattr(self, kind) * part for kind, part in parts.items()})


@frozen_value(eq=False)
class References:
    """Motion of the motors and torque at them at even times (N,) in s, link side, each (N, n_u).

    torque: feedforward, held from each time to the next.
    """

    time_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    torque: FloatArray

    @property
    def rate_hz(self) -> float:
        """Samples in a second."""
        return float((len(self.time_s) - 1) / (self.time_s[-1] - self.time_s[0]))

    def use(self, limits: MotionLimits) -> dict[str, FloatArray]:
        """Part (N, n_u) of each limit that is used, 0 where there is none."""
        used = {kind: np.abs(getattr(self, kind)) / getattr(limits, kind) for kind in KINDS}
        middle, reach = limits.range
        return {"angle": np.abs(self.position - middle) / reach, **used}


@dataclass(frozen=True)
class NearestLimit:
    """A limit that a motion uses most: its kind, the joint, value and unit, and the part of it that is used."""

    kind: str
    joint: str
    limit: float
    unit: str
    used: float

    def __str__(self) -> str:
        return f"the {self.kind} of joint {self.joint} uses {100 * self.used:.0f} % of {self.limit:.4g} {self.unit}"


def nearest_limit(
    robot: Robot, limits: MotionLimits, references: References, within: slice = slice(None)
) -> NearestLimit | None:
    """The limit that the samples `within` use most; None for a robot without limits."""
    used = {kind: part[within].max(axis=0, initial=0.0) for kind, part in references.use(limits).items()}
    kind = max(used, key=lambda name: float(used[name].max()))
    place = int(np.argmax(used[kind]))
    if not used[kind][place] > 0:
        return None
    joint = robot.driven[place]
    if kind == "angle":
        beyond = references.position[within, place] - limits.range[0][place]
        limit = float(limits.angle[place, int(beyond[np.argmax(np.abs(beyond))] > 0)])
    else:
        limit = float(getattr(limits, kind)[place])
    unit = joint.unit if kind == "angle" else of_translation(KINDS[kind]) if joint.slides else KINDS[kind]
    return NearestLimit(kind, joint.name, limit, unit, float(used[kind][place]))
