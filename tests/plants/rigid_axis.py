"""A rigid axis with Coulomb friction, simulated by a leapfrog."""

import numpy as np

from elastid.base.arrays import FloatArray

TRUTH = {"inertia": 6.0, "viscous": 20.0, "coulomb": 12.0}
STEP_S, DURATION_S, TORQUE_STD, COUNTS = 5e-4, 64.0, 0.5, 2**20


def simulated(
    draws: int, rng: np.random.Generator, duration_s: float = DURATION_S, coulomb: float = TRUTH["coulomb"]
) -> tuple[FloatArray, FloatArray]:
    """Angle and torque (n, draws) every STEP_S."""
    t = np.arange(round(duration_s / STEP_S)) * STEP_S
    freq_hz, phase = rng.uniform(0.1, 1.5, (5, draws)), rng.uniform(0, 2 * np.pi, (5, draws))
    size = rng.uniform(0.1, 0.4, (5, draws)) / freq_hz**0.7
    reference = sum(a * np.sin(2 * np.pi * np.outer(t, f) + p) for a, f, p in zip(size, freq_hz, phase, strict=True))
    speed = np.gradient(reference, STEP_S, axis=0)
    q, v = reference[0].copy(), speed[0].copy()
    damping = TRUTH["viscous"] * STEP_S / (2 * TRUTH["inertia"])
    angle, torque = np.empty(reference.shape), np.empty(reference.shape)
    for i in range(len(t)):
        u = 4000 * (reference[i] - q) + 300 * (speed[i] - v)
        angle[i], torque[i] = q, u
        free = (1 - damping) * v + u * STEP_S / TRUTH["inertia"]
        # Coulomb friction takes momentum until there is none.
        v = np.sign(free) * np.maximum(np.abs(free) - coulomb * STEP_S / TRUTH["inertia"], 0) / (1 + damping)
        q = q + STEP_S * v
    return angle, torque
