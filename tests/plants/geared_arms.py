"""A linkage whose links' equations are those of two absolute angles, written out."""

from collections.abc import Callable

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import Anchor, Body, Joint, Loop, Motor, Placement, Robot, Rod, Spring

RATIO, LOWER, LEVER = 100.0, 0.8, 0.3

# Accelerations (n_l, M) of the links by their angles and velocities (n_l, M) and torques on their joints.
Links = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def _joint(name: str, axis: str, J: float, k: float, d: float, f: float) -> Joint:
    return Joint(name, axis, Spring(k, d), Motor(J / RATIO**2, RATIO, f / RATIO**2))


def parallel_linkage() -> tuple[Robot, Links]:
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

    return robot, links
