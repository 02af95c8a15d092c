r"""The measurement chain around the mechanics: factors of torque loop, sensors and filters in a response.

.. math:: H(s) = \frac{1}{P_\tau(s T_\tau)} \cdot \frac{1}{P_y(s T_y)} \cdot \frac{1 - e^{-s T_\Delta}}{s T_\Delta}

Each element has one number with a name, which a fit may keep or find: torque_lag (T_tau), sensor_lag (T_y),
differentiator (T_Delta). The torque delay is always there, under the name `delay`.
"""

from __future__ import annotations

from typing import Literal

from elastid.base.section import section
from elastid.base.units import Time
from elastid.robot.named_numbers import Numbers


@section
class Chain:
    """Elements between torque command and logged motion; those without a number are not there.

    torque_lag: time constant of the torque loop.  torque_order: 1, or 2 with torque_damping.  torque_damping: damping
    ratio of a torque loop of second order.
    sensor_lag: time constant 1 / (2 pi corner) of the low-pass filter of the logged motions.  sensor_order: of that
    filter, a Butterworth filter.  differentiator: time over which a logged velocity is the difference of positions.
    """

    torque_lag: Time | None = None
    torque_order: Literal[1, 2] = 1
    torque_damping: float = 0.7
    sensor_lag: Time | None = None
    sensor_order: Literal[1, 2, 3, 4] = 1
    differentiator: Time | None = None

    def __post_init__(self) -> None:
        """Refuse times and damping that are not positive."""
        for name in ("torque_lag", "sensor_lag", "differentiator"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} is {value:g} s; it must be positive (leave it out where there is none)")
        if not self.torque_damping > 0:
            raise ValueError(f"torque_damping is {self.torque_damping:g}; it must be positive")

    @property
    def numbers(self) -> Numbers:
        """The time constant of each element that is present."""
        names = ("torque_lag", "sensor_lag", "differentiator")
        return {name: ("s", (name,)) for name in names if getattr(self, name) is not None}
