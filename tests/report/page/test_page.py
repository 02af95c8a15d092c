"""The page and its files: complete, self-contained; that of a friction study; numbers of its first screen."""

import base64
import errno
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from plants import friction_study as study
from plants.arm_modes import ARM, mode_row
from plants.report_values import TRUTH, balance, pair, report_content, write_report
from plants.taken_friction import LEFT, taken_friction

from elastid.base.display import Answer, number
from elastid.base.errors import Note
from elastid.modal.modes import without_modes
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.report.figures.drawings import drawings
from elastid.report.page.page import first_screen, html, html_of_responses
from elastid.report.page.page_of_friction import html_of_friction
from elastid.report.page.page_of_use import write_page_of_answer
from elastid.report.parameter_row import parameter_rows
from elastid.report.responses_content import ResponsesContent
from elastid.store.friction_study import read_simulation, write_friction_result
from elastid.validation.frf_error import validate
from elastid.validation.log_comparison import LINK, MOTION, TORQUE, ComparedSignal, LogComparison, LogSimulation


class Page(HTMLParser):
    """Tags, addresses and text of a page."""

    def __init__(self, source):
        super().__init__()
        self.tags, self.addresses, self.text = [], [], ""
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]

    def handle_data(self, data):
        self.text += data


def small_content(**changes):
    """One element of one configuration: few figures."""
    frf = (pair(1),)
    return report_content(frf=frf, validation=validate(*zip(*frf, strict=True), validation=[]), plan=None, **changes)


def test_the_page_shows_every_warning_parameter_and_configuration(report_folder):
    """Warnings of the stages and of the fit, estimates with the truth, errors, modes, notes, study, provenance."""
    content = report_content()
    text = Page((report_folder / "report.html").read_text("utf-8")).text
    assert len(content.notes) == 3
    for note in content.notes:
        assert text.count(str(note)) == 1
    for row in parameter_rows(content.result, TRUTH):
        assert row.name in text
        assert number(row.truth, 5) in text
    for given in ("d_2", "2.000 × d_1", "mass", "25.000", "left out", "9.125", "4.000 %"):
        assert given in text
    assert text.count(content.result.meaning.clause[1:]) == 1
    for given in (content.title, content.verdict, content.validation.verdict, content.study_text, "17"):
        assert given in text
    assert text.index("AT BOUND") < text.index("What next?") < text.index(str(content.notes[0]))


def test_the_page_needs_nothing_from_outside(report_folder):
    """No script or style sheet but its own, no address but embedded images and places on the page."""
    source = (report_folder / "report.html").read_text("utf-8")
    page = Page(source)
    assert 'src="http' not in source
    assert "<script src" not in source
    assert not {"link", "iframe", "object", "base"} & set(page.tags)
    assert page.tags.count("img") == 1
    files = {address for address in page.addresses if not address.startswith(("data:image/png;base64,", "#"))}
    assert files == {f"figures/{name}.png" for name in ("frf-c1", "frf-c2", "parameters")}
    assert all((report_folder / file).is_file() for file in files)
    without_images = re.sub(r"base64,[A-Za-z0-9+/=]+|<script>.*?</script>", "", source, flags=re.DOTALL)
    assert "://" not in without_images
    assert "url(" not in without_images
    places = re.findall(r'id="([^"]+)"', without_images)
    assert {address[1:] for address in page.addresses if address.startswith("#")} <= set(places)


@pytest.mark.slow
def test_figures_are_files_only_where_they_are_asked_for(tmp_path):
    """Nothing of an earlier report is left."""
    write_report(small_content(), tmp_path, ("png",))
    assert list((tmp_path / "figures").iterdir())
    write_report(small_content(), tmp_path, ())
    assert {path.name for path in tmp_path.rglob("*")} == {"report.html", "figures"}


def test_failed_report_keeps_previous_one(tmp_path, monkeypatch):
    """A full disk at the end of a file: the error names it, the old page stays, no half file."""
    page = write_report(small_content(), tmp_path, ())
    before = page.read_bytes()

    def full(_):
        raise OSError(errno.ENOSPC, "no space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match=rf"no space left on device: '{tmp_path / 'figures'}/\w+\.png'"):
        write_report(small_content(title="Another"), tmp_path, ("png",))
    assert page.read_bytes() == before
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [page]


@pytest.mark.parametrize("name", ["map.js", "curves.js", "explorer.js", "mode_viewer.js"])
def test_text_of_a_script_has_the_colour_of_the_scheme(name: str) -> None:
    """Light and dark; a colour of its own would be faint in one of them."""
    assert 'fill: "#' not in (files("elastid.report.page") / name).read_text("utf-8")


def page(friction: CompensatedFriction | None) -> str:
    return html(report_content(friction=friction), [])


def page_of_responses(friction: CompensatedFriction | None) -> str:
    modes = (without_modes(pair(2)[0], Note("modal/lines", "none")),)
    return html_of_responses(ResponsesContent("a", (pair(2)[0],), modes, "", {}, friction), [])


@pytest.mark.parametrize("written", [page, page_of_responses])
def test_the_section_has_the_numbers_of_the_file(written: Callable[[CompensatedFriction | None], str]) -> None:
    """Level and interval, power left, torque before and after; why friction was left stands there once."""
    text = written(taken_friction())
    section = text[text.index('<h2 id="friction">') :]
    section = section[: section.index("<h2", 10)]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", section)
    assert cells[:7] == ["motor 1", "4.50", "0.22", "4.06 … 4.94", "N*m", "3.2 %", "compensated"]
    assert cells[7:14] == ["motor 2", "–", "–", "–", "N", "98 %", "not compensated"]
    assert cells[14:19] == ["c1", "0.410", "0.110", "0.620", "0.620"]
    assert text.count(LEFT) == 1
    assert "friction was taken out<" not in text
    assert '<a href="#friction">' in text


def test_where_nothing_could_be_found_the_reason_stands_alone() -> None:
    """Neither tables nor a figure of nothing."""
    friction = taken_friction()
    refused = replace(
        friction, shapes=(), coulomb_torque=friction.coulomb_torque[:0], covariance=friction.covariance[:0, :0],
        configurations=(),
        before=friction.before[:0], after=friction.after[:0],
        notes=friction.notes[1:],
    )  # fmt: skip
    text = page(refused)
    assert text.count(LEFT) == 1
    assert "F_c" not in text
    assert "friction" not in {drawing.name for drawing in drawings(report_content(friction=refused))}


def test_table_has_value_interval_origin_and_misses() -> None:
    friction_page = html_of_friction(study.friction_content(), [])
    rows = re.findall(r"<tr( class=\"marked\")?>(<td>F.*?|<td>f_.*?)</tr>", friction_page)
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for _, row in rows]
    expected = "Fc_melbow | a meaning | F_c | 9.0000 | 9.020 | 0.030 | 8.960 … 9.080 | N*m | 10 levels"
    assert " | ".join(cells[0]) == expected
    assert [bool(marked) for marked, _ in rows] == [False, True, False]
    assert "no speed below nu_s / 3" in friction_page


def run() -> LogSimulation:
    """Motion, torque and link of a motor, and the torque of another."""
    y, kinds = (
        np.sin(np.arange(50.0)),
        ((MOTION, "motor 1"), (TORQUE, "motor 1"), (LINK, "joint 1"), (TORQUE, "motor 2")),
    )
    return LogSimulation(
        "log", "torque", 0.5, 5.0, 200.0, tuple(ComparedSignal(*kind, "N*m", 1.1 * y, y) for kind in kinds)
    )


def test_simulation_and_torque_are_read_and_shown(tmp_path: Path) -> None:
    path, log_comparison = (
        tmp_path / "friction.h5",
        LogComparison((balance(),), (run(), replace(run(), signals=(), lost="fast"))),
    )
    for given in (log_comparison, LogComparison()):
        write_friction_result(path, study.friction_result(), log_comparison=given)
        assert repr(read_simulation(path)) == repr(given)
    text = html_of_friction(replace(study.friction_content(), log_comparison=log_comparison), ())
    assert text.count("fast") == text.count('<td class="text">link motion</td>') == 1
    assert "link motion" not in html_of_friction(study.friction_content(), ())


def test_answer_page_has_figure_inside_and_as_file(tmp_path: Any) -> None:
    page = write_page_of_answer(Answer("a", ()), Figure, tmp_path / "tune.html", "us")
    assert base64.b64encode((tmp_path / "tune.png").read_bytes()).decode() in page.read_text("utf-8")


def test_first_screen_names_widest_number_unless_misfit() -> None:
    """And has the sketch where there is a robot."""
    content = replace(report_content(), robot=ARM, modes=(mode_row(),))
    rows = parameter_rows(content.result, TRUTH)
    for status, name in (("converged", "d_1"), ("misfit", None)):
        shown = first_screen(replace(content, result=replace(content.result, status=status)), rows)
        assert getattr(shown["widest"], "name", None) == name
        assert "<svg" in shown["sketch"]
        assert [count for *_, count in shown["width_counts"]] == [0, 1, 1, 0]  # joints
        assert shown["sketch"] in html(content, [])
    shown = first_screen(report_content(), rows)
    assert shown["sketch"] == ""
    assert [count for *_, count in shown["width_counts"]] == [1, 1, 1, 1]  # parameters
