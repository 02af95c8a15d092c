"""The mode viewer: its size, and in a browser its sticks, scale, motion and silence."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from plants.arm_modes import drawn, mode_row
from plants.report_values import report_content

from elastid.report.modes import ModeDrawing, ModeRow
from elastid.report.page.mode_viewer import mode_viewer
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring


def test_the_modes_of_twenty_configurations_of_a_six_axis_robot_are_a_third_of_a_megabyte():
    """Thirty points, eighteen modes."""
    rng = np.random.default_rng(0)
    moved = 0.1 * (rng.standard_normal((30, 3, 18)) + 1j * rng.standard_normal((30, 3, 18)))
    drawing = ModeDrawing(rng.standard_normal((30, 3)), tuple((i, i + 1, "arm") for i in range(29)), (1, 2), moved)
    row = ModeRow("c", np.arange(1.0, 19.0), np.full(18, 0.05), drawing=drawing)
    viewer = mode_viewer([row] * 20, True)
    assert viewer is not None
    assert len(viewer.data) < 350_000


@pytest.fixture
def table(visit, written):
    """Opens the page of one configuration that can be drawn and one that cannot."""
    path = written(report_content(modes=(mode_row(), replace(mode_row("c2"), drawing=None))))
    return partial(visit, path)


def sticks(page, view=0):
    """Where the swinging sticks are drawn."""
    return page.locator("#mode-viewer svg").nth(view).locator(".moving path").evaluate_all(
        "paths => paths.map(path => path.getAttribute('d')).join('')"
    )  # fmt: skip


def test_the_browser_draws_the_mode_that_is_chosen(table):
    """Below its row, with its views; first, before anything is chosen, the first one at rest at its end."""
    row, page = mode_row(), table(reduced_motion="reduce")
    drawing = row.drawing
    assert drawing is not None
    assert page.locator("tr[data-mode]").count() == 2 * len(row.frequency_hz)
    buttons = page.locator("tr[data-mode] button")
    assert buttons.count() == len(row.frequency_hz)
    assert "mode 1:" in page.locator("#mode-viewer").inner_text()
    for mode in range(len(row.frequency_hz)):
        if mode:
            buttons.nth(mode).click()
        assert buttons.nth(mode).get_attribute("aria-expanded") == "true"
        assert page.locator("tr.mode-drawing").evaluate("tr => tr.previousSibling.dataset.mode") == str(mode)
        assert f"mode {mode + 1}: " in page.locator("#mode-viewer").inner_text()
        assert page.locator("#mode-viewer svg").count() == len(drawing.views(mode))
    assert "50 % gear 2, 50 % rod" in page.locator("#mode-viewer").inner_text()
    buttons.nth(mode).click()
    assert page.locator("tr.mode-drawing").count() == 0


def test_the_browser_draws_the_points_to_one_scale(table):
    """Pixels are an affine map of the points at the end of the swing, as many to a metre in every direction."""
    drawing, page = mode_row().drawing, table(reduced_motion="reduce")
    assert drawing is not None
    scales = []
    for view, axes in enumerate(drawing.views(0)):
        ends = (drawing.points + drawing.moved[:, :, 0].real)[:, list(axes)]
        expected = np.array(
            [ends[[a, b]] for kind in ("arm", "strut", "mass") for a, b, k in drawing.links if k == kind]
        )
        numbers = [float(number) for number in re.findall(r"-?[\d.]+", sticks(page, view).split("h0")[0])]
        pixels = np.array(numbers)[: expected.size].reshape(expected.shape)
        for axis, sign in ((0, 1), (1, -1)):
            slope, start = np.polyfit(expected[..., axis].ravel(), pixels[..., axis].ravel(), 1)
            line = slope * expected[..., axis] + start
            np.testing.assert_allclose(pixels[..., axis], line, atol=0.2)
            scales.append(sign * slope)
    np.testing.assert_allclose(scales, scales[0], rtol=2e-3)
    assert scales[0] > 50


def test_the_browser_draws_a_slide_that_spans_nothing_upwards(visit, written):
    """All points on one line: a strip along it, no division by its height."""
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, 600.0), motion="translation")
    load = Body("load", "carriage", Placement((0.5, 0, 0)), (Joint("e", "x", Spring(8e5), motion="translation"),), 25)
    drawing = drawn(Robot("slide", (Body("carriage", joints=(joint,), mass=40), load)), (0.3,))
    row = ModeRow("c1", np.arange(1.0, 1.0 + drawing.moved.shape[2]), np.full(2, 0.05), drawing=drawing)
    page = visit(written(report_content(modes=(row,))))
    box = page.locator("#mode-viewer svg").first.bounding_box()
    assert 350 < box["width"] < 420
    assert 100 < box["height"] < 200
    assert "NaN" not in sticks(page)


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


def test_the_browser_moves_nothing_on_its_own_for_those_who_want_it_calm(table):
    """prefers-reduced-motion: a chosen mode stands at its end until it is played."""
    page = table(reduced_motion="reduce")
    page.locator("tr[data-mode] button").nth(1).click()
    held = sticks(page)
    page.wait_for_timeout(200)
    assert sticks(page) == held
    page.locator("#mode-viewer button").click()
    page.wait_for_timeout(300)
    assert sticks(page) != held


def test_the_page_without_scripts_and_on_paper_has_the_table_alone(table):
    """Plain numbers in the place of the buttons; no drawing that nobody chose on paper."""
    page = table(java_script_enabled=False)
    assert page.locator("tr[data-mode] button").count() == 0
    assert not page.locator("#mode-viewer").is_visible()
    page = table()
    page.emulate_media(media="print")
    assert not page.locator("#mode-viewer").is_visible()


def test_what_a_robot_is_called_cannot_run(visit, written):
    """Names of springs and configurations are text, in the data and on the page."""
    name = "</script><script>document.title='run'</script><img src=x onerror=alert(1)>"
    row = replace(mode_row(name), stores=(name, "rod"))
    page = visit(written(report_content(title="safe", modes=(row,))))
    assert page.title() == "safe"
    assert "</script>" in page.locator("#mode-viewer").inner_text()
    assert page.locator("#mode-viewer img").count() == 0
    viewer = mode_viewer([row], True)
    assert viewer is not None
    assert json.loads(viewer.data)["rows"][0]["modes"][0]["title"].startswith(name)
