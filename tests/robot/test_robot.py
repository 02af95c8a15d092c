"""A robot refuses what no mechanism can be, and its numbers have names."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elastid.base.errors import StudyError
from elastid.robot import (
    Anchor,
    Body,
    Chain,
    CoilSpring,
    Compensator,
    Joint,
    Limits,
    Loop,
    Motor,
    Placement,
    Robot,
    Spring,
)
from elastid.robot.simplified import elastic_coordinates, stiffened

JOINT = Joint("1", "z", Spring(1e4, 10.0), Motor(1e-3, 100.0, 1e-3))


def one_joint(**body: object) -> Robot:
    """A robot of one body on one flexible joint."""
    return Robot("test", (Body("arm", joints=(JOINT,), **body),))  # type: ignore[arg-type]


@pytest.mark.parametrize("inertia", [(1.0, 1.0, 2.1), (1.0, 1.0, -0.1), (1.0, 1.0, 1.0, 0.0, 0.0, 1.5)])
def test_an_inertia_that_no_body_can_have_is_refused(inertia: tuple[float, ...]) -> None:
    """The triangle inequality of the principal moments, and their signs."""
    with pytest.raises(ValueError, match="no body has the principal inertias"):
        one_joint(inertia=inertia)


@given(
    points=st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=5),
)
def test_the_inertia_of_any_cloud_of_points_is_accepted(points: list[tuple[float, float, float]]) -> None:
    """Whatever has mass somewhere has a physical inertia, flat and thin bodies included."""
    p = np.array(points) - np.mean(points, axis=0)
    tensor = np.sum(p**2) * np.eye(3) - p.T @ p
    body = Body("cloud", inertia=tuple(tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))))
    np.testing.assert_allclose(body.inertia_matrix, tensor)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Motor(1e-3, 0.0), "gear ratio is 0"),
        (lambda: Motor(0.0), "inertia is 0"),
        (lambda: Motor(1e-3, viscous=-1.0), "viscous friction is -1; it must not be negative"),
        (lambda: Spring(0.0), "must be positive"),
        (lambda: Spring(1.0, -1.0), "must not be negative"),
        (lambda: Spring(1.0, quadratic=1.8, cubic=1.0), "loses its stiffness at a negative deflection"),
        (lambda: Loop("l", (Anchor("arm"), Anchor("arm"))), "both ends are on arm"),
        (lambda: Compensator("c", (Anchor("arm"), Anchor("arm")), CoilSpring(1.0)), "both ends are on arm"),
        (lambda: Chain(torque_damping=0.0), "torque_damping is 0; it must be positive"),
        (lambda: Joint("1", (0.0, 0.0, 0.0)), "zero vector"),
        (lambda: Limits(angle=(1.0, -1.0)), r"limits leave no motion: angle \[1, -1\]"),
        (lambda: Body("arm", mass=-1.0), "must not be negative"),
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
        make()  # type: ignore[operator]


def test_numbers_are_read_and_replaced_by_name() -> None:
    """with_parameters changes just what it names, and what it gives reads back."""
    robot = one_joint(mass=5.0, inertia=(1.0, 1.0, 1.5))
    values = {"k_1": 2e4, "d_1": 3.0, "Jm_1": 2e-3, "m_arm": 6.0, "c_arm_x": 0.1, "I_arm_zz": 1.6}
    changed = {name: value for name, (value, _) in robot.with_parameters(values).parameters().items()}
    assert changed == {name: value for name, (value, _) in robot.parameters().items()} | values
    with pytest.raises(StudyError, match="no parameter k_2"):
        robot.with_parameters({"k_2": 1.0})


@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_placement_is_a_rotation(rpy: tuple[float, float, float]) -> None:
    """R is orthogonal, right-handed, and roll comes first."""
    R = Placement(rpy=rpy).rotation
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    yaw_only = Placement(rpy=(0.0, 0.0, rpy[2])).rotation
    np.testing.assert_allclose(yaw_only @ [1, 0, 0], [np.cos(rpy[2]), np.sin(rpy[2]), 0], atol=1e-12)


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2])
def test_a_placement_is_found_from_its_rotation(pitch: float) -> None:
    """Roll and yaw turn about one axis at a pitch of +-90 deg; the rotation is the same."""
    placement = Placement((1.0, 2.0, 3.0), (0.7, pitch, -0.4))
    found = Placement.of(placement.rotation, np.array(placement.xyz))
    np.testing.assert_allclose(found.rotation, placement.rotation, atol=1e-12)
    assert found.xyz == placement.xyz


def test_a_spring_may_soften_as_long_as_its_tangent_stays_positive() -> None:
    """quadratic^2 < 3 k cubic."""
    assert Spring(1.0, quadratic=1.7, cubic=1.0).quadratic == 1.7


def test_a_shaft_spring_alone_makes_a_gear_elastic() -> None:
    """It counts among the elastic coordinates, and goes with them."""
    shaft = replace(JOINT, spring=None, motor=replace(JOINT.motor, spring=Spring(5.0)))
    robot = Robot("r", (Body("arm", joints=(shaft, Joint("1x", "x", Spring(1e5)))),))
    assert [each.label for each in elastic_coordinates(robot)] == ["gear 1", "1x"]
    assert elastic_coordinates(stiffened(robot, ["1", "1x"])) == ()


def test_places_are_known_by_name() -> None:
    """`motor`, `joint` and `body ... axis` exist; anything else is refused with the list of those there are."""
    robot = one_joint()
    for place in ("motor 1", "joint 1", "body arm z"):
        robot.check_location(place)
    with pytest.raises(StudyError, match=r"motor 1, joint 1, body arm x"):
        robot.check_location("motor 2")


def test_the_branches_of_a_loop_end_where_both_ends_are_carried() -> None:
    """From each end towards the base, as far as the joints differ; all of them are joints in loops."""
    names = ("turret", "lever", "arm", "rod", "tip")
    parents = ("base", "turret", "turret", "lever", "arm")
    joints = [replace(JOINT, name=f"j{i}") for i in range(len(names))]
    bodies = tuple(Body(n, p, joints=(j,)) for n, p, j in zip(names, parents, joints, strict=True))
    loops = (
        Loop("l", (Anchor("rod"), Anchor("tip", (1.0, 0.0, 0.0)))),
        Loop("m", (Anchor("base"), Anchor("lever"))),
        Loop("n", (Anchor("arm"), Anchor("tip"))),
    )
    robot = Robot("r", bodies, loops=loops)
    assert robot.branches == (((3, 1), (4, 2)), ((), (1, 0)), ((), (4,)))
    assert robot.joints_in_loops == (0, 1, 2, 3, 4)
    assert replace(robot, loops=loops[2:]).joints_in_loops == (4,)


def test_driven_joints_are_counted_and_found() -> None:
    """Their indices among all joints; as many numbers as driven joints, or a message with both counts."""
    elastic = Joint("1x", "x", Spring(1e5))
    robot = Robot("r", (Body("arm", joints=(elastic, JOINT)), Body("tip", "arm", joints=(replace(JOINT, name="2"),))))
    assert robot.driven_indices == (1, 2)
    assert robot.count_refusal(2) == ""
    assert robot.count_refusal(3, "torques") == "3 torques for 2 driven joints (1, 2) of robot r; give one for each"


@pytest.mark.parametrize(
    ("loop", "says"),
    [
        (Loop("arm", (Anchor("base"), Anchor("tip"))), "loop arm: a body, joint or loop has this name"),
        (Loop("1", (Anchor("base"), Anchor("tip"))), "loop 1: a body, joint or loop has this name"),
        (Loop("l", (Anchor("base"), Anchor("tipp"))), "loop l: no body is called tipp; did you mean 'tip'"),
    ],
)
def test_a_loop_joins_bodies_and_has_a_name_of_its_own(loop: Loop, says: str) -> None:
    """Its parameters could not be distinguished from those of a body or joint."""
    with pytest.raises(ValueError, match=says):
        Robot("r", (Body("arm", joints=(JOINT,)), Body("tip", "arm")), loops=(loop,))


def test_places_of_a_sliding_joint_and_origins_of_frames_translate() -> None:
    """Motor and joint alike; bodies and what turns are measured in rad."""
    rail = replace(JOINT, name="rail", motion="translation")
    robot = Robot("r", (Body("cart", joints=(rail,)), Body("arm", "cart", joints=(JOINT,))))
    places = ("motor rail", "joint rail", "motor 1", "joint 1", "body arm x")
    assert robot.sliding(places) == ("motor rail", "joint rail")
    assert [robot.slides(place) for place in ("accelerometer tcp x", "frame tcp x", "frame tcp rx")] == [
        True,
        True,
        False,
    ]
