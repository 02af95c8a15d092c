"""A mode as displacements of the robot's sticks: scale, phase, views."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.arm_modes import ARM, MOTOR, drawn, swinging

from elastid.model.kinematics import frame_poses
from elastid.model.stick_figure import stick_figure
from elastid.report.figures.mode_sketches import mode_sketches
from elastid.report.modes.mode_drawing import SWING, mode_drawing
from elastid.report.modes.mode_row import ModeRow
from elastid.report.page.page import rendered
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring


def test_the_tool_moves_as_the_shape_moves_the_kinematics() -> None:
    """By one factor in all directions: differences of the pose along real and imaginary part of the shape."""
    q, freq_hz, shapes, figure = swinging()
    drawing = mode_drawing(figure, shapes, ARM.gravity)
    assert drawing is not None
    for mode in range(len(freq_hz)):
        h, tool = 1e-6, []
        for part in (shapes[:, mode].real, shapes[:, mode].imag):
            ends = frame_poses(ARM, np.stack([q + h * part, q - h * part]), "tool").position
            tool.append((ends[0] - ends[1]) / (2 * h))
        expected, moved = tool[0] + 1j * tool[1], drawing.moved[-1, :, mode]
        factor = (expected.conj() @ moved) / (expected.conj() @ expected)
        np.testing.assert_allclose(moved, factor * expected, atol=1e-6 * np.abs(moved).max())


def test_every_mode_swings_by_the_same_part_of_the_robot_s_size() -> None:
    """And at t = 0 further than at any other time, however the damping turns the phases."""
    drawing = drawn()
    furthest = np.linalg.norm(drawing.moved.real, axis=1).max(axis=0)
    np.testing.assert_allclose(furthest, SWING * np.ptp(drawing.points, axis=0).max())
    turned = [((drawing.moved * np.exp(1j * a)).real ** 2).sum(axis=(0, 1)) for a in np.linspace(0, np.pi, 60)]
    assert np.all(turned[0] >= np.max(turned, axis=0) * (1 - 1e-12))


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(-np.pi, np.pi))
def test_a_drawing_knows_neither_length_nor_phase_of_a_shape(length: float, phase: float) -> None:
    _, _, shapes, figure = swinging()
    one, other = (mode_drawing(figure, z * shapes, ARM.gravity) for z in (1.0, length * np.exp(1j * phase)))
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.moved, other.moved, atol=1e-9)


def test_a_plane_mode_has_one_view_and_another_two() -> None:
    """Up is up; the second view shows what the first cannot."""
    plane = drawn(angles=(0.0, 0.3, -0.2))
    views = [plane.views(mode) for mode in range(plane.moved.shape[2])]
    assert {len(pair) for pair in views} == {1, 2}
    for mode, pair in enumerate(views):
        largest = np.abs(plane.moved[:, :, mode]).max(axis=0)
        (missing,) = {0, 1, 2} - set(pair[0])
        assert (len(pair) == 1) == (largest[missing] <= 0.1 * largest.max())
        assert len(pair) == 1 or set(pair[0]) | set(pair[1]) == {0, 1, 2}
        assert all(2 not in view or view[1] == 2 for view in pair)


def test_a_robot_seen_end_on_is_no_view_of_it() -> None:
    """A pole swings to all sides: from the side, not from above, where it is a point."""
    pole = Robot(
        "pole",
        (
            Body("a", joints=(Joint("1", "x", Spring(1e5), MOTOR), Joint("2", "y", Spring(1e5))), mass=10,
                 center_of_mass=(0, 0, 1.0), inertia=1.0),
        ),
        gravity=(0, 0, 0),
    )  # fmt: skip
    figure = stick_figure(pole, np.zeros(2))
    drawing = mode_drawing(figure, np.array([[1.0], [0.9]], complex), pole.gravity)
    assert drawing is not None
    assert set(drawing.views(0)) == {(0, 2), (1, 2)}


def test_where_nothing_is_seen_to_move_nothing_is_drawn() -> None:
    """All points in one; a motor alone; and one mode that moves no point beside one that does."""
    one_point = Robot("bench", (Body("load", joints=(Joint("1", "z", Spring(50.0), MOTOR),), inertia=1e-3),))
    _, _, shapes, figure = swinging(one_point, (0.0,))
    assert shapes.size
    assert mode_drawing(figure, shapes, (0, 0, 0)) is None
    figure = stick_figure(ARM, np.zeros(5))
    assert mode_drawing(figure, np.zeros((5, 2), complex), ARM.gravity) is None
    assert mode_drawing(figure, np.zeros((5, 0), complex), ARM.gravity) is None
    one = mode_drawing(figure, np.eye(5, 2, dtype=complex) * [1.0, 1e-9], ARM.gravity)
    assert one is not None
    assert np.abs(one.moved[:, :, 0]).max() > 0.1
    assert not one.moved[:, :, 1].any()
    rendered(mode_sketches(ModeRow("c", np.ones(2), np.ones(2)), one, "c", True), "png")


def test_a_slide_moves_along_its_axis() -> None:
    """Straight, and its mode is drawn."""
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, 600.0), motion="translation")
    load = Body("load", "carriage", Placement((0, 0, 0.3)), (Joint("e", "x", Spring(8e5), motion="translation"),), 25)
    drawing = drawn(Robot("slide", (Body("carriage", joints=(joint,), mass=40), load)), (0.3,))
    assert not drawing.moved[:, 1:].any()
    assert drawing.views(0) == ((0, 2),)
