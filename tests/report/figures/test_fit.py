"""Multistart costs and correlations."""

from __future__ import annotations

import numpy as np
from plants.report_values import fit_result, lines_of

from elastid.report.figures.fit import identifiability, multistart_costs


def test_the_multistart_figure_separates_hits_from_other_endings():
    """Three hits, one that ended elsewhere, one that did not converge, each at its cost."""
    figure = multistart_costs(fit_result())
    drawn = lines_of(figure.axes[0])
    np.testing.assert_allclose(drawn["reached the best cost"].get_ydata(), [210.0, 210.0, 210.1])
    np.testing.assert_allclose(drawn["ended elsewhere"].get_ydata(), [900.0])
    np.testing.assert_allclose(drawn["did not converge"].get_ydata(), [2000.0])
    assert "3 of 5" in figure.texts[0].get_text()


def test_the_identifiability_figure_writes_strong_correlations_into_the_matrix():
    """-0.97 twice, nothing else; the singular values beside it."""
    matrix, values, _ = identifiability(fit_result()).axes
    np.testing.assert_allclose(matrix.images[0].get_array(), fit_result().correlation)
    assert [text.get_text() for text in matrix.texts] == ["-0.97", "-0.97"]
    np.testing.assert_allclose(values.get_lines()[0].get_ydata(), [2.0, 1.0, 0.5, 0.01])
    assert values.get_title() == "singular values, condition 200"
