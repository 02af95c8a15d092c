"""The catalogue of figures."""

from __future__ import annotations

from plants import friction_study as study
from plants.report_values import full_content, pair, report_content

from elastid.report.figures.drawings import drawings, friction_study_drawings
from elastid.validation.agreement import validate


def test_every_figure_of_a_full_report_is_drawn_once():
    """Names are file names and so unique; each belongs to a section of the page."""
    names = [drawing.name for drawing in drawings(full_content())]
    assert len(set(names)) == len(names)
    assert {"parameters", "frf-c1", "frf-c2", "identifiability"} <= set(names)


def test_configurations_whose_names_differ_in_case_or_spaces_have_files_of_their_own():
    """As on a file system that ignores case."""
    frf = tuple(pair(1, name=name) for name in ("reach", "Reach", "a b", "a/b"))
    content = report_content(frf=frf, validation=validate(*zip(*frf, strict=True), left_out=[]))
    names = [one.name for one in drawings(content) if one.name.startswith("frf-")]
    assert names == ["frf-reach", "frf-Reach-2", "frf-a-b", "frf-a-b-4"]


def test_every_joint_has_the_figures_of_what_was_measured() -> None:
    """In files that every system can write."""
    figures = list(friction_study_drawings(study.friction_result()))
    assert [figure.name for figure in figures] == [
        "friction-elbow-curve", "friction--lift--motion",
    ]  # fmt: skip
    assert [figure.section for figure in figures] == ["joint elbow", "joint <lift>"]
