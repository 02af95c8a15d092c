"""Poles chosen by a click: the text that the page writes is a section of a study, and is used."""

import json
import re
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from modal.structures import modal_response
from ruamel.yaml import YAML

from elastid.modal.estimate import estimate_modes
from elastid.modal.spec import ModalSpec
from elastid.report.content import ResponsesContent
from elastid.report.page.page import html_of_responses

FREQ_HZ = np.arange(32, 800) / 8
NATURAL, ZETA = np.array([12.0, 25.0, 41.0]), np.array([0.01, 0.015, 0.008])


@pytest.fixture(scope="module")
def content() -> ResponsesContent:
    response = modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((2, 3)), noise=0.01)
    return ResponsesContent("A bench", (response,), (estimate_modes(response),), "name: a\n", {"seed": "1"})


def test_the_page_has_the_poles_of_all_orders_and_takes_the_modes(content: ResponsesContent) -> None:
    text = html_of_responses(content, [])
    found = re.search(r'id="pole-data">(.*?)</script>', text)
    assert found is not None
    (row,) = json.loads(found[1])["rows"]
    np.testing.assert_allclose(row["taken"], NATURAL, rtol=1e-3)
    assert len(row["freq"]) == len(row["order"]) == len(row["zeta"]) == len(row["stable"])
    assert min(row["freq"]) >= FREQ_HZ[0]
    assert max(row["freq"]) <= FREQ_HZ[-1]
    assert not row["has_section"]
    assert 'fill: "#' not in text  # labels have colours of the scheme, light and dark


@pytest.mark.slow
def test_a_click_gives_a_mode_back_and_the_text_is_a_section_of_a_study(
    content: ResponsesContent, tmp_path: Path, visit
) -> None:
    """The lowest mode is given back: the two others are those of a study with that text."""
    path = tmp_path / "report.html"
    path.write_text(html_of_responses(content, []), "utf-8")
    page = visit(path)
    page.evaluate(
        """() => [...document.querySelectorAll("[data-poles] circle")]
        .find((dot) => Math.abs(parseFloat(dot.textContent) / 12 - 1) < 2e-3).dispatchEvent(new Event("click"))"""
    )
    keys = YAML(typ="safe").load(StringIO(page.inner_text("[data-poles] + pre")))
    spec = ModalSpec(poles_hz=tuple(keys["modal"]["poles_hz"]))
    modes = estimate_modes(content.responses[0], poles_hz=spec.poles_hz)
    np.testing.assert_allclose(modes.freq_hz, NATURAL[1:], rtol=1e-3)
