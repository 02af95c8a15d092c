"""Levels: what friction takes at steady sliding, one number for each speed, direction, load and temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.friction.static_terms import Conditions


@frozen_value
class Levels:
    """Friction of one place at n conditions, each at steady sliding; numbers on the side of the place, SI.

    speed (n,): |v|, positive.  direction (n,): 1, -1, or 0 where the level is the mean of both directions.
    torque (n,): that brakes, positive, viscous friction included.  std (n,): of torque.  load (n,): |torque| on the
    joint, 0 where none is known.  temperature (n,): degC, NaN where none is known.

    Raises ValueError where shapes disagree, DataError for a level that cannot be: a speed of zero, no std, friction
    that drives at every condition.
    """

    place: str
    speed: FloatArray
    direction: FloatArray
    torque: FloatArray
    std: FloatArray
    load: FloatArray
    temperature: FloatArray
    slides: bool = False

    def __post_init__(self) -> None:
        """Check shapes and signs."""
        columns = (self.speed, self.direction, self.torque, self.std, self.load, self.temperature)
        if len({column.shape for column in columns}) != 1 or self.speed.ndim != 1:
            raise ValueError(f"levels of {self.place}: shapes {[column.shape for column in columns]} are not all (n,)")
        for name, column in (("speed", self.speed), ("std", self.std)):
            wrong = np.flatnonzero(~(np.isfinite(column) & (column > 0)))
            if len(wrong):
                raise DataError(
                    f"levels of {self.place}: {name} of level {wrong[0]} is {column[wrong[0]]:g}; it must be positive: "
                    "leave that level out, or state what is known of it"
                )
        if len(self.torque) and np.all(self.torque < 0):
            raise DataError(
                f"levels of {self.place}: friction drives at every speed (torque {self.torque.min():.4g} to "
                f"{self.torque.max():.4g}): torque and velocity have opposite signs; turn one channel (sign: -1)"
            )

    @property
    def n_levels(self) -> int:
        """Number of conditions."""
        return len(self.speed)

    @property
    def conditions(self) -> Conditions:
        """At which the levels stand."""
        return Conditions(self.speed, self.direction, self.load, self.temperature)

    def select(self, chosen: BoolArray) -> Levels:
        """The conditions that are chosen (n,)."""
        return replace(
            self,
            speed=self.speed[chosen],
            direction=self.direction[chosen],
            torque=self.torque[chosen],
            std=self.std[chosen],
            load=self.load[chosen],
            temperature=self.temperature[chosen],
        )
