"""An arm of two elastic axes with two further elastic rotations, a pendulum on an elastic joint, their responses."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from plants.measured_robots import responses_of

FREQ = np.linspace(2, 60, 60)
CONFIGURATIONS = ((0.0, 0.0), (0.6, -0.7), (-0.4, 0.9))


def arm(k_1=3e5, k_2=1.8e5, gravity=9.81) -> Robot:
    """Two driven elastic joints, each with a further elastic rotation."""
    upper = Body(
        "upper",
        joints=(Joint("1", "y", Spring(k_1, 500), Motor(2.5e-3, 120, 1.5e-3)), Joint("1x", "x", Spring(4e5, 300))),
        mass=60,
        center_of_mass=(0.05, 0, 0.4),
        inertia=(6.0, 6.2, 0.8),
    )
    fore = Body(
        "fore",
        "upper",
        Placement((0, 0, 0.85)),
        (Joint("2", "y", Spring(k_2, 250), Motor(1.6e-3, 110, 1.2e-3)), Joint("2z", "z", Spring(1e5, 100))),
        mass=75,
        center_of_mass=(0.45, 0.05, 0.1),
        inertia=(1.5, 11, 11.0),
    )
    return Robot("arm", (upper, fore), gravity=(0.0, 0.0, -gravity))


def pendulum() -> Robot:
    """One driven elastic joint about the vertical, without gravity."""
    joint = Joint("1", "z", Spring(100.0, 0.05), Motor(1e-3, viscous=1e-3), 1e-3)
    return Robot("pendulum", (Body("load", joints=(joint,), inertia=2e-3),), gravity=(0.0, 0.0, 0.0))


def measure(robot, configurations=CONFIGURATIONS, rng=None, delay=0.0, outputs=None) -> list[Response]:
    """Responses with 2 % noise whose variance was estimated from 6 degrees of freedom, or exact ones."""
    further = () if outputs is None else outputs[len(robot.driven) :]
    if rng is None:
        return responses_of(robot, configurations, None, FREQ, further=further, delay=delay)
    noisy = responses_of(robot, configurations, rng, FREQ, further=further, delay=delay, dof=6.0)
    return [replace(response, noise=None, total=response.noise) for response in noisy]


def started_elsewhere(robot: Robot, by: float, seed: int = 0) -> Robot:
    """The robot with every stiffness, damping and friction off by a factor of up to `by`."""
    rng = np.random.default_rng(seed)
    numbers = {name: value for name, (value, _) in robot.parameters().items() if name[:2] in ("k_", "d_", "fm", "k3")}
    return robot.with_parameters({n: v * float(by ** rng.uniform(-1, 1)) for n, v in numbers.items()})


@pytest.fixture(scope="module")
def measured() -> tuple[Response, ...]:
    return tuple(measure(arm(), rng=np.random.default_rng(4)))


@pytest.fixture(scope="module")
def result(measured) -> Result:
    return identify(measured, started_elsewhere(arm(), 1.3), FitSpec(starts=1))
