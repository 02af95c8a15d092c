"""A linkage with dry friction before and behind its gears, by equations and steps that share nothing with the package.

Motors at link-side angles a before the springs, links l after them:

    J a'' + f a' + F_m sgn a' + tau = u,    tau = k x + d x', x = a - l
    M(l) l'' + c(l, l') = tau - F_l sgn l'

The links' equations are those of two absolute angles, written out. Runge-Kutta of fourth order for all of it,
experiments side by side. A sign turns over a small speed, which a step can follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.record import Configuration, Record
from elastid.robot import Anchor, Body, Joint, Loop, Motor, Placement, Robot, Rod, Spring

RATE_HZ, SAMPLES, SUBSTEPS, SETTLING = 500.0, 1000, 8, 1
LINES = np.arange(5, 161, 4)
RATIO = 100.0

# Accelerations (n_l, M) of the links by their angles and velocities (n_l, M) and torques on their joints.
Links: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Arm:
    """A robot of the package, the same arm from outside, and the excitation that it bears.

    J, k, d, f, F_m, F_l, rms (n_u,): link side, Nm and rad.  turn: rad/s over which a sign turns.
    """

    robot: Robot
    links: Links
    J: FloatArray
    k: FloatArray
    d: FloatArray
    f: FloatArray
    F_m: FloatArray
    F_l: FloatArray
    postures: Mapping[str, tuple[float, ...]]
    rms: FloatArray
    turn: float = 1e-3
    free: tuple[str, ...] = ("k_*", "d_*", "fm_*")

    @property
    def truth(self) -> dict[tuple[str, str], float]:
        """Kind and joint of each effect of its gears to its level."""
        names = [joint.name for joint in self.robot.driven]
        kinds = {"friction": self.F_m.tolist(), "behind": self.F_l.tolist()}
        return {(kind, name): level for kind, row in kinds.items() for name, level in zip(names, row, strict=True)}


def measure(
    arm: Arm, posture: str, *, realisations: int = 2, factor: float = 1.0, seed: int = 1, slow: float = 0.02
) -> tuple[Record, ...]:
    """Two settled periods of n_u experiments in each realisation, on a carrier, with noise of angle and torque.

    slow: amplitude of the carrier, one turn a period, rad.
    """
    rng, n_u = np.random.default_rng(seed), len(arm.rms)
    m = realisations * n_u
    n = SAMPLES * SUBSTEPS * 2  # of half steps
    spectrum = np.zeros((n_u, m, n // 2 + 1), complex)
    for r in range(realisations):
        phase = np.exp(2j * np.pi * rng.random((n_u, len(LINES))))
        for e in range(n_u):
            turned = np.exp(2j * np.pi * e * np.arange(n_u) / n_u)[:, None]
            spectrum[:, r * n_u + e, LINES] = (factor * arm.rms * np.sqrt(2 / len(LINES)))[:, None] * phase * turned
    torque = np.fft.irfft(spectrum, n, axis=2) * (n / 2)
    carrier = np.zeros((n_u, m, n // 2 + 1), complex)
    carrier[:, :, 1] = slow * np.exp(2j * np.pi * rng.random((n_u, m)))
    reference = np.fft.irfft(carrier, n, axis=2) * (n / 2)
    rate = np.gradient(reference, 1 / (RATE_HZ * SUBSTEPS * 2), axis=2)
    u, q = _simulated(arm, np.array(arm.postures[posture]), torque, reference, rate)
    u = u + 2e-3 * arm.rms[:, None, None] * rng.standard_normal(u.shape)
    q = q + 2e-7 * rng.standard_normal(q.shape)
    places = arm.robot.motor_locations
    quantities = ("position",) * n_u
    configuration = Configuration(posture, np.array(arm.postures[posture]))
    return tuple(
        Record(f"{posture}-r{i // n_u}-e{i % n_u}", configuration, i // n_u, i % n_u, RATE_HZ, SAMPLES, places, places,
               quantities, u[:, i].T, q[:, i].T)
        for i in range(m)
    )  # fmt: skip


def _simulated(
    arm: Arm, angles: FloatArray, torque: FloatArray, reference: FloatArray, rate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Torques and angles (n_u, m, n) of the motors in the settled periods; given (n_u, m, half steps)."""
    (n_u, m, n), h = torque.shape, 1 / (RATE_HZ * SUBSTEPS)
    J, k, d, f, F_m, F_l = (x[:, None] for x in (arm.J, arm.k, arm.d, arm.f, arm.F_m, arm.F_l))
    stiff, damper = 40 * arm.rms[:, None], 6 * arm.rms[:, None]
    start, hold = _at_rest(arm, angles, m)

    def applied(a: FloatArray, da: FloatArray, i: int) -> FloatArray:
        error, of_rate = angles[:, None] + reference[:, :, i] - a, rate[:, :, i] - da
        return np.asarray(torque[:, :, i] + hold + stiff * error + damper * of_rate)

    def slopes(state: FloatArray, i: int) -> FloatArray:
        a, da, link, dl = np.split(state, 4)
        tau = k * (a - link) + d * (da - dl)
        dda = (applied(a, da, i) - f * da - F_m * np.tanh(da / arm.turn) - tau) / J
        return np.concatenate([da, dda, dl, arm.links(link, dl, tau - F_l * np.tanh(dl / arm.turn))])

    x = np.concatenate([np.repeat(angles[:, None], m, axis=1), np.zeros((n_u, m)), start, np.zeros((n_u, m))])
    u, q = [], []
    for step in range((SETTLING + 2) * SAMPLES * SUBSTEPS):
        i = 2 * step % n
        if step % SUBSTEPS == 0 and step >= SETTLING * SAMPLES * SUBSTEPS:
            u.append(applied(x[:n_u], x[n_u : 2 * n_u], i))
            q.append(x[:n_u])
        one = slopes(x, i)
        two = slopes(x + h / 2 * one, i + 1)
        three = slopes(x + h / 2 * two, i + 1)
        four = slopes(x + h * three, (i + 2) % n)
        x = x + h / 6 * (one + 2 * two + 2 * three + four)
    assert np.all(np.isfinite(x))
    return np.stack(u, axis=2), np.stack(q, axis=2)


def _at_rest(arm: Arm, angles: FloatArray, m: int) -> tuple[FloatArray, FloatArray]:
    """Links (n_l, m) and holding torques (n_u, m) with the motors at their angles, by Newton's method."""
    link, none = angles.copy(), np.zeros((len(angles), 1))

    def force(link: FloatArray) -> FloatArray:
        return arm.links(link[:, None], none, (arm.k * (angles - link))[:, None])[:, 0]

    for _ in range(20):
        e = force(link)
        slope = np.stack([(force(link + 1e-7 * row) - e) / 1e-7 for row in np.eye(len(link))], axis=1)
        link = link - np.linalg.solve(slope, e)
    hold = arm.k * (angles - link)
    return np.repeat(link[:, None], m, axis=1), np.repeat(hold[:, None], m, axis=1)


def _joint(name: str, axis: str, J: float, k: float, d: float, f: float) -> Joint:
    return Joint(name, axis, Spring(k, d), Motor(J / RATIO**2, RATIO, f / RATIO**2))


LOWER, LEVER = 0.8, 0.3


def parallel_linkage() -> Arm:
    """A lower arm and a crank about one point, an upper arm that a rigid rod keeps parallel to the crank.

    Absolute angles of lower arm and crank, from gravity down along -z, about y; the rod moves as the lower arm does.
    """
    m_1, c_1, I_1, m_2, c_2, I_2 = 35.0, (0.03, 0.35), 3.0, 50.0, (0.4, 0.1), 6.0
    m_c, I_c, m_r, I_r, g = 12.0, 0.6, 6.0, 0.4, 9.81
    at = Placement((0.0, 0.0, 0.0))
    robot = Robot(
        "parallel linkage",
        (
            Body("lower", "base", at, (_joint("2", "y", 25.0, 8e5, 250.0, 30.0),), m_1, (c_1[0], 0.0, c_1[1]),
                 (2.0, I_1, 2.0)),
            Body("crank", "base", at, (_joint("3", "y", 20.0, 5e5, 150.0, 25.0),), m_c, (0.0, 0.0, 0.0),
                 (0.4, I_c, 0.4)),
            Body("upper", "lower", Placement((0.0, 0.0, LOWER)), (Joint("elbow", "y"),), m_2, (c_2[0], 0.0, c_2[1]),
                 (4.0, I_2, 4.0)),
        ),
        loops=(Loop("rod", (Anchor("crank", (-LEVER, 0.0, 0.0)), Anchor("upper", (-LEVER, 0.0, 0.0))),
                    rod=Rod(LOWER, m_r, 0.5, I_r)),),
    )  # fmt: skip
    # A point (x, z) of a body turned by t about y is at (x cos t + z sin t, z cos t - x sin t).
    J_1 = I_1 + m_1 * (c_1[0] ** 2 + c_1[1] ** 2) + m_2 * LOWER**2 + I_r + m_r * (LOWER / 2) ** 2
    J_2 = I_2 + m_2 * (c_2[0] ** 2 + c_2[1] ** 2) + I_c + m_r * LEVER**2

    def links(link: FloatArray, velocity: FloatArray, torque: FloatArray) -> FloatArray:
        (t, s), (v, w) = link[:2], velocity[:2]
        # The elbow goes along (cos t, -sin t) LOWER, a point of the upper arm along (z cos s - x sin s, ...).
        cos, sin = np.cos(t - s), np.sin(t - s)
        # d(elbow)/dt . d(point)/ds of the upper arm, and of the rod's middle, which goes by crank and by lower arm.
        coupling = m_2 * LOWER * (c_2[1] * cos + c_2[0] * sin) - m_r * LOWER / 2 * LEVER * sin
        turning = m_2 * LOWER * (c_2[0] * cos - c_2[1] * sin) - m_r * LOWER / 2 * LEVER * cos  # d coupling / d (t - s)
        gravity_t = g * (m_1 * (-c_1[1] * np.sin(t) - c_1[0] * np.cos(t)) - (m_2 + m_r / 2) * LOWER * np.sin(t))
        gravity_s = g * (m_2 * (-c_2[1] * np.sin(s) - c_2[0] * np.cos(s)) + m_r * LEVER * np.cos(s))
        e_t = torque[0] + turning * w**2 - gravity_t
        e_s = torque[1] - turning * v**2 - gravity_s
        det = J_1 * J_2 - coupling**2
        return np.stack([(J_2 * e_t - coupling * e_s) / det, (J_1 * e_s - coupling * e_t) / det])

    postures = {"a": (0.2, 0.1), "b": (-0.3, 0.4)}
    numbers = ((25.0, 20.0), (8e5, 5e5), (250.0, 150.0), (30.0, 25.0), (40.0, 35.0), (20.0, 18.0))
    return Arm(robot, links, *map(np.array, numbers), postures, np.array([400.0, 350.0]))
