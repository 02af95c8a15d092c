"""Positions of bodies' points as expressions, against the same positions worked out with rotation matrices."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.model.frame_tree import between, position, seat, tree, turns
from elastid.model.kinematics import skeleton
from elastid.robot import Body, Joint, Motor, Payload, Placement, Robot

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
    drawn = skeleton(robot, np.array([angles]), {name: [point] for name, point in POINTS.items()})
    expected = {name: drawn.points[0, drawn.names.index(f"point 1 of {name}")] for name in POINTS}
    ends = {name: (seat(robot, layout, name), point) for name, point in POINTS.items()}
    for name, (at, point) in ends.items():
        p = ca.Function("p", [q], [position(layout, turned, at, point)])(angles).full()[:, 0]
        np.testing.assert_allclose(p, expected[name], atol=1e-14)
    vector = between(layout, turned, ends["b"], ends["c"])
    length = float(ca.Function("L", [q], [ca.norm_2(vector)])(angles))
    assert length == pytest.approx(float(np.linalg.norm(expected["c"] - expected["b"])), abs=1e-14)
    # Only the joints between them are in the expression: 3 and 4, not the trunk's.
    assert not ca.depends_on(vector, q[:2])
