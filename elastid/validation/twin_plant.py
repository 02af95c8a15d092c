"""A twin as a plant that is simulated: the identified robot, and the same without friction, driven alike."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.experiment.simulated.plant import Plant, exact_plant
from elastid.linear.equilibrium import OperatingPoint
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import Gains, rigid_motion, tune

# Of a log this much is simulated at most.
LONGEST_S = 30.0
# The loop about a logged motion is damped critically, so that it adds no resonance.
HELD_DAMPING_RATIO = 1.0
# Of motors whose torque is not in the log.
RESTING_HZ = 5.0


@dataclass(frozen=True)
class TwinPlant:
    """A robot at rest where its log begins, as equations, with exact drives and encoders and without limits."""

    plant: Plant
    point: OperatingPoint

    @classmethod
    def of(cls, robot: Robot, rate_hz: float, start: Configuration, spec: ModelSpec = EXACT) -> TwinPlant:
        """With as many steps a sample as its fastest pole takes; StudyError where it finds no rest."""
        plant, point = exact_plant(robot, spec, rate_hz, start)
        free = np.tile([-np.inf, np.inf], (plant.model.n_u, 1))
        return cls(Plant(plant.model, replace(plant.loop, limits=free)), point)

    def holding_gains(self, bandwidth_hz: float) -> Gains:
        """Of a loop about the logged motion."""
        return tune(self.plant.model, self.point.q, bandwidth_hz, HELD_DAMPING_RATIO)

    def gains(self, moving: BoolArray, held: Gains) -> Gains:
        """Those of `held` for motors that move (n_u,), of a loop of RESTING_HZ for the others."""
        resting = self.holding_gains(RESTING_HZ)
        return Gains(*(np.where(moving, getattr(held, name), getattr(resting, name)) for name in ("kp", "kd", "ki")))

    def moved(self, gains: Gains, commands: Commands, velocity: FloatArray) -> Trajectory:
        """The motion from rest of the springs, the motors at this velocity (n_u,); DataError where a motor is lost."""
        return self.moved_from(gains, commands, self.point.q, rigid_motion(self.plant.model, self.point.q) @ velocity)

    def moved_from(self, gains: Gains, commands: Commands, q: FloatArray, v: FloatArray) -> Trajectory:
        """The motion from q, v (n_q,)."""
        return simulate(self.plant.loop, gains, commands, q, v0=v)
