"""Positions of points, as expressions too, and their Jacobians: rotation matrices, closed forms, differences."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.linkages import linkage

from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes, robot_shapes
from elastid.model.formulation import formulate
from elastid.model.frame_tree import between, position, seat, tree, turns
from elastid.model.kinematics import frame_poses, stick_figure
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import (
    Anchor,
    Body,
    CoilSpring,
    Compensator,
    Frame,
    Joint,
    Motor,
    Payload,
    Placement,
    Robot,
    Rod,
    Spring,
)

GANTRY = Robot(
    "gantry",
    (
        Body("column", "base", Placement((0.1, 0, 0.2), (0.1, 0.2, 0.3)), (), 2.0, (0.02, 0, 0.1)),
        Body("carriage", "column", Placement((0.1, 0.2, 0.3)),
             (Joint("x", (1, 2, 3), Spring(1e6), Motor(1e-3, 600.0), motion="translation"),
              Joint("rx", "x", Spring(1e5))),
             30.0, (0.1, 0, 0), 1.0),
        Body("arm", "carriage", Placement((0, 0.5, 0), (0.3, 0, 0)), (Joint("a", (0, 1, 1), Spring(1e5), Motor(1e-3)),),
             20.0, (0.2, 0, 0.1), 1.0),
        Body("hand", "arm", Placement((0.4, 0, 0)), (Joint("h", "z", Spring(1e4)),), 5.0, (0, 0, 0.1), 0.1),
    ),
    frames=(Frame("tool", "hand", Placement((0.1, 0.2, 0.05), (0, 1, 0))),),
    compensators=(Compensator("coil", (Anchor("base", (1, 0, 0)), Anchor("arm", (0.2, 0, 0))), CoilSpring(100.0)),),
)  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-2, 2), min_size=8, max_size=8))
def test_every_point_moves_by_its_jacobian(numbers: list[float]) -> None:
    """Joints that turn and slide about oblique axes: differences of the figure's own points and of the tool's pose."""
    q, dq = np.split(np.array(numbers), 2)
    h = 1e-6
    drawn = stick_figure(GANTRY, q)
    ahead, behind = (stick_figure(GANTRY, q + sign * h * dq) for sign in (1, -1))
    np.testing.assert_allclose(drawn.jacobian @ dq, (ahead.points - behind.points) / (2 * h), atol=1e-8)
    poses = frame_poses(GANTRY, np.stack([q + h * dq, q - h * dq, q]), "tool")
    np.testing.assert_allclose(drawn.points[-1], poses.position[2], atol=1e-12)
    np.testing.assert_allclose(drawn.jacobian[-1] @ dq, (poses.position[0] - poses.position[1]) / (2 * h), atol=1e-8)


def test_drawing_has_centre_of_mass_and_strut_end() -> None:
    drawn = stick_figure(GANTRY, np.array([0.3, 0.0, -0.7, 0.0]))
    assert "mass" not in {kind for _, _, kind in drawn.links}  # the hand carries the tool
    ((first, *_),) = [link for link in drawn.links if link[2] == "strut"]
    np.testing.assert_allclose(drawn.points[first], [1, 0, 0])


@pytest.mark.parametrize("kind", ["constrained", "minimal"])
@pytest.mark.parametrize("rod", [Rod(0.86, 6, 0.4, 0.5, 1e7), Rod(0.86, 6, 0.4, 0.5)], ids=["elastic", "rigid"])
def test_drawn_rod_stretches_as_in_model(kind: str, rod: Rod) -> None:
    """Between its ends; in every mode the ends part by the elongation, which a rigid rod has none of."""
    robot = linkage(rod, crank=0.33, spatial=True)
    model = formulate(robot, ModelSpec(kind))
    at = Configuration("c", np.array([0.4, 0.2, -0.3]))
    linear = linearise(model, at, model.theta, model.inputs, "position")
    shapes = robot_shapes(linear, modes(linear, linear.theta_ref).shapes)
    point = equilibrium(model, model.theta, at)
    n_l = len(robot.joints)
    drawn = stick_figure(robot, point.q[:n_l])
    ((a, b, _),) = [link for link in drawn.links if link[2] == "strut"]
    gap = drawn.points[b] - drawn.points[a]
    stretch = point.q[-1] if model.coordinates[-1] == "rod rod" else np.linalg.norm(gap) - 0.86
    assert np.linalg.norm(gap) == pytest.approx(0.86 + (stretch if rod.is_elastic else 0.0), abs=1e-9)
    parting = gap @ (drawn.jacobian[b] - drawn.jacobian[a]) @ shapes[:n_l] / np.linalg.norm(gap)
    _, rows = model.strain(point.q, model.theta)
    expected = rows.full()[model.springs.index("k_rod")] @ shapes if rod.is_elastic else 0.0
    np.testing.assert_allclose(parting, expected, atol=1e-9)
    assert (np.abs(parting).max() > 1e-3) == rod.is_elastic


POINTS = {"a": (0.1, 0.2, -0.3), "b": (0.3, -0.1, 0.2), "c": (0.0, 0.4, 0.1)}


def forked(second: str = "rotation", third: str = "rotation") -> Robot:
    """A trunk that carries two arms, one about an oblique axis; joints 2 and 3 may slide; it carries something."""

    def joint(name: str, axis: str | tuple[float, float, float]) -> Joint:
        motion = {"2": second, "3": third}.get(name, "rotation")
        return Joint(name, axis, motor=Motor(1e-3), motion=motion)

    return Robot(
        "forked",
        (
            Body("a", "base", Placement((0.1, 0, 0.5), (0.2, 0, 0)), (joint("1", "z"), joint("2", "y")), 1.0),
            Body("b", "a", Placement((0.4, 0.1, 0), (0, 0.3, 0.1)), (joint("3", (1.0, 2.0, 0.5)),), 1.0),
            Body("c", "a", Placement((0, 0.2, 0.3)), (joint("4", "x"),), 1.0),
        ),
        payload=Payload(2.0, at="b"),
    )


MOTIONS = st.sampled_from(["rotation", "translation"])


@given(angles=st.tuples(*[st.floats(-3, 3)] * 4), second=MOTIONS, third=MOTIONS)
@settings(deadline=None, max_examples=30)
def test_points_are_where_rotation_matrices_put_them(angles, second, third):
    """Position in the base frame, and the distance of two points in the frame that carries both."""
    robot = forked(second, third)
    layout = tree(robot)
    q = ca.SX.sym("q", 4)
    turned = turns(layout, q)
    marked = replace(robot, frames=tuple(Frame(f"on_{name}", name, Placement(at)) for name, at in POINTS.items()))
    expected = {name: frame_poses(marked, np.array([angles]), f"on_{name}").position[0] for name in POINTS}
    ends = {name: (seat(robot, layout, name), point) for name, point in POINTS.items()}
    for name, (at, point) in ends.items():
        p = ca.Function("p", [q], [position(layout, turned, at, point)])(angles).full()[:, 0]
        np.testing.assert_allclose(p, expected[name], atol=1e-14)
    vector = between(layout, turned, ends["b"], ends["c"])
    length = float(ca.Function("L", [q], [ca.norm_2(vector)])(angles))
    assert length == pytest.approx(float(np.linalg.norm(expected["c"] - expected["b"])), abs=1e-14)
    # Only the joints between them are in the expression: 3 and 4, not the trunk's.
    assert not ca.depends_on(vector, q[:2])
