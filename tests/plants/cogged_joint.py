"""A joint whose cogging makes the speed of its passes wander, with equations and an integrator of its own.

J q'' = u - c cos(h N q + phi) - G cos q
        - (F_c + a cos(N q - phi) + (F_s - F_c) e^(-(q'/nu)^2)) sgn q' - (f + d sgn q') q' by a leapfrog,
Coulomb friction taking momentum until there is none, under a PD controller with a filtered reference of trapezoids.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_record import FrictionRecord

RATE, RATIO, COUNTS = 500.0, 100.0, 65536


@dataclass(frozen=True)
class CoggedJoint:
    """SI, link side; harmonic: of the motor's turns.  dry: Coulomb friction by its turn.  bandwidth_hz: of the loop."""

    inertia: float = 20.0
    coulomb: float = 114.6
    stiction: float = 130.0
    stribeck_velocity: float = 0.1
    viscous: float = 60.0
    uneven: float = 0.0
    gravity: float = 80.0
    cogging: float = 15.0
    harmonic: int = 6
    phase: float = 0.0
    dry: float = 0.0
    bandwidth_hz: float = 8.0

    def level(self, speed: FloatArray, direction: float = 0.0) -> FloatArray:
        """The torque (n,) of friction at speeds (n,); direction 0: the mean of both."""
        fall = np.exp(-((speed / self.stribeck_velocity) ** 2))
        return self.coulomb + (self.stiction - self.coulomb) * fall + (self.viscous + direction * self.uneven) * speed


def simulated(
    joints: Sequence[CoggedJoint], references: Sequence[FloatArray], step_s: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Angle and torque (n,) of each joint every step, along its own reference."""
    n = max(map(len, references))
    desired = np.stack([np.pad(each, (0, n - len(each)), mode="edge") for each in references], axis=1)
    speed = np.gradient(desired, step_s, axis=0)
    names = CoggedJoint.__dataclass_fields__
    value = {name: np.array([getattr(joint, name) for joint in joints], dtype=np.float64) for name in names}
    J, natural = value["inertia"], 2 * np.pi * value["bandwidth_hz"]
    k_p, k_d, excess = J * natural**2, 1.4 * J * natural, value["stiction"] - value["coulomb"]
    turns = value["harmonic"] * RATIO
    q, v = desired[0].copy(), np.zeros(len(joints))
    angle, torque = np.empty(desired.shape), np.empty(desired.shape)
    for i in range(n):
        u = k_p * (desired[i] - q) + k_d * (speed[i] - v)
        angle[i], torque[i] = q, u
        driven = u - value["cogging"] * np.cos(turns * q + value["phase"]) - value["gravity"] * np.cos(q)
        viscous = (value["viscous"] + np.sign(v) * value["uneven"]) * step_s / (2 * J)
        free = (1 - viscous) * v + driven * step_s / J
        of_turn = value["dry"] * np.cos(RATIO * q - value["phase"])
        dry = (value["coulomb"] + of_turn + excess * np.exp(-((v / value["stribeck_velocity"]) ** 2))) * step_s / J
        v = np.sign(free) * np.maximum(np.abs(free) - dry, 0) / (1 + viscous)
        q = q + step_s * v
    return [(angle[: len(own), i], torque[: len(own), i]) for i, own in enumerate(references)]


def logged(
    angle: FloatArray, torque: FloatArray, step_s: float, seed: int, noise: float = 2.0, **changes: object
) -> FrictionRecord:
    """At RATE, by an encoder of 16 bit on the motor, with torque noise."""
    thin = round(1 / (RATE * step_s))
    count = 2 * np.pi / RATIO / COUNTS
    q, u = np.round(angle[::thin] / count) * count, torque[::thin]
    u = u + noise * np.random.default_rng(seed).standard_normal(len(u))
    return FrictionRecord("log", "1", "motion", RATE, q, u, place="joint 1", **changes)
