"""Torques of an arm beyond its linearisation, against equations of two links and of a linkage written out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import LENGTH, MASS, OFFSET
from plants.geared_arms import parallel_linkage
from plants.refusals import refused
from plants.two_links import arm

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import formulate, serial
from elastid.nonlinear.period_model import geometric_torques
from elastid.record import Configuration


def textbook(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Torques (2, n) of the two joints about y, with gravity along -z; q positive downwards, of the second relative."""
    (m1, m2), (c1, c2), g = MASS, OFFSET, 9.81
    i1, i2 = 1.5, 1.0
    beta = m2 * LENGTH * c2
    alpha = i1 + i2 + m1 * c1**2 + m2 * (LENGTH**2 + c2**2)
    delta = i2 + m2 * c2**2
    cos, sin = np.cos(q[1]), np.sin(q[1])
    of_first = (alpha + 2 * beta * cos) * a[0] + (delta + beta * cos) * a[1] - beta * sin * (2 * v[0] + v[1]) * v[1]
    of_second = (delta + beta * cos) * a[0] + delta * a[1] + beta * sin * v[0] ** 2
    weight = m2 * g * c2 * np.cos(q[0] + q[1])
    return np.stack([of_first - (m1 * c1 + m2 * LENGTH) * g * np.cos(q[0]) - weight, of_second - weight])


def moved(lines: int, size: float) -> np.ndarray:
    """Motion (lines, 2, 1) of three lines."""
    rng = np.random.default_rng(0)
    motion = np.zeros((lines, 2, 1), complex)
    motion[[0, 3, 6]] = size * (rng.standard_normal((3, 2, 1)) + 1j * rng.standard_normal((3, 2, 1)))
    return motion


def signals(motion: np.ndarray, s: np.ndarray, n: int) -> list[np.ndarray]:
    """Angles, velocities and accelerations (2, n) of a motion."""
    wave = np.exp(2j * np.pi * np.outer(np.arange(1, len(s) + 1), np.arange(n)) / n)
    return [((motion[:, :, 0] * s[:, None] ** i).T @ wave).real for i in range(3)]


def test_torques_are_those_of_two_links_beyond_first_order() -> None:
    """Of three lines, about a posture that gravity bends; their sums and differences are lines as well."""
    robot, at, s = arm(), Configuration("c", np.array([0.3, -0.9])), 2j * np.pi * 0.5 * np.arange(1, 25)
    model, motion = serial(robot), moved(24, 0.02)
    q0, n, small = equilibrium(model, model.theta, at).q[:2, None], 4096, 1e-6
    delta, v, a = signals(motion, s, n)
    ends = [textbook(q0 + h * delta, 0 * v, h * a) for h in (small, -small)]
    beyond = textbook(q0 + delta, v, a) - textbook(q0, 0 * q0, 0 * q0) - (ends[0] - ends[1]) / (2 * small)
    expected = np.fft.rfft(beyond)[:, :25].T * np.where(np.arange(25), 2, 1)[:, None] / n
    found = geometric_torques(robot, at, motion, s)[:, :, 0]
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    assert np.abs(expected).max() > 0.1


@pytest.mark.parametrize("rod_stiffness", [None, 1e9])
def test_linkage_torques_act_on_absolute_angles(rod_stiffness: float | None) -> None:
    """The elbow follows the loop; a rod that gives stays as long as at rest."""
    linkage, links = parallel_linkage()
    loop = linkage.loops[0]
    rod = replace(loop.rod, stiffness=rod_stiffness)
    robot, at = replace(linkage, loops=(replace(loop, rod=rod),)), Configuration("a", np.array([0.2, 0.1]))
    s, motion = 2j * np.pi * 0.5 * np.arange(1, 33), moved(32, 0.05)
    model = formulate(robot)
    q0 = equilibrium(model, model.theta, at).q[:2, None]

    def torques(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """(2, n), by the accelerations that the plant has under unit torques."""
        free = links(q, v, 0 * q)
        inverse = np.stack([links(q, v, 0 * q + unit[:, None]) - free for unit in np.eye(2)], axis=1)
        return np.linalg.solve(np.moveaxis(inverse, 2, 0), (a - free).T[:, :, None])[:, :, 0].T

    n, small = 512, 1e-4
    delta, v, a = signals(motion, s, n)
    ends = [torques(q0 + h * delta, h * v, h * a) for h in (small, -small)]
    expected = np.fft.rfft(torques(q0 + delta, v, a) - (ends[0] - ends[1]) / (2 * small))[:, 1:33].T * 2 / n
    found = geometric_torques(robot, at, motion, s)[1:, :, 0]
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    assert np.abs(expected).max() > 10


def test_a_loop_that_cannot_close_along_the_motion_is_said() -> None:
    """A crank that runs away from the lower arm by half a turn takes the rod where it does not reach."""
    robot, at = parallel_linkage()[0], Configuration("a", np.array([0.2, 0.1]))
    short = replace(robot.loops[0], rod=replace(robot.loops[0].rod, length=0.9))
    with refused("robot/loops"):
        geometric_torques(replace(robot, loops=(short,)), at, moved(8, 1.5), 2j * np.pi * 0.5 * np.arange(1, 9))
