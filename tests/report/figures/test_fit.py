"""Multistart costs and correlations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.report_values import fit_result, lines_of

from elastid.fit.modification_index import ModificationIndex
from elastid.report.figures.fit import identifiability, multistart_costs
from elastid.report.figures.modification_indices import modification_shares


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


def test_the_figure_of_modification_indices_has_a_bar_for_each_alone():
    """The best on top, at most 100 %."""

    def index(name: str, share: float, place: int = 0) -> ModificationIndex:
        return ModificationIndex(
            name, "mass", (name,), [1.0], ("kg",), (True,), [0.1], 0.1, 9.0, share, [0.1] * 4, (), place
        )

    indices = (index("m_arm", 1.02, 1), index("m_arm", 1.02), index("delay", 0.25))
    (axes,) = modification_shares(replace(fit_result(), indices=indices)).axes
    np.testing.assert_allclose([bar.get_width() for bar in axes.patches], [25.0, 100.0])
    assert [text.get_text() for text in axes.get_yticklabels()] == ["delay", "m_arm"]
