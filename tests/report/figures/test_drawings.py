"""The catalogue of figures."""

from __future__ import annotations

from plants import friction_study as study
from plants.report_values import full_content

from elastid.report.figures.drawings import drawings, friction_study_drawings


def test_every_figure_of_a_full_report_is_drawn_once():
    """Names are file names and so unique; each belongs to a section of the page."""
    names = [drawing.name for drawing in drawings(full_content())]
    assert len(set(names)) == len(names)
    assert {"parameters", "frf-c1", "frf-c2", "identifiability"} <= set(names)


def test_every_joint_has_the_figures_of_what_was_measured() -> None:
    """In files that every system can write."""
    figures = list(friction_study_drawings(study.friction_result()))
    assert [figure.name for figure in figures] == [
        "friction-elbow-curve", "friction--lift--motion",
    ]  # fmt: skip
    assert [figure.section for figure in figures] == ["joint elbow", "joint <lift>"]
