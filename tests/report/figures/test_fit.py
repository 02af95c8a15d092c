"""Multistart costs and correlations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from plants.friction_study import friction_content, friction_result
from plants.report_values import TRUTH, fit_result, lines_of

from elastid.report.content import parameter_rows
from elastid.report.figures.fit import forest, torque_balance_figure
from elastid.report.page.page import rendered
from elastid.report.page.page_of_friction import html_of_friction
from elastid.store.friction_study import FRICTION, write_friction_result
from elastid.store.results import read_twin
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
