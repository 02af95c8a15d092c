"""A part that swings on the last body: its pattern is that of a body on a hinge, and a fit names it first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.elastic_arm import CONFIGURATIONS, FREQ, arm
from plants.faults import SPEC, drawn, exact, true_case

from elastid.fit.diagnosis.swinging_part import with_part
from elastid.fit.identify import identify
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import FRAME_AXES, Body, Frame, Joint, Placement, Robot, Spring, Tolerances

MASS, INERTIA, HINGE, LEVER, FREQ_HZ = 6.0, 0.05, np.array([0.5, 0.1, 0.05]), 0.2, 25.0
# Torque about z of the hinge, whose centre of mass is off it along x: h = m (e_z x r) and I e_z + r x m (e_z x r).
SWINGING = INERTIA + MASS * LEVER**2
STIFFNESS = SWINGING * (2 * np.pi * FREQ_HZ) ** 2


def with_tool(robot: Robot, spring: Spring | None) -> Robot:
    """The arm with a tool on its fore arm, on a hinge where there is a spring."""
    joints = () if spring is None else (Joint("plate", "z", spring),)
    tool = Body("tool", "fore", Placement(tuple(HINGE)), joints, MASS, (LEVER, 0.0, 0.0), (INERTIA,) * 3)
    return replace(robot, bodies=(*robot.bodies, tool))


def test_a_body_on_a_hinge_has_the_response_of_the_rigid_one_with_its_pattern() -> None:
    """Without gravity, to 1e-6: the further coordinate is the hinge's turn times the root of its inertia."""
    loss = 1e-3
    robot = replace(arm(), gravity=(0.0, 0.0, 0.0))
    rigid = with_tool(robot, None)
    marked = replace(rigid, frames=(*rigid.frames, Frame("mark", "fore", Placement(tuple(HINGE)))))
    model, swinging = serial(marked), serial(with_tool(robot, Spring(STIFFNESS, loss * STIFFNESS)))
    configuration, places = Configuration("c", CONFIGURATIONS[1]), tuple(f"frame mark {axis}" for axis in FRAME_AXES)
    linear = linearise(model, configuration, model.theta, marked.motor_locations, "acceleration")
    J = linearise(model, configuration, model.theta, places, "position").C
    free = with_part(linear, J, linear.theta_ref)
    pattern = np.array([0.0, MASS * LEVER, 0.0, 0.0, 0.0, SWINGING]) / np.sqrt(SWINGING)
    theta = free.theta_ref.copy()
    theta[-8:] = np.concatenate([[1.0, loss], [0.0] * 6]) * (2 * np.pi * FREQ_HZ) ** 2
    theta[-6:] = pattern
    own = linearise(swinging, configuration, swinging.theta, marked.motor_locations, "acceleration")
    expected = to_response(own, own.theta_ref, FREQ).G
    np.testing.assert_allclose(to_response(free, theta, FREQ).G, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
def test_a_tool_that_swings_is_named_first() -> None:
    """The file has it as rigid, and V is 1.5 of the noise's: its resonance to 5 %, and its words."""
    case = true_case()
    truth = with_tool(case.truth, Spring(STIFFNESS, 1e-4 * STIFFNESS))
    data = drawn(replace(case, responses=exact(truth)), np.random.default_rng(0))
    result = identify(data, with_tool(case.robot, None), SPEC)
    first = result.indices[0]
    assert first.group == "swinging part"
    assert first.share > 0.6
    sentence = next(note.text for note in result.notes if note.code == "fit/likely-cause")
    assert first.steps[0] == pytest.approx(FREQ_HZ, rel=0.05)
    assert sentence.startswith(f"a part of fore that swings at {first.steps[0]:.3g} Hz")


@pytest.mark.parametrize("freq_hz", [120.0, 170.0])
def test_a_tool_beyond_the_band_has_a_word_with_its_size(freq_hz: float) -> None:
    """An eighth of the fore arm that slides along z at the link's end; tolerances take it up, and a stiffness is off.

    The note has the error at 120 Hz, twice the end of the band; it falls with the square of the resonance.
    """
    case, mass = true_case(), 75 / 8
    slide = Joint("plate", "z", Spring(mass * (2 * np.pi * freq_hz) ** 2, 1.0), motion="translation")
    of_tool = {"mass": mass, "inertia": (1e-3,) * 3}
    end = Placement(tuple(2 * np.array(case.robot.bodies[-1].center_of_mass)))
    truth, rigid = (
        replace(case.robot, bodies=(*case.robot.bodies, Body("tool", "fore", end, joints, **of_tool)))
        for joints in ((slide,), ())
    )
    data = drawn(replace(case, responses=exact(truth)), np.random.default_rng(0))
    result = identify(data, replace(rigid, tolerances=Tolerances()), SPEC)
    assert result.status == "converged"
    (note,) = [note.text for note in result.notes if note.code == "fit/undetectable"]
    stated = float(note.split("makes errors of ")[1].split(" % in k_2")[0]) / 100
    error = 1 - result.values["k_2"] / truth.parameters()["k_2"][0]
    assert stated * (120 / freq_hz) ** 2 == pytest.approx(error, abs=0.3 * stated + 2 * result.std["k_2"] / 1.8e5)
    assert error > result.std["k_2"] / 1.8e5
