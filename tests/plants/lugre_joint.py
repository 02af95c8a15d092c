"""An elastic joint with LuGre friction at its motor, at rest."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.dynamic import Bristle
from elastid.friction.static import Curve
from elastid.model.formulation import ElasticJoint
from elastid.simulation.dynamics import runge_kutta_step

JOINT = ElasticJoint(0.01, 0.02, 800.0, 0.3)
TRUTH = {
    "sigma_0": 300.0, "sigma_1": 0.5, "coulomb": 1.0, "stiction": 1.5, "stribeck_velocity": 8.0, "viscous": 5e-3,
}  # fmt: skip
RATE, COUNT = 1000.0, 2 * np.pi / 2**16


@lru_cache(maxsize=4)
def walk(n: int, substeps: int) -> ca.Function:
    """(x_0 (5,), numbers (6, n), torque (1, n)) -> states (5, n): angles and velocities of motor and link, bristles."""
    x, p, u = ca.SX.sym("x", 5), ca.SX.sym("p", 6), ca.SX.sym("u")
    sigma_0, sigma_1, F_c, F_s, nu_s, viscous = ca.vertsplit(p)
    law, curve = Bristle(sigma_0, sigma_1), Curve(F_c, F_s, 1 / nu_s)

    def acceleration(q: ca.SX, v: ca.SX, z: ca.SX, torque: ca.SX) -> ca.SX:
        spring = JOINT.stiffness * (q[0] - q[1]) + JOINT.damping * (v[0] - v[1])
        friction = law.torque(v[0], z, curve) + viscous * v[0]
        return ca.vertcat((torque - friction - spring) / JOINT.motor_inertia, spring / JOINT.link_inertia)

    q, v, z, step = x[:2], x[2:4], x[4], 1 / RATE / substeps
    for _ in range(substeps):
        q, v, z = runge_kutta_step(
            acceleration, lambda z, v, step: law.advanced(v[0], z, curve, step), q, v, z, [u] * 4, step
        )
    return ca.Function("step", [x, p, u], [ca.vertcat(q, v, z)]).mapaccum(n)


def angle(torque: FloatArray, substeps: int = 8) -> FloatArray:
    """The motor's angle (n,) at the end of each sample, from rest; torque (n,) held from sample to sample."""
    p = np.tile(np.array([*TRUTH.values()])[:, None], len(torque))
    return np.asarray(walk(len(torque), substeps)(np.zeros(5), p, torque[None]).full()[0])
