"""The legs of a quadruped from its commands: each joint a pendulum, by regression on kp, kd and positions."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from elastid.base.arrays import FloatArray
from elastid.logs.command_log import CommandLog
from elastid.robot import Body, Joint, Motor, Robot

QUADRUPED = "unitree_go2"
NAMES = tuple(f"{leg}_{joint}" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf"))


def robot_of_commands(log: CommandLog) -> Robot:
    """12 pendulums: u = J a + f v + F_c sgn v + s sin q + c cos q with u = kp (r - q) - kd v, no delay."""
    assert log.kp is not None
    assert log.kd is not None
    return Robot("quadruped", tuple(_pendulum(name, *_numbers(log, i)) for i, name in enumerate(NAMES)))


def _numbers(log: CommandLog, i: int) -> FloatArray:
    width, inner = 4.0, slice(100, -100)
    q, v, a = (gaussian_filter1d(log.position[:, i], width, order=k) * log.rate_hz**k for k in range(3))
    u = log.kp[i] * (gaussian_filter1d(log.command[:, i], width) - q) - log.kd[i] * v
    columns = np.stack([a, v, np.tanh(v / 0.05), np.sin(q), np.cos(q)], axis=1)
    return np.asarray(np.linalg.lstsq(columns[inner], u[inner], rcond=None)[0])


def _pendulum(name: str, J: float, f: float, F_c: float, s: float, c: float) -> Body:
    """A mass of 1 kg where its gravity is that of the regression, the rest of the inertia in the rotor."""
    x, z = -c / 9.81, -s / 9.81
    rotor = max(J - x**2 - z**2, 1e-3)
    joint = Joint(name, axis="y", motor=Motor(rotor, 1.0, max(f, 0.0), max(F_c, 0.0)))
    return Body(f"{name} link", joints=(joint,), mass=1.0, center_of_mass=(x, 0.0, z))
