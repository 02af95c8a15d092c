"""Static load tests of the arm of `data_sheet_arm`, deflections by its own statics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elastid.fit.load_tests import LoadTest
from elastid.record import Configuration
from elastid.robot import Robot
from plants.data_sheet_arm import POSTURES

NAMED = {f"c{i}": Configuration(f"c{i}", angles) for i, angles in enumerate(POSTURES)}
CONFIGURATIONS = tuple(NAMED)
TIP = (0.3, 0.0, 0.0)  # `tool` of a robot without frames: the centre of mass of its last body


def load_tests(
    robot: Robot, rng: np.random.Generator, std: float = 5e-6, count: int = 12, size: float = 300.0,
    changed: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda y, force: y,
) -> list[LoadTest]:  # fmt: skip
    """Trackers and dials along z under forces in the plane of the arm; changed(y, force): a fault of deflections."""
    tests = []
    for i in range(count):
        name, angle = f"c{i % len(POSTURES)}", rng.uniform(0, 2 * np.pi)
        force = size * (0.3 + 0.7 * (i % 3) / 2) * np.array([np.cos(angle), 0, np.sin(angle)])
        y = changed(_deflection(robot, np.array(POSTURES[i % len(POSTURES)]), force), force)
        if i % 2:
            reading = {"deflection": float(y[2] + std * rng.standard_normal()), "along": "z"}
        else:
            reading = {"deflection": tuple((y + std * rng.standard_normal(3)).tolist())}
        tests.append(LoadTest(configuration=name, force=tuple(force.tolist()), std=std, **reading))
    return tests


def _tip(q: np.ndarray) -> np.ndarray:
    """Upper along z by 0.8 m, fore along x; a positive turn about y leads z to x."""
    a, b = q[0], q[0] + q[1]
    x, z = 0.8 * np.sin(a) + TIP[0] * np.cos(b), 0.8 * np.cos(a) - TIP[0] * np.sin(b)
    return np.array([x, 0.0, z])


def _deflection(robot: Robot, angles: np.ndarray, force: np.ndarray) -> np.ndarray:
    """k (q - angles) = J^T F - slope of the weight's energy, by its fixed point."""
    k = np.array([robot.parameters()[f"k_{i}"][0] for i in (1, 2)])
    m_1, m_2 = (body.mass for body in robot.bodies)
    ends = []
    for load in (np.zeros(3), force):
        q = angles.copy()
        for _ in range(60):
            a, b = q[0], q[0] + q[1]
            up_1 = np.array([-0.4 * np.sin(a), 0.0])
            up_2 = np.array([-0.8 * np.sin(a) - TIP[0] * np.cos(b), -TIP[0] * np.cos(b)])
            forth = np.array([0.8 * np.cos(a) - TIP[0] * np.sin(b), -TIP[0] * np.sin(b)])
            q = angles + (forth * load[0] + up_2 * load[2] - 9.81 * (m_1 * up_1 + m_2 * up_2)) / k
        ends.append(_tip(q))
    return ends[1] - ends[0]
