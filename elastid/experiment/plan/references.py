r"""Reference trajectories: what a robot controller is told for a whole run, at its rate.

.. math:: u_{ff} = T^T [M(q) T \ddot q_{ref} + f(q, T \dot q_{ref})], \qquad r(t) = s(t)\, r_{period}(t \bmod T)

The feed-forward torque is that of the rigid nominal robot on the reference; the injected torque is the experiment's
period, repeated, under the ramp s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, frozen
from elastid.experiment.plan.movement import movement
from elastid.experiment.plan.plan import Plan
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.linear.equilibrium import equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward


@dataclass(frozen=True)
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

    def __post_init__(self) -> None:
        """Freeze."""
        for name in ("position", "velocity", "acceleration", "feed_forward", "scale"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def injected(self, period: FloatArray) -> FloatArray:
        """r (n, n_u) of a whole run from one period (N, n_u) of torque."""
        sample = np.arange(-self.first_sample, len(self.scale) - self.first_sample)
        r: FloatArray = self.scale[:, None] * period[sample % len(period)]
        return r


def references(plan: Plan, carrier: CarrierSpec | None, robot: Robot) -> tuple[Reference, ...]:
    """The references of all configurations of a plan, with the nominal robot's feed-forward torque."""
    model = formulate(robot)
    rest = (equilibrium(model, model.theta, configuration).q for configuration in plan.configurations)
    return tuple(reference(plan, carrier, model, q0, c) for q0, c in zip(rest, plan.configurations, strict=True))


def reference(
    plan: Plan, carrier: CarrierSpec | None, model: ElasticModel, q0: FloatArray, configuration: Configuration
) -> Reference:
    """The reference of a configuration whose equilibrium is q0 (n_q,)."""
    path = movement(carrier, plan)
    motion = path.position, path.velocity, path.acceleration
    if carrier is None:
        # One sample says it all.
        torque = np.broadcast_to(feed_forward(model, q0, *(signal[:1] for signal in motion)), path.position.shape)
    else:
        torque = feed_forward(model, q0, *motion)
    position = configuration.angles + path.position
    return Reference(
        configuration, plan.rate_hz, plan.first_sample, position, path.velocity, path.acceleration, torque, path.scale
    )
