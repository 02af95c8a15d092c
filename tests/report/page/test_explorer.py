"""The explorer of responses: its size, and in a browser its numbers, choices and zoom."""

from __future__ import annotations

import numpy as np
import pytest
from plants.report_values import FREQ_HZ, full_content, pair, report_content

from elastid.report.page.explorer import explorer
from elastid.report.page.page import MAX_FIGURE_BYTES


def test_the_page_of_twenty_configurations_of_six_axes_stays_below_ten_megabytes():
    """200 lines of 36 elements each, with every curve, beside as many figures as have room."""
    frf = [pair(6, name=f"c{i}", seed=i, freq_hz=np.arange(2.0, 102.0, 0.5)) for i in range(20)]
    data = explorer(frf, [], [0.01 * np.abs(G.G) for _, G in frf])
    assert len(data.data) + sum(map(len, data.scripts)) + MAX_FIGURE_BYTES < 9.9e6


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


def test_the_browser_shows_one_panel_an_element_with_the_numbers_of_the_study(opened):
    measured, modelled = report_content().frf[0]
    assert opened.locator("#explorer .u-wrap").count() == 4
    for panel, (i, j) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        name, frequency, numbers = hovered(opened, panel, 0.4)
        assert name == f"motor {j + 1} → place {i + 1}"
        line = int(np.argmin(np.abs(measured.freq_hz - frequency)))
        assert measured.freq_hz[line] == pytest.approx(frequency, rel=1e-5)
        assert numbers["measured"] == pytest.approx(20 * np.log10(abs(measured.G[line, i, j])), abs=0.011)
        assert numbers["model"] == pytest.approx(20 * np.log10(abs(modelled.G[line, i, j])), abs=0.011)
        error = abs(measured.G[line, i, j] - modelled.G[line, i, j])
        assert numbers["|measured − model|"] == pytest.approx(20 * np.log10(error), abs=0.011)


def test_the_browser_shows_the_uncertainty_of_the_model(visit, written):
    content = full_content()
    page = visit(written(content))
    _, frequency, numbers = hovered(page, 0, 0.4)
    line = int(np.argmin(np.abs(FREQ_HZ - frequency)))
    assert numbers["std of the model"] == pytest.approx(20 * np.log10(content.model_std[0][line, 0, 0]), abs=0.011)


def test_the_browser_changes_configuration_quantity_and_element(opened):
    measured, _ = report_content().frf[1]
    configuration, quantity, element = (opened.locator("#explorer select").nth(i) for i in range(3))
    configuration.select_option(index=1)
    quantity.select_option("phase")
    element.select_option(label="motor 2 → place 1")
    assert opened.locator("#explorer .u-wrap").count() == 1
    name, frequency, numbers = hovered(opened, 0, 0.6)
    line = int(np.argmin(np.abs(measured.freq_hz - frequency)))
    assert name == "motor 2 → place 1"
    assert numbers["measured"] == pytest.approx(np.degrees(np.angle(measured.G[line, 0, 1])), abs=0.11)


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


def test_names_from_a_file_cannot_run_in_the_browser(visit, written):
    frf = (pair(2, name="</script><script>document.title='run'</script>"),)
    content = report_content(title="<img src=x onerror=alert(1)>", frf=frf)
    page = visit(written(content))
    assert page.title() == "<img src=x onerror=alert(1)>"
    assert "</script>" in page.locator("#explorer select").nth(0).inner_text()
