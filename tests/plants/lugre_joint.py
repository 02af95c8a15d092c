"""A joint with LuGre friction at its motor and a link on a spring, in a loop or under given torques, warming up.

No code of elastid: Runge-Kutta steps of fourth order, eight in each sample of 1 kHz, torque held between samples.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit

from elastid.base.arrays import FloatArray
from elastid.excitation.multisine import synthesise
from elastid.friction_study.extended_kalman_filter import JointSamples, TrackedJoint

RATE_HZ, SUBSTEPS, PERIOD = 1000.0, 8, 2000
COUNT, FINE_COUNT = 2 * np.pi / 2**16, 2 * np.pi / 2**20
TORQUE_STD = 0.05
MOTOR, LINK, STIFFNESS, DAMPING = 8e-3, 12e-3, 47.0, 0.05
SIGMA_0, SIGMA_1, COULOMB, STICTION_RATIO, STRIBECK_VELOCITY, VISCOUS = 250.0, 0.8, 1.0, 1.4, 3.0, 8e-3
# Of position and velocity, and of the integral of the velocity.
GAINS = (12.0, 0.5, 6.0)

FOLLOWED = TrackedJoint(
    motor_inertia=MOTOR,
    link_inertia=LINK,
    stiffness=STIFFNESS,
    damping=DAMPING,
    coulomb=COULOMB,
    viscous=VISCOUS,
    stiction_ratio=STICTION_RATIO,
    stribeck_velocity=STRIBECK_VELOCITY,
    bristle_stiffness=SIGMA_0,
    bristle_damping=SIGMA_1,
)
ROBOT = f"""
name: one axis
gravity: [0, 0, -9.81]
bodies:
  - name: arm
    joints:
      - name: 1
        axis: z
        motor: {{inertia: {MOTOR / 4}, ratio: 2, viscous: {VISCOUS / 4}, coulomb: {COULOMB / 2}}}
        spring: {{stiffness: {STIFFNESS}, damping: {DAMPING}}}
    inertia: {LINK}
"""


@dataclass(frozen=True)
class WarmRun:
    """What a filter is given, and the true numbers: F_c, f, motor velocity (n,)."""

    samples: JointSamples
    coulomb: FloatArray
    viscous: FloatArray
    velocity: FloatArray


def simulate(reference: FloatArray, seed: int, offset: float = 0.1, stiction_ratio: float = STICTION_RATIO) -> WarmRun:
    """A motor that follows a velocity (n,), rad/s; friction falls while it warms up, gravity is off by `offset`."""
    n = len(reference)
    warmth = 1 - np.exp(-np.arange(n) / RATE_HZ / 20)
    coulomb, viscous = COULOMB * (1 - 0.15 * warmth), VISCOUS * (1 - 0.5 * warmth)
    noise = TORQUE_STD * np.random.default_rng(seed).standard_normal(n)
    states, torque = _simulated(reference, noise, GAINS, coulomb, viscous, stiction_ratio, offset)
    angle = np.round(states[1:, 0] / COUNT) * COUNT
    return WarmRun(JointSamples(torque, np.zeros(n), angle), coulomb, viscous, states[1:, 1])


def moved(torque: FloatArray) -> FloatArray:
    """The motor's angle (n,) at the instant at which each torque begins to act, from rest."""
    level = np.ones(len(torque))
    states, _ = _simulated(0 * torque, torque, (0.0, 0.0, 0.0), COULOMB * level, VISCOUS * level, STICTION_RATIO, 0.0)
    return states[:-1, 0]


def write_rest_log(path: Path, torque: FloatArray, rng: np.random.Generator) -> None:
    """A CSV of torque as commanded and angle in counts at its instants; noise of the torque acts and is not logged."""
    angle = moved(torque + 0.3 * TORQUE_STD * rng.standard_normal(len(torque)))
    table = np.column_stack([torque, np.round(angle / FINE_COUNT) * FINE_COUNT])
    np.savetxt(path, table, "%.9g", ",", header="torque,angle", comments="")


def multisine(peak: float, rng: np.random.Generator) -> FloatArray:
    """Six periods of 5 to 80 Hz, random phases."""
    lines = np.arange(10, 161)
    u = synthesise(lines, np.exp(2j * np.pi * rng.random((len(lines), 1))), PERIOD)[:, 0]
    return np.tile(u * peak / np.abs(u).max(), 6)


def rich(seconds: float) -> FloatArray:
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    return 30 * np.sin(2 * np.pi * 0.7 * t) + 20 * np.sin(2 * np.pi * 0.23 * t + 1) + 8 * np.sin(2 * np.pi * 2.1 * t)


@njit(cache=True)
def _simulated(velocity, disturbance, gains, coulomb, viscous, stiction_ratio, offset):
    """q, v, link, w, z (n + 1, 5) at the instants, from rest; torque of the controller (n,)."""
    n, h = len(velocity), 1 / RATE_HZ / SUBSTEPS
    states, torque = np.zeros((n + 1, 5)), np.empty(n)
    slopes, x, position, integral = np.zeros((5, 5)), np.zeros(5), 0.0, 0.0
    for k in range(n):
        position += velocity[k] / RATE_HZ
        error = velocity[k] + gains[0] * (position - x[0]) - x[1]
        torque[k] = gains[1] * error + gains[2] * integral
        integral += error / RATE_HZ
        for _ in range(SUBSTEPS):
            for stage, part in enumerate((0.0, 0.5, 0.5, 1.0)):
                q, v, link, w, z = x + part * h * slopes[stage]
                level = coulomb[k] * (1 + (stiction_ratio - 1) * np.exp(-((v / STRIBECK_VELOCITY) ** 2)))
                bend = v - SIGMA_0 * abs(v) * z / level
                friction = SIGMA_0 * z + SIGMA_1 * bend + viscous[k] * v
                spring = STIFFNESS * (q - link) + DAMPING * (v - w)
                acting = torque[k] + disturbance[k] - friction - spring
                slopes[stage + 1] = np.array([v, acting / MOTOR, w, (spring - offset) / LINK, bend])
            x = x + h / 6 * (slopes[1] + 2 * slopes[2] + 2 * slopes[3] + slopes[4])
        states[k + 1] = x
    return states, torque
