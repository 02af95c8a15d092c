"""Responses of other postures than the study declares."""

from dataclasses import replace

import numpy as np
from plants.measured_robots import responses_of

from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec
from elastid.record import Configuration
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

FREQ_HZ = np.linspace(2, 50, 40)
POSTURES = ((0.3, 0.2), (0.9, -0.6), (-0.5, 1.0))


def arm(k_1: float = 3e4, friction: float = 1e-2) -> Robot:
    """Two links in a vertical plane with elastic gears."""
    shoulder = Joint("1", "y", Spring(k_1, 60), Motor(2e-3, 60, friction))
    elbow = Joint("2", "y", Spring(2e4, 40), Motor(1e-3, 60, friction))
    upper = Body("upper", joints=(shoulder,), mass=40, center_of_mass=(0, 0, 0.4), inertia=3.0)
    fore = Body("fore", "upper", Placement((0, 0, 0.8)), (elbow,), 25.0, (0.3, 0, 0), 1.0)
    return Robot("arm", (upper, fore))


def measured(robot: Robot, angles: tuple[float, float], name: str) -> Response:
    """The response in a posture with 2 % noise of known variance, declared to be in the first one."""
    (response,) = responses_of(robot, {name: angles}, np.random.default_rng(len(name)), FREQ_HZ)
    return replace(response, configuration=Configuration(name, POSTURES[0]))


def test_three_postures_declared_as_one_have_wrong_angles() -> None:
    """A misfit, whose likeliest cause are the angles."""
    responses = [measured(arm(), angles, "c" * (i + 1)) for i, angles in enumerate(POSTURES)]
    result = identify(responses, arm(), FitSpec(starts=1, seed=0))
    assert result.status == "misfit"
    assert result.indices[0].name == "angles_2"
