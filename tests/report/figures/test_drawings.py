"""The catalogue of figures."""

from __future__ import annotations

from dataclasses import replace

from plants import friction_study as study
from plants.arm_modes import mode_row
from plants.report_values import full_content, pair, report_content

from elastid.report.figures.drawings import drawings, friction_study_drawings
from elastid.validation.agreement import validate


def test_every_figure_of_a_full_report_is_drawn_once():
    """Names are file names and so unique; each belongs to a section of the page."""
    names = [drawing.name for drawing in drawings(full_content())]
    assert len(set(names)) == len(names)
    assert {"errors", "frf-c1-singular-values", "frf-c2-replay", "frf-c1-modes"} <= set(names)


def test_a_report_draws_sticks_where_there_are_any_and_bars_elsewhere() -> None:
    """Under one name; the energy in words above the bars as well."""
    bench = replace(mode_row("c2"), drawing=None)
    found = {d.name: d.draw() for d in drawings(report_content(modes=(mode_row(), bench))) if d.name.endswith("modes")}
    bars = [len(axes.collections[0].get_paths()) for axes in found["frf-c2-modes"].axes]
    assert bars == [5] * len(bench.frequency_hz)
    assert found["frf-c2-modes"].axes[0].get_title(loc="left") == "92 % gear 2, 8 % rod"
    assert len(found["frf-c1-modes"].axes) == 1


def test_configurations_whose_names_differ_in_case_or_spaces_have_files_of_their_own():
    """As on a file system that ignores case."""
    frf = tuple(pair(1, name=name) for name in ("reach", "Reach", "a b", "a/b"))
    content = report_content(frf=frf, validation=validate(*zip(*frf, strict=True), left_out=[]))
    names = [one.name for one in drawings(content) if one.name.endswith("-phase")]
    assert names == ["frf-reach-phase", "frf-Reach-2-phase", "frf-a-b-phase", "frf-a-b-4-phase"]


def test_every_joint_has_the_figures_of_what_was_measured() -> None:
    """In files that every system can write."""
    figures = list(friction_study_drawings(study.friction_result()))
    assert [figure.name for figure in figures] == [
        "friction-elbow-curve", "friction-elbow-pass", "friction-elbow-loops", "friction-elbow-at-rest",
        "friction-elbow-warm-up", "friction--lift--motion",
    ]  # fmt: skip
    assert [figure.section for figure in figures[-2:]] == ["joint elbow", "joint <lift>"]
