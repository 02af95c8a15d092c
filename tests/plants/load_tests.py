"""Static load tests and taps at the tool of the arm in its closed form, and responses of its motors."""

from collections.abc import Callable
from itertools import cycle

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.load_tests import LoadTest
from elastid.record import Configuration
from elastid.response import Response
from plants.arm import closed_form, rest, robot, tool
from plants.measured_robots import responses_of
from plants.two_mass import drawn

POSTURES = ((0.3, 0.2), (0.9, -0.6), (-0.5, 1.0))
NAMED = {f"c{i + 1}": Configuration(f"c{i + 1}", angles) for i, angles in enumerate(POSTURES)}


def load_tests(
    rng: np.random.Generator, std: float = 5e-6,
    changed: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda y, force: y,
) -> list[LoadTest]:  # fmt: skip
    """Twelve readings of trackers and dials along z under forces in the plane of the arm.

    changed(y, force): a fault of deflections.
    """
    tests = []
    for i, (name, where) in zip(range(12), cycle(NAMED.items()), strict=False):
        angle = rng.uniform(0, 2 * np.pi)
        force = 300.0 * (0.3 + 0.7 * (i % 3) / 2) * np.array([np.cos(angle), 0, np.sin(angle)])
        loaded, free = (rest(where.angles, part) for part in (force[[0, 2]], (0.0, 0.0)))
        x, z = tool(loaded) - tool(free)
        y = changed(np.array([x, 0.0, z]), force)
        if i % 2:
            reading = {"deflection": float(y[2] + std * rng.standard_normal()), "along": "z"}
        else:
            reading = {"deflection": tuple((y + std * rng.standard_normal(3)).tolist())}
        tests.append(LoadTest(configuration=name, force=tuple(force.tolist()), std=std, **reading))
    return tests


def measure(rng: np.random.Generator, noise: float = 0.01) -> list[Response]:
    """Responses in each posture with noise of known variance."""
    return responses_of(robot(), POSTURES, rng, np.linspace(2, 50, 40), noise, 0.0)


def tapped(where: Configuration, freq_hz: FloatArray, noise: float, rng: np.random.Generator) -> Response:
    """Acceleration of the tool by forces on it, along its own axes, motors held; noise: relative."""
    M, D, K, J = closed_form(where.angles)
    turn = rest(where.angles).sum()
    J = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ J
    s = 2j * np.pi * freq_hz[:, None, None]
    G = s**2 * J @ np.linalg.solve(s**2 * M + s * D + K, J.T.astype(complex))
    G, covariance = drawn(G, noise * np.abs(G), rng)
    inputs, outputs = (tuple(f"{place} {axis}" for axis in "xz") for place in ("force tool", "frame tool"))
    known = covariance if noise else None
    return Response(freq_hz, G, inputs, outputs, "acceleration", where, noise=known, motors="locked")
