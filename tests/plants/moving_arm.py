"""The arm with rigid gears, whose axes move together, as logs with friction and correlated noise."""

import numpy as np

from elastid.friction_study.motion_signals import Motion
from elastid.model.rigid_body import inverse_dynamics
from plants.arm import robot

RATE = 250.0
COULOMB, VISCOUS = (9.0, 5.0), (14.0, 6.0)
ARM = robot(damping=None)


def motion(seed: int, noise: float = 0.5, missing: float = 0.0) -> dict[str, Motion]:
    """20 s of both axes, torque noise correlated over 0.1 s; missing: Nm of a spring that no rigid body has."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(20 * RATE)) / RATE
    w = 2 * np.pi * np.array([0.15, 0.4, 0.7])
    phase, size = rng.uniform(0, 6, (2, 3, 1)), np.array([0.5, 0.25, 0.1])[:, None]
    q, v, a = (
        np.sum(factor * np.sin(w[:, None] * t + phase + shift), axis=1)
        for factor, shift in ((size, 0.0), (size * w[:, None], np.pi / 2), (-size * w[:, None] ** 2, 0.0))
    )
    theta = np.array([value for value, _ in ARM.parameters().values()])
    rigid = inverse_dynamics(ARM)(q, v, a, np.tile(theta[:, None], len(t))).full()
    rubbing = np.array(COULOMB)[:, None] * np.sign(v) + np.array(VISCOUS)[:, None] * v
    slow = np.array(
        [np.convolve(row, np.exp(-np.arange(100) / 25), "same") / 4 for row in rng.standard_normal(q.shape)]
    )
    torque = rigid + rubbing + noise * slow + missing * np.sin(5 * q)
    return {name: Motion(f"joint {name}", RATE, q[i], torque[i]) for i, name in enumerate(("1", "2"))}
