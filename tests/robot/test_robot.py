"""A robot refuses what no mechanism can be, and its numbers have names."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elastid.robot import (
    Anchor,
    Body,
    CoilSpring,
    Compensator,
    Frame,
    Joint,
    Limits,
    Loop,
    Motor,
    Pin,
    Placement,
    Robot,
    Rod,
    Spring,
)

JOINT = Joint("1", "z", Spring(1e4, 10.0), Motor(1e-3, 100.0, 1e-3))


def one_joint(**body: object) -> Robot:
    """A robot of one body on one flexible joint."""
    return Robot("test", (Body("arm", joints=(JOINT,), **body),))


@pytest.mark.parametrize("inertia", [(1.0, 1.0, 2.1), (1.0, 1.0, -0.1), (1.0, 1.0, 1.0, 0.0, 0.0, 1.5)])
def test_an_inertia_that_no_body_can_have_is_refused(inertia: tuple[float, ...]) -> None:
    """The triangle inequality of the principal moments, and their signs."""
    one_joint(inertia=(1.0, 1.0, 2.0))  # the limit: a flat body
    with pytest.raises(ValueError, match="inertia of body arm: "):
        one_joint(inertia=inertia)


@given(points=st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=5))
def test_the_inertia_of_any_cloud_of_points_is_accepted(points: list[tuple[float, float, float]]) -> None:
    """Whatever has mass somewhere has a physical inertia, flat and thin bodies included."""
    p = np.array(points) - np.mean(points, axis=0)
    tensor = np.sum(p**2) * np.eye(3) - p.T @ p
    body = Body("cloud", inertia=tuple(tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))))
    np.testing.assert_allclose(body.inertia_matrix, tensor)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Motor(1e-3, 0.0), "^ratio is 0"),
        (lambda: Spring(1.0, quadratic=1.8, cubic=1.0), "at a negative deflection of 0.437 rad"),
        (lambda: Loop("l", (Anchor("arm"), Anchor("arm"))), "both ends are on arm"),
        (lambda: Loop("l", (Anchor("lever"), Anchor("arm")), Pin(), Rod(0.5)), "not both"),
        (lambda: Compensator("c", (Anchor("arm"), Anchor("arm")), CoilSpring(1.0)), "both ends are on arm"),
        (lambda: Joint("1", (0.0, 0.0, 0.0)), "zero vector"),
        (lambda: Limits(angle=(1.0, -1.0)), "^angle: "),
        (lambda: Robot("r", (Body("arm", parent="nobody", joints=(JOINT,)),)), "its parent nobody"),
        (lambda: Robot("r", (Body("arm", joints=(JOINT, JOINT)),)), "joint 1 is given twice"),
        (
            lambda: Robot("r", (Body("arm", joints=(replace(JOINT, motor=Motor(1e-3, on="amr", axis="z")),)),)),
            "motor.on.* amr",
        ),
        (lambda: Robot("r", (Body("arm", joints=(replace(JOINT, motor=None),)),)), "nothing to excite"),
    ],
)
def test_what_no_mechanism_can_be_is_refused(make: object, says: str) -> None:
    """Each message names the number at fault."""
    with pytest.raises(ValueError, match=says):
        make()


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2])
def test_a_placement_is_found_from_its_rotation(pitch: float) -> None:
    """Roll and yaw turn about one axis at a pitch of +-90 deg; the rotation is the same."""
    placement = Placement((1.0, 2.0, 3.0), (0.7, pitch, -0.4))
    found = Placement.of(placement.rotation, np.array(placement.xyz))
    np.testing.assert_allclose(found.rotation, placement.rotation, atol=1e-12)
    assert found.xyz == placement.xyz


@pytest.mark.parametrize(
    ("loop", "says"),
    [
        (Loop("arm", (Anchor("base"), Anchor("tip"))), "loop arm: a body, joint or loop has this name"),
        (Loop("1", (Anchor("base"), Anchor("tip"))), "loop 1: a body, joint or loop has this name"),
        (Loop("l", (Anchor("base"), Anchor("tipp"))), "loop l: no body is called tipp; did you mean 'tip'"),
    ],
)
def test_loop_joins_bodies_under_unique_name(loop: Loop, says: str) -> None:
    """Its parameters could not be distinguished from those of a body or joint."""
    with pytest.raises(ValueError, match=says):
        Robot("r", (Body("arm", joints=(JOINT,)), Body("tip", "arm")), loops=(loop,))


ENDS = (Anchor("lever"), Anchor("arm"))


def test_only_an_elastic_rod_has_stiffness_and_damping_as_parameters() -> None:
    assert set(Loop("pull", ENDS, rod=Rod(0.5)).numbers) == {"m_pull", "a_pull", "I_pull"}
    assert {"k_pull", "d_pull"} < set(Loop("pull", ENDS, rod=Rod(0.5, stiffness=1e6)).numbers)
    with pytest.raises(ValueError, match="a rigid rod does not stretch"):
        Rod(0.5, damping=1.0)


def test_places_that_translate_are_in_metres():
    """Origins of frames, accelerometers and forces; their rotations and torques, and turning joints are not."""
    robot = replace(one_joint(), frames=(Frame("tool", "arm"),))
    turning = ("motor 1", "joint 1", "frame tool rz", "torque tool z")
    moving = ("frame tool z", "accelerometer tool x", "force tool y")
    assert robot.sliding((*turning, *moving)) == moving
