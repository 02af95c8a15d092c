r"""Reference trajectories of a robot controller for a whole run, at its rate.

.. math:: u_{ff} = T^T [M(q) T \ddot q_{ref} + f(q, T \dot q_{ref})], \qquad r(t) = s(t)\, r_{period}(t \bmod T)

The feed-forward torque is that of the rigid nominal robot on the reference and is an argument here; the injected torque
is the experiment's period, repeated, under the ramp s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.label import labelled
from elastid.experiment.plan.movement import Movement, movement
from elastid.experiment.plan.plan import Plan
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration

# Torque (n, n_u) of the rigid robot on a movement of n samples about a configuration.
FeedForward: TypeAlias = Callable[[Configuration, Movement], FloatArray]


@frozen_value
class Reference:
    """One whole run in one configuration, each (n, n_u): rad, rad/s, rad/s^2, Nm, link side; scale (n,), 0 to 1.

    The injected torque at sample i is scale[i] times the experiment's period at (i - first_sample) mod N.
    """

    configuration: Configuration
    rate_hz: float
    first_sample: int
    position: FloatArray = labelled("position of each motor, link side", "rad", "time_s inputs")
    velocity: FloatArray = labelled("velocity of each motor, link side", "rad/s", "time_s inputs")
    acceleration: FloatArray = labelled("acceleration of each motor, link side", "rad/s^2", "time_s inputs")
    feed_forward: FloatArray = labelled("feed-forward torque of each motor, link side", "N*m", "time_s inputs")
    scale: FloatArray = labelled("factor on the torque of the experiment, 0 at rest", "", "time_s")

    def injected(self, period: FloatArray) -> FloatArray:
        """r (n, n_u) of a whole run from one period (N, n_u) of torque."""
        sample = np.arange(-self.first_sample, len(self.scale) - self.first_sample)
        return np.asarray(self.scale[:, None] * period[sample % len(period)])


def reference(
    plan: Plan, carrier: CarrierSpec | None, feed_forward: FeedForward, configuration: Configuration
) -> Reference:
    """The reference of one configuration."""
    path = movement(carrier, plan)
    # At rest all samples are the same.
    torque = feed_forward(configuration, path if carrier is not None else path.first)
    return Reference(
        configuration,
        plan.rate_hz,
        plan.first_sample,
        configuration.angles + path.position,
        path.velocity,
        path.acceleration,
        np.broadcast_to(torque, path.position.shape),
        path.scale,
    )
