"""Multistart costs and correlations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.report_values import TRUTH, fit_result, lines_of

from elastid.report.content import parameter_rows
from elastid.report.figures.fit import forest, identifiability
from elastid.report.page.page import rendered


def test_the_identifiability_figure_writes_strong_correlations_into_the_matrix():
    """-0.97 twice, nothing else; the singular values beside it."""
    matrix, values = identifiability(fit_result()).axes
    np.testing.assert_allclose(matrix.images[0].get_array(), fit_result().correlation)
    assert [text.get_text() for text in matrix.texts if text.get_text()] == ["-0.97", "-0.97"]
    np.testing.assert_allclose(values.get_lines()[0].get_ydata(), [2.0, 1.0, 0.5, 0.01])
    assert values.get_title() == "singular values, condition 200"


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
