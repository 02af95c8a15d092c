"""Rehearsal: one whole run of the nominal robot, from standstill to standstill."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.label import labelled
from elastid.experiment.plan.plan import Experiment


@frozen_value
class Rehearsal:
    """Motor angles and torques (n, n_u) of a whole run, rad and Nm, link side; its periods begin at first_sample."""

    experiment: Experiment
    rate_hz: float
    first_sample: int
    position: FloatArray = labelled("angle of each motor, link side", "rad", "time_s inputs")
    torque: FloatArray = labelled("torque of each motor, link side", "N*m", "time_s inputs")

    @property
    def time_s(self) -> FloatArray:
        """Time (n,), 0 where the periods begin."""
        return np.asarray((np.arange(len(self.torque)) - self.first_sample) / self.rate_hz)

    @property
    def signals(self) -> FloatArray:
        """(4, n, n_u): torque, position about the configuration, velocity, acceleration, in the order of the limits."""
        motion = self.position - self.experiment.configuration.angles, *derivatives(self.position, self.rate_hz)
        return np.array([self.torque, *motion])


def derivatives(x: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """First and second derivative (n, c) of x (n, c), of sixth order; the run begins and ends at rest."""
    padded = np.pad(x, ((3, 3), (0, 0)), mode="edge")
    f = [padded[i : i + len(x)] for i in range(7)]
    first = (45 * (f[4] - f[2]) - 9 * (f[5] - f[1]) + f[6] - f[0]) * (rate_hz / 60)
    second = (2 * (f[6] + f[0]) - 27 * (f[5] + f[1]) + 270 * (f[4] + f[2]) - 490 * f[3]) * (rate_hz**2 / 180)
    return first, second
