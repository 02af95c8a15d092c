"""One rigid joint and a planar arm of two under PD controllers, integrated by equations written out by hand."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from elastid.base.arrays import FloatArray

RATE_HZ = 200.0
# Of the joints: k_p, k_d, armature, viscous and Coulomb friction.
GAINS = ((20.0, 1.0), (12.0, 0.5))
TRUE = {"inertia": (0.02, 0.01), "viscous": (0.10, 0.05), "coulomb": (0.20, 0.10)}
# The arm: mass, length, distance of the centre of mass, inertia about it of both links; gravity on the first alone.
LINKS = ((1.2, 0.25, 0.12, 0.008), (0.6, 0.22, 0.10, 0.003))
GRAVITY = 9.81
ONE_ROBOT = """
name: one joint
gravity: [0, 0, 0]
bodies:
  - name: arm
    joints: [{name: 1, axis: z, motor: {inertia: 0.01, ratio: 1}}]
    mass: 1
    center_of_mass: [0.1, 0, 0]
    inertia: 0.001
"""
TWO_ROBOT = """
name: planar arm
gravity: [0, -9.81, 0]
bodies:
  - name: upper
    joints: [{name: 1, axis: z, motor: {inertia: 0.01, ratio: 1}}]
    mass: 1.2
    center_of_mass: [0.12, 0, 0]
    inertia: 0.008
  - name: fore
    parent: upper
    placement: {xyz: [0.25, 0, 0]}
    joints: [{name: 2, axis: z, motor: {inertia: 0.01, ratio: 1}}]
    mass: 0.6
    center_of_mass: [0.10, 0, 0]
    inertia: 0.003
"""


def references(n: int, joints: int, amplitude: float, highest_hz: float) -> FloatArray:
    """Chirps (n, joints) from 0.2 Hz, the second a little faster."""
    t = np.arange(n) / RATE_HZ
    phases = [2 * np.pi * (0.2 * t + (scale * highest_hz - 0.2) * t**2 / (2 * t[-1])) for scale in (1.0, 0.8)[:joints]]
    return np.stack([amplitude * np.sin(phase) for phase in phases], axis=1)


def one_joint(v: Sequence[float], q: Sequence[float], torque: Sequence[float]) -> tuple[float, ...]:
    """Acceleration of one joint without gravity."""
    return (torque[0] / TRUE["inertia"][0],)


def two_joints(v: Sequence[float], q: Sequence[float], torque: Sequence[float]) -> tuple[float, ...]:
    """Accelerations of a planar arm (Siciliano et al., Robotics, 2009, section 7.3.2) with the armatures of TRUE."""
    (m1, a1, l1, I1), (m2, _, l2, I2) = LINKS
    c2, s2 = math.cos(q[1]), math.sin(q[1])
    b22 = I2 + m2 * l2 * l2 + TRUE["inertia"][1]
    b12 = I2 + m2 * (l2 * l2 + a1 * l2 * c2)
    b11 = I1 + m1 * l1 * l1 + I2 + m2 * (a1 * a1 + l2 * l2 + 2 * a1 * l2 * c2) + TRUE["inertia"][0]
    h = m2 * a1 * l2 * s2
    g2 = m2 * l2 * GRAVITY * math.cos(q[0] + q[1])
    g1 = (m1 * l1 + m2 * a1) * GRAVITY * math.cos(q[0]) + g2
    t1 = torque[0] + h * (2 * v[0] * v[1] + v[1] * v[1]) - g1
    t2 = torque[1] - h * v[0] * v[0] - g2
    det = b11 * b22 - b12 * b12
    return (b22 * t1 - b12 * t2) / det, (b11 * t2 - b12 * t1) / det


Plant = Callable[[Sequence[float], Sequence[float], Sequence[float]], tuple[float, ...]]


def positions(
    plant: Plant, reference: FloatArray, delay_s: float, steps: int = 25, tick: int = 0, differentiates: bool = False,
    soft: tuple[float, float] | None = None,
) -> FloatArray:  # fmt: skip
    """Simulate positions (n, m) at the samples for zero-order-hold references delayed by delay_s, by Runge-Kutta.

    tick: integration steps in a period of a sampled controller, 0 for a continuous one.  differentiates: the controller
    uses differences of positions as velocity.  soft: time constant, s, and creep of friction as a soft constraint, for
    joints without coupling; MuJoCo's documentation: a_1 = c a_0 - (1 - c) v / tau while a joint sticks.
    """
    n, m = reference.shape
    rows, h, smooth = reference.tolist(), 1 / RATE_HZ / steps, 2e-3
    q, v, result = [0.0] * m, [0.0] * m, np.empty((n, m))
    held = []

    def acceleration(v: list[float], q: list[float], r: list[float]) -> tuple[float, ...]:
        read = held or [q, v]
        torque = [
            kp * (r[i] - read[0][i]) - kd * read[1][i] - TRUE["viscous"][i] * v[i]
            for i, (kp, kd) in enumerate(GAINS[:m])
        ]
        return plant(v, q, [u - dry(i, v[i], u) for i, u in enumerate(torque)])

    def dry(i: int, v: float, torque: float) -> float:
        F_c = TRUE["coulomb"][i]
        if soft is None:
            return F_c * math.tanh(v / smooth)
        return min(max((1 - soft[1]) * (torque + TRUE["inertia"][i] * v / soft[0]), -F_c), F_c)

    def ahead(x: list[float], rate: Sequence[float], h: float) -> list[float]:
        return [a + h * b for a, b in zip(x, rate, strict=True)]

    for k in range(n):
        result[k] = q
        for i in range(steps):
            if tick and (k * steps + i) % tick == 0:
                before = held[0] if held else q
                held = [q, [(a - b) / (tick * h) for a, b in zip(q, before, strict=True)] if differentiates else v]
            r = rows[max(0, math.floor((k + (i + 0.5) / steps) - delay_s * RATE_HZ))]
            a1 = acceleration(v, q, r)
            v2, q2 = ahead(v, a1, h / 2), ahead(q, v, h / 2)
            a2 = acceleration(v2, q2, r)
            v3, q3 = ahead(v, a2, h / 2), ahead(q, v2, h / 2)
            a3 = acceleration(v3, q3, r)
            v4, q4 = ahead(v, a3, h), ahead(q, v3, h)
            a4 = acceleration(v4, q4, r)
            q = [x + h / 6 * (w1 + 2 * w2 + 2 * w3 + w4) for x, w1, w2, w3, w4 in zip(q, v, v2, v3, v4, strict=True)]
            v = [w + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4) for w, b1, b2, b3, b4 in zip(v, a1, a2, a3, a4, strict=True)]
    return result


def positions_with_bristles(
    reference: FloatArray, compliance: float, damping_s: float, F_s: float = 0.2, nu_s: float = 1.0, steps: int = 100
) -> FloatArray:
    """Simulate positions (n, 1) of one joint with LuGre friction and stiction F_s, by explicit Euler steps."""
    (kp, kd), J, f, F_c = GAINS[0], *(TRUE[name][0] for name in ("inertia", "viscous", "coulomb"))
    q = v = w = 0.0
    h, result = 1 / RATE_HZ / steps, np.empty_like(reference)
    for k, r in enumerate(reference[:, 0].tolist()):
        result[k] = q
        for _ in range(steps):
            change = (v - abs(v) * w / (F_c + (F_s - F_c) * math.exp(-((v / nu_s) ** 2)))) / compliance
            q, v, w = q + h * v, v + h / J * (kp * (r - q) - (kd + f) * v - w - damping_s * change), w + h * change
    return result
