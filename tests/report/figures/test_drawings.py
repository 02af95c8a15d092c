"""The catalogue of figures, and that of a map: two cuts, every posture a dot, the softest marked."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import result

from elastid.design.forecast import Forecast
from elastid.design.limits import QUANTITIES, LimitUse
from elastid.report.figures.fit import information, limit_use
from elastid.report.figures.use import SHOWN, workspace_figure
from elastid.use.map import WorkspaceMap, map_workspace


def forecast():
    """Two configurations of 4 lines, three parameters; the second line from the top is in the band of the first."""
    share = np.random.default_rng(0).random((2, 4, 3))
    share /= share.sum(axis=(0, 1))
    freq_hz = np.array([2.0, 10.0, 40.0, 40.1])
    return Forecast(("k", "d", "m"), ("",) * 3, np.ones(3), (True,) * 3, np.eye(3), ("a", "b"), freq_hz, share,
                    ())  # fmt: skip


def test_the_information_figure_shows_the_shares_of_the_forecast():
    """In percent: by octave, the mean over the parameters; by parameter, written where 0.5 %."""
    given = forecast()
    left, right = information(given).axes
    by_octave = np.asarray(left.images[0].get_array())
    assert by_octave.shape == (2, 5)  # from 2, 4, 8, 16 and 32 Hz
    np.testing.assert_allclose(by_octave[:, 2], 100 * given.share.mean(axis=2)[:, 1])
    np.testing.assert_allclose(by_octave.sum(axis=1), 100 * given.share.mean(axis=2).sum(axis=1))
    expected = 100 * given.share.sum(axis=1)
    np.testing.assert_allclose(right.images[0].get_array(), expected)
    assert [text.get_text() for text in right.texts] == [f"{value:.0f}" for value in expected.ravel()]
    assert [label.get_text() for label in left.get_yticklabels()] == ["a", "b"]
    assert left.get_ylim()[0] > left.get_ylim()[1]


def use():
    """Torque uses 80 % and 10 %; velocity has a limit for one motor."""
    peak, limit = np.ones((1, len(QUANTITIES), 2)), np.full((1, len(QUANTITIES), 2), np.inf)
    limit[0, 0] = 1.25, 10.0
    limit[0, 2, 0] = 2.0
    return LimitUse(("c1",), ("motor 1", "motor 2"), peak, limit, np.ones((1, 2)), margin=0.1)


def test_peaks_are_written_in_percent_of_their_limits():
    """A panel for each quantity with a limit; grey where a motor has none."""
    torque, velocity = limit_use(use()).axes
    np.testing.assert_allclose(torque.images[0].get_array(), [[80.0, 10.0]])
    assert [text.get_text() for text in torque.texts] == ["80", "10"]
    assert [text.get_text() for text in velocity.texts] == ["50"]
    assert "velocity" in velocity.get_title()
    assert [label.get_text() for label in torque.get_yticklabels()] == ["c1"]


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
