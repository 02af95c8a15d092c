"""Limits of the motors that a move keeps, link side, and where a motion comes nearest to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.robot import Robot


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
        names = ("velocity", "acceleration", "jerk", "torque")
        return cls(angle, *(np.array([getattr(each, name) for each in limits], float) for name in names))

    def narrowed(self, part: FloatArray) -> MotionLimits:
        """With a part (n_u,) of the torque."""
        return replace(self, torque=self.torque * part)
