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
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    feed_forward: FloatArray
    scale: FloatArray

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
