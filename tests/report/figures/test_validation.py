"""Heat maps of errors and replayed records."""

from __future__ import annotations

import numpy as np
import pytest
from plants.report_values import lines_of, pair, replays, report_content

from elastid.report.figures.validation import left_out_errors, model_errors, replay_signals
from elastid.report.page.page import rendered
from elastid.validation.agreement import validate
from elastid.validation.comparison import ComparedModel, Comparison


def test_the_heat_maps_show_every_error_where_it_belongs():
    """Configurations down, elements across, in the order of the validation, left-out ones marked."""
    validation = report_content().validation
    figure = model_errors(validation)
    maps = [axes for axes in figure.axes if axes.images and axes.get_title()]
    for axes, name in zip(maps, ("rms_log_db", "phase_rms_deg", "rms_sigma"), strict=True):
        given = np.stack([getattr(a, name).ravel() for a in validation.configurations])
        np.testing.assert_allclose(axes.images[0].get_array(), given)
    assert [label.get_text() for label in maps[0].get_yticklabels()] == ["c1", "c2, left out"]
    assert maps[1].get_yticklabels() == []
    assert {text.get_color() for text in maps[0].texts} == {"white", "black"}
    darkest = maps[0].texts[int(np.argmax(maps[0].images[0].get_array()))]
    assert darkest.get_color() == "white"
    rightmost = [axes for axes in maps if axes.get_xticklabels()][-1]
    assert rightmost.get_xticklabels()[1].get_text() == "motor 2 → place 1"


@pytest.mark.parametrize(("n_u", "n_configurations"), [(1, 1), (6, 20)])
def test_the_heat_maps_fit_a_page_whatever_their_size(n_u, n_configurations):
    """One element of one configuration, and 36 of twenty."""
    pairs = [pair(n_u, name=f"c{i}") for i in range(n_configurations)]
    figure = model_errors(validate(*zip(*pairs, strict=True), left_out=[]))
    assert figure.get_figwidth() < 12
    rendered(figure, "png")


def test_configurations_with_other_outputs_have_their_own_columns():
    """Two outputs here, three there: what was not measured stays empty."""
    pairs = [pair(2, 2, name="c1"), pair(2, 3, name="c2")]
    axes = model_errors(validate(*zip(*pairs, strict=True), left_out=[])).axes[0]
    shown = np.ma.filled(axes.images[0].get_array(), np.nan)
    assert shown.shape == (2, 6)
    np.testing.assert_array_equal(np.isnan(shown), [[False] * 4 + [True] * 2, [False] * 6])


def test_the_replay_shows_measured_model_and_difference():
    """Close up at the sample where the difference is largest, with the fits of the record that is shown."""
    given = replays()
    figure = replay_signals(given)
    whole, close = figure.axes[0], figure.axes[1]
    drawn = lines_of(close)
    t = drawn["measured"].get_xdata()
    np.testing.assert_allclose(
        drawn["model under the measured torque"].get_ydata() / drawn["measured"].get_ydata(), 0.9
    )
    worst = np.abs(given.measured).max(axis=1).argmax() / given.rate_hz
    assert t[0] <= worst <= t[-1]
    np.testing.assert_allclose(lines_of(whole)["measured − model"].get_ydata(), 0.1 * given.measured[:, 0])
    assert "88.0 % explained (a true model: 99.5 %)" in close.get_title(loc="left")
    assert "2 to 60 Hz" in figure.texts[-1].get_text()


def test_left_out_errors_are_roots_of_the_misfits():
    """A mark for each configuration and the root mean square, the best model on top; none where a fit failed."""
    models = [
        ComparedModel(name, 3, 1.0, 9, 0.0, np.array(m), 1.0, 1.0)
        for name, m in (("a", [4.0, 9.0]), ("b", [1.0, np.nan]))
    ]
    (axes,) = left_out_errors(Comparison(("c1", "c2"), tuple(models), "a is best")).axes
    drawn = lines_of(axes)
    np.testing.assert_allclose(drawn["c1"].get_xdata(), [2.0, 1.0])
    np.testing.assert_allclose(drawn["c2"].get_xdata(), [3.0, np.nan])
    np.testing.assert_allclose(drawn["root mean square"].get_xdata(), [np.sqrt(6.5), np.nan])
    assert axes.get_ylim()[0] > axes.get_ylim()[1]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]
