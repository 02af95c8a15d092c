"""Two links with elastic gears, robots off their file as data sheets are; responses of them."""

import math

import numpy as np

from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring, Tolerances
from plants.measured_robots import responses_of

FREQ = np.linspace(2, 50, 40)
POSTURES = ((0.3, 0.2), (0.9, -0.6), (-0.5, 1.0))
SPEC = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=1, seed=1)


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
