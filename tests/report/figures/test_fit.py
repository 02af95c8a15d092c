"""Figures of fits, plans, torques and maps draw the numbers of their results."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.arm import result
from plants.friction_study import friction_content, friction_result
from plants.report_values import TRUTH, fit_result, lines_of

from elastid.design.forecast import Forecast
from elastid.design.limits import QUANTITIES, LimitUse
from elastid.report.content import parameter_rows
from elastid.report.figures.fit import forest, information, limit_use, torque_balance_figure
from elastid.report.figures.use import SHOWN, workspace_figure
from elastid.report.page.page import rendered
from elastid.report.page.page_of_friction import html_of_friction
from elastid.store.friction_study import FRICTION, write_friction_result
from elastid.store.results import read_twin
from elastid.use.map import WorkspaceMap, map_workspace
from elastid.validation.torque_balance import DRY, INERTIA, TorqueBalance, torque_balance
from elastid.validation.twin import LINK, MOTION, TORQUE, SignalKind, TwinFindings, TwinRun, TwinSignal


def test_the_forest_plot_shows_start_estimate_truth_and_bound_hits_as_ratios_to_the_truth():
    """Ratios on a logarithmic axis, one row a parameter, the one at its bound marked."""
    rows = parameter_rows(fit_result(), TRUTH)
    ratio, percent = forest(rows).axes
    drawn = lines_of(ratio)
    assert ratio.get_xscale() == "log"
    assert [label.get_text() for label in ratio.get_yticklabels()] == ["k_1", "k_2", "d_1", "x_c"]
    truth = np.array(list(TRUTH.values()))
    start = np.array([2e5, 4e5, 300.0, 0.1])
    np.testing.assert_allclose(drawn["start"].get_xdata(), start / truth)
    np.testing.assert_allclose(drawn["truth"].get_xdata(), [1, 1, 1, 1])
    np.testing.assert_allclose(drawn["estimate at its bound"].get_ydata(), [2])
    np.testing.assert_allclose(drawn["bound"].get_xdata(), 250 / 400)
    # x_c is negative: -0.015 lies above -0.02, by a quarter of it.
    np.testing.assert_allclose(lines_of(percent)["estimate"].get_xdata()[[0, 2]], [100 * (3.02 / 3 - 1), 25.0])
    np.testing.assert_allclose(lines_of(percent)["truth"].get_xdata(), 0.0, atol=1e-9)


def test_the_forest_plot_takes_the_estimate_as_reference_where_no_truth_is_known():
    """All estimates at 1; unreachable parameters, whose interval is infinite, and zeros do not break it."""
    result = fit_result()
    covariance = np.array(result.covariance)
    covariance[3, 3] = np.inf
    ratio, _ = forest(parameter_rows(replace(result, covariance=covariance), None)).axes
    np.testing.assert_allclose(lines_of(ratio)["estimate"].get_xdata(), [1, 1, 1])
    assert "estimate" in ratio.get_xlabel()
    zero = replace(result, x=np.array([0.0, 0.0, 0.0, 0.0]))
    rendered(forest(parameter_rows(zero, {"x_c": 0.0})))


def balance() -> TorqueBalance:
    """Two parts and a rest at 3, 6 and 20 Hz."""
    t = np.arange(1000) / 200.0
    slow, middle, fast = (a * np.sin(2 * np.pi * f * t) for a, f in ((4.0, 3.0), (2.0, 6.0), (1.0, 20.0)))
    parts = {INERTIA: slow, DRY: middle}
    return torque_balance("joint 1", "log", "N*m", 200.0, slow + middle + fast, parts, (0.0, 32.0))


def test_lines_are_the_torques_and_below_them_what_is_left_by_octave() -> None:
    found = balance()
    whole, parts, left = torque_balance_figure(found).axes
    np.testing.assert_allclose(lines_of(whole)["model without friction"].get_ydata(), found.torques[0], atol=1e-12)
    np.testing.assert_allclose(lines_of(whole)["measured − model"].get_ydata(), found.residual)
    np.testing.assert_allclose(lines_of(parts)[DRY].get_ydata(), found.torques[1])
    expected = [100 * max(band.left_without_friction, 1e-7) for band in found.bands]
    np.testing.assert_allclose(lines_of(left)["left without friction"].get_ydata(), expected)
    assert [text.get_text() for text in left.get_xticklabels()][-1] == "16–32"


def run() -> TwinRun:
    """Motion, torque and link of a motor, and those of another."""
    t = np.arange(1000) / 200.0
    slow, fast = np.sin(2 * np.pi * 3 * t), np.sin(2 * np.pi * 20 * t)
    rows: list[tuple[SignalKind, str]] = [
        (MOTION, "motor 1"), (TORQUE, "motor 1"), (LINK, "joint 1"), (TORQUE, "motor 2"),
    ]  # fmt: skip
    signals = tuple(TwinSignal(*row, "N*m", slow + 0.1 * fast, slow) for row in rows)
    return TwinRun("log", "torque", 0.5, 5.0, 200.0, signals)


def test_both_come_back_from_their_file_and_are_on_the_page(tmp_path: Path) -> None:
    path, twin = tmp_path / "friction.h5", TwinFindings((balance(),), (run(), replace(run(), signals=(), lost="fast")))
    write_friction_result(path, friction_result(), twin=twin)
    assert repr(read_twin(path, FRICTION)) == repr(twin)
    write_friction_result(path, friction_result())
    assert read_twin(path, FRICTION) == TwinFindings()
    html = html_of_friction(replace(friction_content(), twin=twin), ())
    assert "Twin against its log" in html
    assert "the twin is lost: fast" in html
    assert html.count('<td class="text">link motion</td>') == 1
    assert "Twin against its log" not in html_of_friction(friction_content(), ())


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
