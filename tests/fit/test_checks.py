"""Responses of other postures than the study declares are distinguished from measurements that were repeated at one."""

from dataclasses import replace

import numpy as np
import pytest
from plants.measured_robots import responses_of
from plants.notes import said

from elastid.fit.checks import find_contradictions
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


def test_three_postures_declared_as_one_are_reported() -> None:
    """All three pairs, by how much they differ, and what to correct; beside the result of the fit as well."""
    responses = [measured(arm(), angles, "c" * (i + 1)) for i, angles in enumerate(POSTURES)]
    (note,) = find_contradictions(responses, {})
    assert note.severity == "warning"
    assert "differ: c and cc, c and ccc, cc and ccc, by up to 1" in note.text
    result = identify(responses, arm(), FitSpec(starts=1, seed=0))
    assert note.text in said(result.notes)


@pytest.mark.slow
def test_amplitudes_of_a_posture_that_differ_are_no_two_robots() -> None:
    """A spring that is stiffer at the larger one."""
    responses = [measured(arm(), POSTURES[0], "one"), measured(arm(k_1=9e4), POSTURES[0], "one level 2")]
    assert find_contradictions(responses, {}) == ()
    notes = said(identify(responses, arm(), FitSpec(starts=1, seed=0)).notes)
    for wrong in ("two robots", "under two names", "correct the angles"):
        assert wrong not in notes
