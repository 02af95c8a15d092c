"""Bars of a mode shape."""

from __future__ import annotations

import numpy as np
from plants.report_values import modes

from elastid.report.figures.modes import mode_shapes


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
