"""An elastic joint with LuGre friction at its motor, at rest."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.simulation.elastic_joint import FRICTION, ElasticJoint

JOINT = ElasticJoint(0.01, 0.02, 800.0, 0.3)
TRUTH = {
    "sigma_0": 300.0, "sigma_1": 0.5, "coulomb": 1.0, "stiction": 1.5, "stribeck_velocity": 8.0, "viscous": 5e-3,
}  # fmt: skip
RATE, COUNT = 1000.0, 2 * np.pi / 2**16


@lru_cache(maxsize=4)
def walk(n: int, substeps: int) -> ca.Function:
    """(x_0 (5,), numbers (6, n), torque (1, n)) -> states (5, n)."""
    return JOINT.step(RATE, substeps).mapaccum("walk", n)


def angle(torque: FloatArray, substeps: int = 8) -> FloatArray:
    """The motor's angle (n,) at the end of each sample, from rest; torque (n,) held from sample to sample."""
    p = np.tile(np.array([TRUTH[name] for name in FRICTION])[:, None], len(torque))
    return np.asarray(walk(len(torque), substeps)(np.zeros(5), p, torque[None]).full()[0])
