"""Two links with elastic gears, robots off their file as data sheets are; responses and static load tests of them."""

import math
from collections.abc import Callable

import numpy as np

from elastid.fit.load_tests import LoadTest
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import Configuration
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring, Tolerances
from plants.measured_robots import responses_of

FREQ = np.linspace(2, 50, 40)
POSTURES = ((0.3, 0.2), (0.9, -0.6), (-0.5, 1.0))
SPEC = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=3, seed=1)


def arm(tolerances: Tolerances | None = None) -> Robot:
    """Two links in a vertical plane with elastic gears."""
    shoulder = Joint("1", "y", Spring(3e4, 60), Motor(2e-3, 60, 1e-2))
    elbow = Joint("2", "y", Spring(2e4, 40), Motor(1e-3, 60, 1e-2))
    upper = Body("upper", joints=(shoulder,), mass=40, center_of_mass=(0, 0, 0.4), inertia=(3.0, 3.0, 0.5))
    fore = Body("fore", "upper", Placement((0, 0, 0.8)), (elbow,), 25.0, (0.3, 0, 0), 1.0)
    return Robot("arm", (upper, fore), tolerances=tolerances)


def off(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with masses 3 %, inertias 10 % (one factor), motor inertias 5 %, centres 10 mm, lengths 1 mm off."""
    numbers, factor = {}, dict(zip(("upper", "fore"), np.exp(0.1 * rng.standard_normal(2)), strict=True))
    for name, (value, _) in robot.parameters(("p_fore_z",)).items():
        z = rng.standard_normal()
        if name.startswith(("m_", "Jm_")):
            numbers[name] = value * math.exp((0.03 if name.startswith("m_") else 0.05) * z)
        elif name.startswith("I_"):
            numbers[name] = value * factor[name.split("_")[1]]
        elif name.startswith(("c_", "p_")):
            numbers[name] = value + (0.01 if name.startswith("c_") else 1e-3) * z
    return robot.with_parameters(numbers)


def measure(robot: Robot, rng: np.random.Generator, noise: float = 0.01) -> list[Response]:
    """Responses in each posture with noise of known variance."""
    named = {f"c{i}": angles for i, angles in enumerate(POSTURES)}
    return responses_of(robot, named, rng, FREQ, noise, 0.0)


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
