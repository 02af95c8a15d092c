"""The catalogue of figures."""

from __future__ import annotations

from plants.report_values import full_content

from elastid.report.figures.drawings import drawings


def test_every_figure_of_a_full_report_is_drawn_once():
    """Names are file names and so unique; each belongs to a section of the page."""
    names = [drawing.name for drawing in drawings(full_content())]
    assert len(set(names)) == len(names)
    assert {"parameters", "frf-c1", "frf-c2", "identifiability"} <= set(names)
