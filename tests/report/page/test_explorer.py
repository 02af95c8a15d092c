"""The explorer of responses: its size, and in a browser its numbers, choices and zoom."""

from dataclasses import replace
from functools import partial
from xml.etree import ElementTree

import numpy as np
import pytest
from plants.arm_modes import mode_row
from plants.report_values import FREQ_HZ, full_content, pair, report_content

from elastid.report.content import MAX_VALUES, model_lines
from elastid.report.page.explorer import curve_scripts, explorer
from elastid.validation.frf_error import validate


def test_data_of_twenty_configurations_stay_below_nine_megabytes():
    """200 lines of 36 elements each and the model's own, with every curve."""
    freq_hz = np.arange(2.0, 102.0, 0.5)
    frf = [pair(6, name=f"c{i}", seed=i, freq_hz=freq_hz) for i in range(20)]
    lines = model_lines(freq_hz, list(range(5, 95, 5)), [0.05] * 18, MAX_VALUES // (20 * 36))
    assert len(lines) > 2 * len(freq_hz)
    _, model = pair(6, freq_hz=lines)
    data = explorer(frf, [], [(model, 0.01 * np.abs(model.G))] * 20)
    assert len(data) + sum(map(len, curve_scripts())) < 8.7e6


@pytest.fixture
def opened(visit, report_folder):
    """The page of two configurations of a two-axis robot."""
    return visit(report_folder / "report.html")


def hovered(page, panel, part):
    """Nearest line's readout: frequency and numbers by label."""
    over = page.locator("#explorer .u-over").nth(panel)
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + part * box["width"], box["y"] + box["height"] / 2)
    text = page.locator("#explorer output").inner_text()
    name, rest = text.split(", ", 1)
    frequency, values = rest.split(" Hz: ")
    numbers = {}
    for piece in values.rsplit(" ", 1)[0].split(", "):
        label, value = piece.rsplit(" ", 1)
        numbers[label] = float(value.replace("−", "-"))
    return name, float(frequency), numbers


def test_the_browser_shows_the_uncertainty_of_the_model(visit, written):
    """Once its curve is switched on in the legend."""
    content = full_content()
    page = visit(written(content))
    page.locator("#explorer .key button", has_text="std of the model").click()
    _, frequency, numbers = hovered(page, 0, 0.4)
    line = int(np.argmin(np.abs(FREQ_HZ - frequency)))
    assert numbers["std of the model"] == pytest.approx(20 * np.log10(content.dense[0][1][line, 0, 0]), abs=0.011)


def test_a_thumbnail_opens_large_and_the_frequency_becomes_linear(opened):
    opened.get_by_label("Enlarge motor 1 → place 2").click()
    assert hovered(opened, 0, 0.4)[0] == "motor 1 → place 2"
    logarithmic = hovered(opened, 0, 0.5)[1]
    opened.locator("#explorer select").nth(2).select_option("linear")
    assert hovered(opened, 0, 0.5)[1] > 2 * logarithmic


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_the_view_is_saved_as_it_is_drawn(opened, tmp_path, kind):
    """A circle each measured line and a path each curve in the SVG; a PNG of twice the size."""
    with opened.expect_download() as download:
        opened.locator(f"#explorer [data-save={kind}]").click()
    download.value.save_as(tmp_path / "view")
    content = (tmp_path / "view").read_bytes()
    assert download.value.suggested_filename == f"c1.{kind}"
    if kind == "png":
        size = opened.evaluate("[document.querySelector('#explorer .grid').scrollWidth]")
        assert int.from_bytes(content[16:20], "big") == 2 * size[0]
    else:
        svg = ElementTree.fromstring(content)
        circles = svg.findall(".//{http://www.w3.org/2000/svg}circle")
        assert len(circles) == 4 * len(FREQ_HZ)
        assert "motor 1 → place 1" in [text.text for text in svg.iter("{http://www.w3.org/2000/svg}text")]


def test_arrow_keys_step_through_the_measured_lines(opened):
    measured, _ = report_content().frf[0]
    opened.locator("#explorer [role=group]").first.focus()
    for line in range(3):
        opened.keyboard.press("ArrowRight")
        text = opened.locator("#explorer output").inner_text()
        assert float(text.split(", ")[1].split(" Hz")[0]) == pytest.approx(measured.freq_hz[line], rel=1e-5)


def test_a_resonance_between_the_measured_lines_is_drawn(visit, written):
    """Lines 4 Hz apart miss the peak of the model; the readout stays with the measured lines."""
    freq_hz = np.arange(2.0, 60.0, 4.0)
    lines = model_lines(freq_hz, [15.7], [0.02])
    frf = (pair(1, freq_hz=freq_hz),)
    content = report_content(frf=frf, validation=validate(*zip(*frf, strict=True), validation=[]), plan=None)
    page = visit(written(replace(content, dense=((pair(1, freq_hz=lines)[1], np.zeros((len(lines), 1, 1))),))))
    drawn = page.evaluate("frf.values(frf.data.responses[0], 'fitted', 0)")
    expected = 20 * np.log10(np.abs(pair(1, freq_hz=lines)[1].G[:, 0, 0]))
    assert drawn == pytest.approx(expected.tolist(), abs=1e-3)
    assert hovered(page, 0, 0.4)[1] in freq_hz


def test_the_browser_zooms_all_panels_together_and_back(opened):
    def frequencies():
        return [hovered(opened, panel, part)[1] for panel in (0, 3) for part in (0.01, 0.99)]

    whole = frequencies()
    opened.locator("#explorer .u-over").nth(0).scroll_into_view_if_needed()
    box = opened.locator("#explorer .u-over").nth(0).bounding_box()
    for part, press in ((0.3, opened.mouse.down), (0.6, opened.mouse.up)):
        opened.mouse.move(box["x"] + part * box["width"], box["y"] + 20)
        press()
    near = frequencies()
    assert near[0] == near[2] > whole[0]
    assert near[1] == near[3] < whole[1]
    opened.locator("#explorer .u-over").nth(0).dblclick()
    assert frequencies() == whole


@pytest.fixture
def table(visit, written):
    """Opens the page of one configuration that can be drawn and one that cannot."""
    path = written(report_content(modes=(mode_row(), replace(mode_row("c2"), drawing=None))))
    return partial(visit, path)


def sticks(page):
    return page.locator("#mode-viewer svg").first.locator(".moving path").evaluate_all(
        "paths => paths.map(path => path.getAttribute('d')).join('')"
    )  # fmt: skip


def test_the_viewer_opens_on_the_first_mode_that_springs_make(visit, written):
    """A pendulum, all of whose energy is weight, comes before it."""
    energy = np.tile([[0.1], [0.9]], (1, len(mode_row().frequency_hz)))
    energy[:, 0] = 1.0, 0.0
    row = replace(mode_row(), stores=("weight", "rod"), energy=energy)
    page = visit(written(report_content(modes=(row,))), reduced_motion="reduce")
    assert "weight" in page.locator("tr[data-mode]").nth(0).inner_text()
    assert page.locator("tr[data-mode] button").nth(0).get_attribute("aria-expanded") == "false"
    assert "mode 1:" not in page.locator("#mode-viewer").inner_text()


def test_the_browser_plays_and_pauses(table):
    """A chosen mode swings; paused, it stays where it is; at first nothing moves."""
    page = table(reduced_motion="no-preference")
    at_first = sticks(page)
    page.wait_for_timeout(150)
    assert sticks(page) == at_first
    button = page.locator("#mode-viewer button")
    page.locator("tr[data-mode] button").nth(1).click()
    assert button.inner_text() == "Pause"
    seen = set()
    for _ in range(4):
        page.wait_for_timeout(120)
        seen.add(sticks(page))
    assert len(seen) > 1
    button.click()
    assert button.inner_text() == "Play"
    held = sticks(page)
    page.wait_for_timeout(150)
    assert sticks(page) == held
    button.click()
    page.wait_for_timeout(300)
    assert sticks(page) != held


def test_page_respects_reduced_motion(table):
    """prefers-reduced-motion: a chosen mode stands at its end until it is played."""
    page = table(reduced_motion="reduce")
    page.locator("tr[data-mode] button").nth(1).click()
    held = sticks(page)
    page.wait_for_timeout(200)
    assert sticks(page) == held
    page.locator("#mode-viewer button").click()
    page.wait_for_timeout(300)
    assert sticks(page) != held


def test_page_without_scripts_has_table_only(table):
    """Plain numbers instead of the buttons; no drawing on paper that was not chosen."""
    page = table(java_script_enabled=False)
    assert page.locator("tr[data-mode] button").count() == 0
    assert not page.locator("#mode-viewer").is_visible()
    page = table()
    page.emulate_media(media="print")
    assert not page.locator("#mode-viewer").is_visible()


@pytest.fixture
def on_a_laptop(visit, report_folder):
    """The page of two configurations of a two-axis robot, as wide as a laptop."""
    page = visit(report_folder / "report.html")
    page.set_viewport_size({"width": 1280, "height": 800})
    return page


def test_the_three_questions_stand_above_the_fold(on_a_laptop):
    assert on_a_laptop.evaluate("document.querySelector('.columns').getBoundingClientRect().bottom") <= 800
    assert on_a_laptop.locator(".columns h2").count() == 3
    assert 1 <= on_a_laptop.locator(".actions li").count() <= 3


def test_numbers_are_sorted_and_filtered(on_a_laptop):
    def names():
        return list(on_a_laptop.locator("#numbers-table tbody tr:visible td:first-child b").all_inner_texts())

    on_a_laptop.locator("#numbers-table th button", has_text="±").click()
    by_width = names()
    assert by_width.index("k_1") < by_width.index("k_2") < by_width.index("d_1")
    on_a_laptop.locator("#numbers-controls input").fill("k_")
    assert names() == ["k_1", "k_2"]
