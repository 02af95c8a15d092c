"""The page of a map: its numbers are those of the map, and every choice shows them."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.arm import result

from elastid.report.command_summaries import answer_of_map
from elastid.report.figures.use import workspace_figure
from elastid.report.page.page_of_use import map_data, write_page_of_answer
from elastid.store.results import read_map, write_map, write_map_table
from elastid.use.map import WorkspaceMap, map_workspace


@pytest.fixture(scope="module")
def workspace() -> WorkspaceMap:
    angles = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 2))
    return map_workspace(result(), angles, lines_hz=np.geomspace(2, 80, 50), name="<b>arm</b>")


def test_map_round_trip_has_numbers_of_table(workspace: WorkspaceMap, tmp_path: Path) -> None:
    """HDF5 and CSV."""
    write_map(tmp_path / "map.h5", workspace)
    back = read_map(tmp_path / "map.h5")
    np.testing.assert_array_equal(back["frequency_1"].value, workspace["frequency_1"].value)
    assert back.springs == workspace.springs
    write_map_table(tmp_path / "map.csv", workspace)
    table = np.genfromtxt(tmp_path / "map.csv", delimiter=",", names=True, deletechars="", encoding="utf-8")
    np.testing.assert_array_equal(table["depth_of_cut"], workspace["depth_of_cut"].value)
    low, high = workspace["deflection"].interval
    np.testing.assert_array_equal([table["deflection_low"], table["deflection_high"]], [low, high])


def test_the_answer_names_the_softest_posture_and_its_spring(workspace: WorkspaceMap) -> None:
    """Of which the table has the first row."""
    answer = answer_of_map(workspace)
    soft = int(np.argmax(workspace["softest_compliance"].value))
    assert workspace.limiting_springs[soft] in " ".join(answer.sentences)
    softest, springs = answer.tables
    assert softest.rows[0][0] == str(soft + 1)
    assert {row[0] for row in springs.rows} == {"k_1", "k_2"}


@pytest.mark.slow
def test_a_click_a_slider_and_the_table_choose_a_posture(
    workspace: WorkspaceMap, tmp_path: Path, visit: Callable[..., Any]
) -> None:
    """With the numbers of the map; names are no markup, and the page asks the network for nothing."""
    figure, data = partial(workspace_figure, workspace), map_data(workspace)
    page = visit(write_page_of_answer(answer_of_map(workspace), figure, tmp_path / "map.html", "a test", data))
    assert page.title() == "Map of <b>arm</b>"
    first = page.text_content("#name")
    page.click("button.open >> nth=3")
    fourth = int(workspace.softest[3])
    assert page.text_content("#name").startswith(f"{workspace.asked[fourth] + 1}: ")
    assert f"{workspace['frequency_1'].value[fourth]:.4g} Hz" in page.text_content("#numbers")
    page.locator("#posture").fill("7")
    assert page.text_content("#name").startswith("8: ")
    page.select_option("#quantity", "depth_of_cut")
    page.check("#width")
    box = page.locator("#above").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert page.text_content("#name") != first
