"""The figure of a map: two cuts, every posture a dot of its value, the softest marked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.predicted_arm import result

from elastid.report.figures.use import SHOWN, workspace_figure
from elastid.use.map import WorkspaceMap, map_workspace

ANGLES = np.array([[0.2, 0.4], [-0.7, 1.1], [0.9, -0.5], [0.1, 0.05]])


@pytest.fixture(scope="module")
def workspace() -> WorkspaceMap:
    return map_workspace(result(), ANGLES, name="arm")


def test_dots_are_positions_coloured_by_the_value(workspace: WorkspaceMap) -> None:
    """From above x, y, from the side the distance from the axis and z; colours in the unit of the figure."""
    figure = workspace_figure(workspace)
    above, side, _ = figure.axes
    dots = above.collections[0]
    order = np.argsort(workspace["softest_compliance"].value)
    np.testing.assert_allclose(dots.get_offsets(), workspace.position[order, :2])
    np.testing.assert_allclose(dots.get_array(), 1e6 * workspace["softest_compliance"].value[order])
    distance = np.hypot(*workspace.position[order, :2].T)
    np.testing.assert_allclose(
        side.collections[0].get_offsets(), np.column_stack([distance, workspace.position[order, 2]])
    )
    marked = above.lines[0]
    soft = workspace.softest[0]
    np.testing.assert_allclose([marked.get_xdata()[0], marked.get_ydata()[0]], workspace.position[soft, :2])


@pytest.mark.parametrize("quantity", ["frequency_1", "depth_of_cut", "deflection"])
def test_every_quantity_has_a_unit_and_a_title(workspace: WorkspaceMap, quantity: str) -> None:
    """Also where some values are infinite: nothing chatters there."""
    values = workspace[quantity].value.copy()
    values[0] = np.inf
    own = replace(workspace, quantities=(replace(workspace[quantity], value=values), *(
        each for each in workspace.quantities if each.name != quantity
    )))  # fmt: skip
    figure = workspace_figure(own, quantity)
    assert SHOWN[own[quantity].unit][0] in figure.axes[-1].get_ylabel()
