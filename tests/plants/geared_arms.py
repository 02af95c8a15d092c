"""Arms with dry friction before and behind their gears, by equations and steps that share nothing with the package.

Motors on shafts s = E a, E of the couplings between gears, a link-side angles before the springs; links l after them:

    E^T J E a'' + E^T (f s' + F_m sgn s') + tau = u,    tau = k x + d x' + beyond(x) by gear, x = a - l (driven)
    M(l) l'' + c(l, l') = tau - F_l sgn l' - springs of joints that no motor drives

The links' equations are MuJoCo's, or for the parallel linkage those of two absolute angles, written out. Runge-Kutta
of fourth order for all of it, experiments side by side. A sign turns over a small speed, which a step can follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.record import Configuration, Record
from elastid.robot import Anchor, Body, GearCoupling, Joint, Loop, Motor, Placement, Robot, Rod, Spring

RATE_HZ, SAMPLES, SUBSTEPS, SETTLING = 500.0, 1000, 8, 1
LINES = np.arange(5, 161, 4)
RATIO = 100.0

# Accelerations (n_l, M) of the links by their angles and velocities (n_l, M) and torques on their joints.
Links: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Drives:
    """Numbers (n_u,) of the motors and gears, on the link side; E (n_u, n_u) from angles a to shafts.

    driven (n_u,): place of each in the links' joints.  gap: half of the lost motion, in which the spring has `loose` of
    its stiffness.
    """

    driven: tuple[int, ...]
    J: FloatArray
    k: FloatArray
    d: FloatArray
    f: FloatArray
    F_m: FloatArray
    F_l: FloatArray
    E: FloatArray
    k_3: FloatArray
    gap: FloatArray
    loose: float = 0.3

    def spring(self, x: FloatArray) -> FloatArray:
        """Torque (n_u, M) of the springs, without damping."""
        lost = (1 - self.loose) * self.k[:, None] * np.clip(x, -self.gap[:, None], self.gap[:, None])
        return np.asarray(self.k[:, None] * x + self.k_3[:, None] * x**3 - lost)


@dataclass(frozen=True)
class Arm:
    """A robot of the package, the same arm from outside, and the excitation that it bears.

    rms (n_u,): Nm.  turn (n_u,): rad/s over which a sign turns.
    """

    robot: Robot
    links: Links
    drives: Drives
    postures: Mapping[str, tuple[float, ...]]
    rms: FloatArray
    turn: FloatArray
    n_l: int
    free: tuple[str, ...] = ("k_*", "d_*", "fm_*")

    @property
    def truth(self) -> dict[tuple[str, str], float]:
        """Kind and joint of each effect of its gears to its level."""
        drives, levels = self.drives, {}
        lost = (1 - drives.loose) * drives.k * (drives.gap > 0)
        for i, joint in enumerate(self.robot.driven):
            of_joint = {"friction": drives.F_m[i], "behind": drives.F_l[i], "gap": lost[i]}
            levels |= {(kind, joint.name): float(level) for kind, level in of_joint.items() if level}
        return levels


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
    drives, (n_u, m, n) = arm.drives, torque.shape
    E, driven, h = drives.E, list(drives.driven), 1 / (RATE_HZ * SUBSTEPS)
    inertia = E.T @ np.diag(drives.J) @ E
    inverse = np.linalg.inv(inertia)
    stiff, damper = 40 * arm.rms[:, None], 6 * arm.rms[:, None]
    start, hold = _at_rest(arm, angles, m)
    d = drives.d[:, None]

    def applied(a: FloatArray, da: FloatArray, i: int) -> FloatArray:
        error, of_rate = angles[:, None] + reference[:, :, i] - a, rate[:, :, i] - da
        return np.asarray(torque[:, :, i] + hold + stiff * error + damper * of_rate)

    def slopes(state: FloatArray, i: int) -> FloatArray:
        a, da, link, dl = np.split(state, [n_u, 2 * n_u, 2 * n_u + arm.n_l])
        tau = drives.spring(a - link[driven]) + d * (da - dl[driven])
        shaft = E @ da
        friction = drives.f[:, None] * shaft + drives.F_m[:, None] * np.tanh(shaft / arm.turn[:, None])
        dda = inverse @ (applied(a, da, i) - E.T @ friction - tau)
        on_links = np.zeros((arm.n_l, m))
        on_links[driven] = tau - drives.F_l[:, None] * np.tanh(dl[driven] / arm.turn[:, None])
        return np.concatenate([da, dda, dl, arm.links(link, dl, on_links)])

    x = np.concatenate([np.repeat(angles[:, None], m, axis=1), np.zeros((n_u, m)), start, np.zeros((arm.n_l, m))])
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
    drives, driven = arm.drives, list(arm.drives.driven)
    link = np.zeros(arm.n_l)
    link[driven] = angles

    def force(link: FloatArray) -> FloatArray:
        on_links = np.zeros((arm.n_l, 1))
        on_links[driven] = drives.spring((angles - link[driven])[:, None])
        return arm.links(link[:, None], np.zeros((arm.n_l, 1)), on_links)[:, 0]

    for _ in range(20):
        e = force(link)
        slope = np.stack([(force(link + 1e-7 * row) - e) / 1e-7 for row in np.eye(arm.n_l)], axis=1)
        link = link - np.linalg.solve(slope, e)
    hold = drives.spring((angles - link[driven])[:, None])
    return np.repeat(link[:, None], m, axis=1), np.repeat(hold, m, axis=1)


def in_mujoco(robot: Robot) -> Links:
    """Links of a serial robot by MuJoCo's equations, with the springs of joints that no motor drives."""

    @cache
    def engine() -> tuple[Any, Any, Any]:
        import mujoco

        model = mujoco.MjModel.from_xml_string(_mjcf(robot))
        return mujoco, model, mujoco.MjData(model)

    def accelerations(link: FloatArray, velocity: FloatArray, torque: FloatArray) -> FloatArray:
        (mujoco, model, data), out = engine(), np.empty_like(link)
        for i in range(link.shape[1]):
            data.qpos[:], data.qvel[:], data.qfrc_applied[:] = link[:, i], velocity[:, i], torque[:, i]
            mujoco.mj_forward(model, data)
            out[:, i] = data.qacc
        return out

    return accelerations


def _mjcf(robot: Robot) -> str:
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}

    def body(one: Body) -> str:
        joints = "".join(
            f'<joint name="{joint.name}" type="hinge" axis="{axes[str(joint.axis)]}"'
            + ("" if joint.motor or joint.spring is None else
               f' stiffness="{joint.spring.stiffness}" damping="{joint.spring.damping}"')
            + "/>"
            for joint in one.joints
        )  # fmt: skip
        inertia = one.inertia if isinstance(one.inertia, tuple) else (one.inertia,) * 3
        at = " ".join(map(str, one.placement.xyz))
        return (
            f'<body name="{one.name}" pos="{at}">{joints}<inertial mass="{one.mass}" '
            f'pos="{" ".join(map(str, one.center_of_mass))}" diaginertia="{" ".join(map(str, inertia))}"/>'
            + "".join(body(child) for child in robot.bodies if child.parent == one.name)
            + "</body>"
        )

    gravity = " ".join(map(str, robot.gravity))
    first = "".join(body(one) for one in robot.bodies if one.parent == "base")
    return (
        f'<mujoco><compiler autolimits="true" balanceinertia="false"/><option gravity="{gravity}">'
        f'<flag contact="disable" constraint="disable"/></option><worldbody>{first}</worldbody></mujoco>'
    )


def _drives(robot: Robot, F_m: Sequence[float], F_l: Sequence[float], **further: FloatArray) -> Drives:
    n_u = len(robot.driven)
    springs, motors = [j.spring for j in robot.driven], [j.motor for j in robot.driven]
    numbers = {
        "J": [m.inertia * m.ratio**2 for m in motors if m], "f": [m.viscous * m.ratio**2 for m in motors if m],
        "k": [s.stiffness for s in springs if s], "d": [s.damping for s in springs if s], "F_m": F_m, "F_l": F_l,
    }  # fmt: skip
    E = np.eye(n_u)
    for gear in robot.gears:
        names = [joint.name for joint in robot.driven]
        E[names.index(gear.motor), names.index(gear.joint)] = gear.ratio / robot.ratio(gear.motor)
    none = {"k_3": np.zeros(n_u), "gap": np.zeros(n_u)}
    arrays = {name: np.array(values, float) for name, values in numbers.items()} | none | further
    return Drives(tuple(robot.driven_indices), E=E, **arrays)


def _joint(name: str, axis: str, J: float, k: float, d: float, f: float) -> Joint:
    return Joint(name, axis, Spring(k, d), Motor(J / RATIO**2, RATIO, f / RATIO**2))


def wrist() -> Arm:
    """Two axes across each other whose gears are coupled, as those of a wrist: motor 2 turns along with joint 1."""
    robot = Robot(
        "wrist",
        (
            Body("hand", joints=(_joint("1", "z", 6.0, 9e4, 30.0, 8.0),), mass=20.0, center_of_mass=(0.25, 0.02, 0.1),
                 inertia=(0.5, 1.5, 1.6)),
            Body("tool", "hand", Placement((0.4, 0.0, 0.1)), (_joint("2", "y", 3.0, 4e4, 12.0, 4.0),), 15.0,
                 (0.3, 0.05, 0.02), (0.2, 0.9, 1.0)),
        ),
        gears=(GearCoupling("2", "1", 0.6 * RATIO),),
    )  # fmt: skip
    postures = {"a": (0.2, 0.3), "b": (-0.4, 1.1)}
    drives = _drives(robot, (12.0, 5.0), (8.0, 4.0))
    return Arm(robot, in_mujoco(robot), drives, postures, np.array([90.0, 40.0]), np.array([2e-3, 2e-3]), 2)


def six_axes() -> Arm:
    """Six axes of a handling robot."""
    rows = (  # joint, axis, J, k, d, f; place of the body on the one before, mass, centre of mass, inertia
        ("1", "z", 30.0, 1e6, 300.0, 40.0, (0.0, 0.0, 0.0), 120.0, (0.05, 0.02, 0.3), (5.0, 5.0, 4.0)),
        ("2", "y", 28.0, 9e5, 250.0, 35.0, (0.2, 0.0, 0.5), 60.0, (0.02, 0.05, 0.4), (4.0, 4.2, 0.8)),
        ("3", "y", 15.0, 4e5, 120.0, 20.0, (0.0, 0.0, 0.9), 45.0, (0.15, 0.03, 0.1), (0.9, 1.4, 1.3)),
        ("4", "x", 2.5, 7e4, 12.0, 4.0, (0.4, 0.0, 0.15), 20.0, (0.25, 0.02, 0.05), (0.2, 0.6, 0.6)),
        ("5", "y", 1.8, 5e4, 8.0, 3.0, (0.5, 0.0, 0.0), 10.0, (0.08, 0.02, 0.03), (0.08, 0.12, 0.11)),
        ("6", "x", 0.8, 2.5e4, 3.0, 1.2, (0.12, 0.0, 0.0), 14.0, (0.15, 0.09, 0.06), (0.25, 0.4, 0.45)),
    )
    names = ("base", *(f"body {row[0]}" for row in rows))
    bodies = tuple(
        Body(f"body {name}", parent, Placement(at), (_joint(name, axis, J, k, d, f),), mass, center, inertia)
        for parent, (name, axis, J, k, d, f, at, mass, center, inertia) in zip(names, rows, strict=False)
    )
    robot = Robot("six axes", bodies)
    postures = {"a": (0.1, 0.4, 0.3, 0.5, 0.7, 0.2), "b": (0.6, -0.3, 0.8, -1.0, 1.2, 1.4)}
    rms = np.array([500.0, 500.0, 250.0, 50.0, 40.0, 20.0])
    drives = _drives(robot, 0.1 * rms, 0.06 * rms)
    return Arm(robot, in_mujoco(robot), drives, postures, rms, np.array([1e-3, 1e-3, 1e-3, 4e-3, 4e-3, 4e-3]), 6)


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
    drives = _drives(robot, (40.0, 35.0), (20.0, 18.0))
    plain = Drives((0, 1), drives.J, drives.k, drives.d, drives.f, drives.F_m, drives.F_l, np.eye(2), drives.k_3,
                   drives.gap)  # fmt: skip
    return Arm(robot, links, plain, postures, np.array([400.0, 350.0]), np.array([1e-3, 1e-3]), 2)
