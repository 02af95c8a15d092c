"""Every kind of page can be read by keyboard and by ear, and its text stands out, light and dark."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from plants import friction_study as study
from plants.report_values import full_content, pair

from elastid.base.errors import Note
from elastid.modal.modes import without_modes
from elastid.report.fleet import Outcome, answer_of_fleet
from elastid.report.page.page import html, html_of_responses
from elastid.report.page.page_of_friction import html_of_friction
from elastid.report.page.page_of_use import html_of_answer
from elastid.report.responses_content import ResponsesContent
from elastid.validation.fleet import FleetValue, find_changes

# What a reader of the screen needs, as one sentence for each fault.
FAULTS = """
() => {
    const faults = [];
    const seen = (one) => one.getClientRects().length > 0;
    const all = (selector) => [...document.querySelectorAll(selector)];
    const label = (one) => one.closest("label")?.innerText.trim();
    const named = (one) => one.getAttribute("aria-label") || one.innerText?.trim() || label(one);
    const fault = (one, words) => faults.push(`${words}: ${one.outerHTML.slice(0, 120)}`);
    if (document.documentElement.lang !== "en") faults.push("no language");
    if (!document.title) faults.push("no title");
    if (all("h1").length !== 1) faults.push("not one h1");
    let level = 0;
    all("h1, h2, h3, h4").filter(seen).forEach((one) => {
        const next = Number(one.tagName[1]);
        if (next > level + 1) fault(one, "a level of headings is left out");
        if (!one.innerText.trim()) fault(one, "empty heading");
        level = next;
    });
    all("img").forEach((one) => one.alt.trim() || fault(one, "image without text"));
    const labelled = (one) => named(one) || one.querySelector("title");
    all("svg[role=img]").forEach((one) => labelled(one) || fault(one, "drawing without text"));
    const controls = all("button, select, input, a[href], summary").filter(seen);
    controls.forEach((one) => named(one) || fault(one, "control without name"));
    const ids = all("[id]").map((one) => one.id);
    ids.filter((id, i) => ids.indexOf(id) !== i).forEach((id) => faults.push(`id twice: ${id}`));
    const plain = all("div[aria-label], span[aria-label], p[aria-label]").filter((one) => !one.hasAttribute("role"));
    plain.filter(seen).forEach((one) => fault(one, "label without role"));
    all("[role=tab]").forEach((one) => one.closest("[role=tablist]") || fault(one, "tab without list"));
    all("body *").filter(seen).forEach((one) => {
        const scrolls = /auto|scroll/.test(getComputedStyle(one).overflowX) && one.scrollWidth > one.clientWidth + 1;
        const reached = one.tabIndex >= 0 || one.querySelector("button, a[href], [tabindex='0']");
        if (scrolls && !reached) fault(one, "scrolls, but not by keyboard");
    });
    all("table").forEach((one) => one.querySelector("th") || fault(one, "table without headers"));
    return faults;
}
"""
# WCAG 2 contrast of every text with what is behind it: 4.5, and 3 for large letters.
FAINT = """
() => {
    const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
    const bytes = (color) => {
        canvas.clearRect(0, 0, 1, 1);
        canvas.fillStyle = color;
        canvas.fillRect(0, 0, 1, 1);
        return canvas.getImageData(0, 0, 1, 1).data;
    };
    const light = (color) => [...bytes(color)].slice(0, 3)
        .map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const behind = (one) => {
        for (let each = one; each; each = each.parentElement) {
            const color = getComputedStyle(each).backgroundColor;
            if (bytes(color)[3] === 255) return color;
        }
        return "white";
    };
    const faint = [];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const one = walker.currentNode.parentElement;
        const shown = walker.currentNode.data.trim() && one.getClientRects().length;
        if (!shown || one.closest("svg, [aria-hidden=true]")) continue;
        const look = getComputedStyle(one);
        const [a, b] = [light(look.color), light(behind(one))].sort((x, y) => y - x);
        const size = parseFloat(look.fontSize);
        const large = size >= 24 || (size >= 18.66 && Number(look.fontWeight) >= 700);
        const contrast = (a + 0.05) / (b + 0.05);
        if (contrast < (large ? 3 : 4.5)) faint.push(`${contrast.toFixed(2)}: ${one.outerHTML.slice(0, 100)}`);
    }
    return faint;
}
"""


def elasticity(folder: Path) -> Path:
    return written(folder, html(full_content(), []))


def friction(folder: Path) -> Path:
    return written(folder, html_of_friction(study.friction_content(), []))


def responses(folder: Path) -> Path:
    measured = tuple(pair(2, name=name, seed=i)[0] for i, name in enumerate(("near", "far")))
    modes = tuple(without_modes(each, Note("modal/lines", "too few lines")) for each in measured)
    return written(folder, html_of_responses(ResponsesContent("A bench", measured, modes, "a: b", {"seed": "1"}), []))


def fleet(folder: Path) -> Path:
    numbers = [(f"robot {i}", day, 3e5 * (1 + 0.2 * (i == 2))) for i in range(6) for day in (0.0, 90.0)]
    values = tuple(FleetValue(robot, day, "k_2", value, 900.0) for robot, day, value in numbers)
    outcomes = tuple(Outcome(f"robot {i}", "2026-01-01", "converged", "cut short" if i else "") for i in range(6))
    findings = tuple(find_changes(values, false_discovery_rate=0.05))
    answer = answer_of_fleet("A cell", findings, outcomes, 0.05)
    return written(folder, html_of_answer(answer, "us", []))


def written(folder: Path, text: str) -> Path:
    path = folder / "report.html"
    path.write_text(text, "utf-8")
    return path


PAGES = [elasticity, *(pytest.param(page, marks=pytest.mark.slow) for page in (friction, responses, fleet))]


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_names_headings_and_contrast(
    visit: Any, tmp_path: Path, page: Callable[..., Path], scheme: str
) -> None:
    """At a desk and on a phone, with everything folded opened."""
    opened = visit(page(tmp_path), color_scheme=scheme)
    opened.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    for width in (1440, 390):
        opened.set_viewport_size({"width": width, "height": 850})
        assert opened.evaluate("document.documentElement.scrollWidth") <= width
        assert opened.evaluate(FAULTS) == []
        assert opened.evaluate(FAINT) == []
