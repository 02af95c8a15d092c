"""Bars of a mode shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from plants.arm_modes import ARM, mode_row, swinging
from plants.report_values import modes

from elastid.base.display import number
from elastid.report.figures import style
from elastid.report.figures.modes import mode_shapes, mode_sketches
from elastid.report.modes import ModeDrawing, ModeRow, mode_drawing


def test_the_bars_of_a_mode_are_its_shape():
    """A row a mode, a bar a coordinate, its height the real part."""
    row = modes()
    figure = mode_shapes(row, "c1", True)
    assert len(figure.axes) == 2
    for m, axes in enumerate(figure.axes):
        bars = np.array(axes.collections[0].get_segments())
        np.testing.assert_allclose(bars[:, 1, 1] - bars[:, 0, 1] + 0.0, row.shapes[:, m].real)
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == list(row.coordinates)
    dashes = [
        lines[0] for axes in figure.axes if (lines := [one for one in axes.get_lines() if one.get_marker() == "_"])
    ]
    np.testing.assert_allclose([dash.get_ydata() for dash in dashes], row.shapes.T.imag)
    assert figure.axes[1].get_ylabel() == "14.20 Hz\n6.0 %"


def sketched(row: ModeRow, drawing: ModeDrawing) -> dict[tuple[int, tuple[int, int]], np.ndarray]:
    """Inches to a metre along both axes (3, 2) of the sticks at rest, at one end and at the other, view by view."""
    views = [(mode, view) for mode in range(len(row.frequency_hz)) for view in drawing.views(mode)]
    collections = mode_sketches(row, drawing, "c1", True).axes[0].collections
    colors = (style.WEAK, style.FITTED, style.MEASURED)
    sticks = [next(one for one in collections if to_hex(one.get_edgecolor()[0]) == color.lower()) for color in colors]
    drawn_at = [np.array(one.get_segments()).reshape(len(views), -1, 2) for one in sticks]
    pairs = np.array([link[:2] for link in drawing.links])
    found = {}
    for i, (mode, view) in enumerate(views):
        slopes = []
        for sign, inches in zip((0, -1, 1), drawn_at, strict=True):
            points = (drawing.points + sign * drawing.moved[:, :, mode].real)[pairs][..., list(view)].reshape(-1, 2)
            lines = [np.polyfit(points[:, k], inches[i, :, k], 1) for k in (0, 1)]
            for k in (0, 1):
                np.testing.assert_allclose(np.polyval(lines[k], points[:, k]), inches[i, :, k], atol=1e-9)
            slopes.append([line[0] for line in lines])
        found[mode, view] = np.array(slopes)
    return found


@pytest.mark.parametrize(("gravity", "up", "hanging"), [((0, -9.81, 0), 1, False), ((0, 0, 9.81), 2, True)])
def test_a_robot_hangs_as_gravity_has_it(gravity: tuple[float, float, float], up: int, hanging: bool) -> None:
    """The axis keeps its numbers and points down where the robot hangs from the ceiling."""
    robot = replace(ARM, gravity=gravity)
    _, freq_hz, shapes, figure = swinging(robot)
    drawing = mode_drawing(figure, shapes, gravity)
    assert drawing is not None
    assert (drawing.up, drawing.hanging) == (up, hanging)
    row = ModeRow("c1", freq_hz, 0.05 * np.ones(len(freq_hz)), drawing=drawing)
    for (_, (_, upwards)), slopes in sketched(row, drawing).items():
        assert slopes[0, 0] > 0
        assert (slopes[0, 1] < 0) == (hanging and upwards == up)


def test_the_sketches_show_rest_and_both_ends_to_one_scale() -> None:
    """Grey, orange and blue sticks at points - moved, points and points + moved, a panel for each view."""
    row = mode_row()
    drawing = row.drawing
    assert drawing is not None
    slopes = np.array([*sketched(row, drawing).values()])
    assert len(slopes) > len(row.frequency_hz)
    np.testing.assert_allclose(slopes, slopes[0, 0, 0])
    figure = mode_sketches(row, drawing, "c1", True)
    words = [text.get_text().replace("\u00a0", " ") for text in figure.axes[0].texts]
    assert f"mode 1: {number(row.frequency_hz[0])} Hz, 4.2 %\n92 % gear 2, 8 % rod" in words
    views = [view for mode in range(len(row.frequency_hz)) for view in drawing.views(mode)]
    assert [word for word in words if word.endswith("in m")] == [f"{'xyz'[a]} in m" for view in views for a in view]
    segments = np.concatenate([np.array(one.get_segments()).reshape(-1, 2) for one in figure.axes[0].collections])
    assert np.all((segments > 0) & (segments < figure.get_size_inches()))
