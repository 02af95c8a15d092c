"""Two axes under gravity that move together, as logs with friction and correlated noise."""

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_study.motion_signals import Motion
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import Body, Joint, Motor, Placement, Robot

RATE, RATIO = 250.0, 100.0
COULOMB, VISCOUS = (9.0, 5.0), (14.0, 6.0)


def two_axes() -> Robot:
    """Two axes under gravity; the second is at the end of an arm of the first."""
    motor = Motor(inertia=1e-3, ratio=RATIO)
    arm = {"mass": 12.0, "center_of_mass": (0.3, 0.05, 0.0), "inertia": (0.1, 0.5, 0.5)}
    upper = Body("upper", joints=(Joint("1", "y", motor=motor),), **arm)  # type: ignore[arg-type]
    lower = Body(
        "lower", "upper", Placement((0.6, 0.0, 0.0)), joints=(Joint("2", "y", motor=motor),), **arm  # type: ignore[arg-type]
    )  # fmt: skip
    return Robot(name="two axes", bodies=(upper, lower))


def motion(seed: int, noise: float = 0.5, missing: float = 0.0) -> dict[str, Motion]:
    """20 s of both axes, torque noise correlated over 0.1 s; missing: Nm of a spring that no rigid body has."""
    rng, robot = np.random.default_rng(seed), two_axes()
    t = np.arange(round(20 * RATE)) / RATE
    w = 2 * np.pi * np.array([0.15, 0.4, 0.7])
    phase, size = rng.uniform(0, 6, (2, 3, 1)), np.array([0.5, 0.25, 0.1])[:, None]
    q, v, a = (
        np.sum(factor * np.sin(w[:, None] * t + phase + shift), axis=1)
        for factor, shift in ((size, 0.0), (size * w[:, None], np.pi / 2), (-size * w[:, None] ** 2, 0.0))
    )
    theta = np.array([value for value, _ in robot.parameters().values()])
    rigid = inverse_dynamics(robot)(q, v, a, np.tile(theta[:, None], len(t))).full()
    rubbing = np.array(COULOMB)[:, None] * np.sign(v) + np.array(VISCOUS)[:, None] * v
    slow = np.array(
        [np.convolve(row, np.exp(-np.arange(100) / 25), "same") / 4 for row in rng.standard_normal(q.shape)]
    )
    torque: FloatArray = rigid + rubbing + noise * slow + missing * np.sin(5 * q)
    return {name: Motion(f"joint {name}", RATE, q[i], torque[i]) for i, name in enumerate(("1", "2"))}
