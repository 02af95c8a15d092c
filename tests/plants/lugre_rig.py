"""An outside joint: LuGre friction at a motor behind a gear, a link on a spring, integrated in plain Python.

No code of elastid: four Runge-Kutta steps of fourth order in each sample of 1 kHz, torque held between samples.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray

RATE, SUBSTEPS, PERIOD = 1000.0, 4, 2000
# Link side, SI: inertias, spring, friction; a count of the encoder, and noise of the torque that acts.
MOTOR, LINK, STIFFNESS, DAMPING = 1.2, 3.0, 8e4, 30.0
SIGMA_0, SIGMA_1, COULOMB, STICTION, STRIBECK, VISCOUS = 4e4, 60.0, 20.0, 28.0, 0.05, 12.0
COUNT, TORQUE_STD = 2 * math.pi / 2**17 / 50, 0.3

ROBOT = f"""
name: outside joint
gravity: [0, 0, -9.81]
bodies:
  - name: arm
    joints:
      - name: 1
        axis: z
        motor: {{inertia: {MOTOR / 2500}, ratio: 50}}
        spring: {{stiffness: {STIFFNESS}, damping: {DAMPING}}}
    inertia: {LINK}
"""


def moved(torque: FloatArray) -> FloatArray:
    """The motor's angle at the instant at which each torque begins to act, from rest: (n,), or (n, m) of m joints."""
    exp: Any = math.exp if torque.ndim == 1 else np.exp
    q = v = p = w = z = 0.0 if torque.ndim == 1 else np.zeros(torque.shape[1])
    path, h = [], 1 / RATE / SUBSTEPS

    def rates(v: Any, twist: Any, w: Any, z: Any, u: Any) -> tuple[Any, Any, Any]:
        bend = v - SIGMA_0 * abs(v) * z / (COULOMB + (STICTION - COULOMB) * exp(-((v / STRIBECK) ** 2)))
        spring = STIFFNESS * twist + DAMPING * (v - w)
        return (u - SIGMA_0 * z - SIGMA_1 * bend - VISCOUS * v - spring) / MOTOR, spring / LINK, bend

    for u in torque.tolist() if torque.ndim == 1 else torque:
        path.append(q)
        for _ in range(SUBSTEPS):
            a1, b1, c1 = rates(v, q - p, w, z, u)
            v2, w2 = v + h / 2 * a1, w + h / 2 * b1
            a2, b2, c2 = rates(v2, q - p + h / 2 * (v - w), w2, z + h / 2 * c1, u)
            v3, w3 = v + h / 2 * a2, w + h / 2 * b2
            a3, b3, c3 = rates(v3, q - p + h / 2 * (v2 - w2), w3, z + h / 2 * c2, u)
            v4, w4 = v + h * a3, w + h * b3
            a4, b4, c4 = rates(v4, q - p + h * (v3 - w3), w4, z + h * c3, u)
            q, p = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), p + h / 6 * (w + 2 * w2 + 2 * w3 + w4)
            v, w = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), w + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
            z += h / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
    return np.array(path)


def multisine(peak: float, rng: np.random.Generator, periods: int = 6) -> FloatArray:
    """5 to 80 Hz, random phases."""
    lines, spectrum = np.arange(10, 161), np.zeros(PERIOD // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    u = np.fft.irfft(spectrum, PERIOD)
    return np.tile(u * peak / np.abs(u).max(), periods)


def write_rest_log(path: Path, torque: FloatArray, rng: np.random.Generator) -> None:
    """A CSV of torque as commanded and angle in counts; noise of the torque acts and is not logged."""
    q = moved(torque + TORQUE_STD * rng.standard_normal(len(torque)))
    table = np.column_stack([torque, np.round(q / COUNT) * COUNT])
    np.savetxt(path, table, "%.9g", ",", header="torque,angle", comments="")
