"""The page of a study that ran: every choice is clicked, and every curve that is drawn is compared with the files."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.two_axes import ROBOT, STUDY

from elastid.app.cli import run_command
from elastid.store.measured import read_responses
from elastid.store.results import read_fit, read_modelled

CHANGES = (
    "experiment={configurations: {folded: [0, 60 deg], stretched: [30 deg, 0]}, realisations: 2}",
    "experiment.simulated={truth: {k_1: 36e3, k_2: 12e3}, noise: {torque_std: 0.1, angle_std: 1e-6}}",
    "report.formats=[]",
)
# Keeps each plot that is drawn, with what it is drawn from.
RECORD_PLOTS = """
    window.plots = [];
    Object.defineProperty(window, "uPlot", {
        get() { return this.recorded; },
        set(plain) {
            const construct = (target, given) => {
                const plot = new target(...given);
                window.plots.push(plot);
                return plot;
            };
            this.recorded = new Proxy(plain, { construct });
        },
    });
"""
DRAWN = """
    () => window.plots.filter((plot) => document.getElementById("explorer").contains(plot.root)).map((plot) => ({
        logarithmic: plot.scales.x.distr === 3,
        curves: Object.fromEntries(plot.series.map((one, i) => [one.label, [...plot.data[i]]])),
    }))
"""
# Clicks each switch of a legend twice: labels of the curves before, and the text of each switch with its states after.
CLICK_SWITCHES = """
    (place) => {
        const shown = () => {
            return window.plots.findLast((one) => place.contains(one.root)).series.map((one) => one.label);
        };
        const before = shown(), count = place.querySelectorAll(".key button").length, switches = [];
        const button = (i) => place.querySelectorAll(".key button")[i];
        for (let i = 0; i < count; i++) {
            const states = [0, 1].map(() => {
                button(i).click();
                return [button(i).getAttribute("aria-pressed") === "true", shown()];
            });
            switches.push([button(i).innerText, states]);
        }
        return [before, switches];
    }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """All results of the study, and its parameters as CSV."""
    where = tmp_path_factory.mktemp("study")
    (where / "robot.yml").write_text(ROBOT)
    (where / "study.yml").write_text(STUDY)
    study, run = str(where / "study.yml"), str(where / "run")
    options = ["--run", run, "-q", *(word for change in CHANGES for word in ("--set", change))]
    assert run_command(["run", study, "--jobs", "1", *options]) == 0
    assert run_command(["export", study, "--to", "csv", *options]) == 0
    return where / "run"


@pytest.fixture
def opened(browser, folder) -> Iterator[Any]:
    """The page, with its plots on record."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    context.add_init_script(RECORD_PLOTS)
    page = context.new_page()
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((folder / "report.html").as_uri())
    yield page
    context.close()
    assert complaints == []


def expected(folder: Path, name: str) -> dict[str, Any]:
    """Of each curve its values on the measured lines, from frf.h5 and fit.h5, by output and input."""
    measured = next(G for G in read_responses(folder / "frf.h5") if G.configuration.name == name)
    model = read_fit(folder / "fit.h5").model(name).response(measured.freq_hz, sampled=True).G
    (modelled,) = [G.G for G in read_modelled(folder / "fit.h5") or () if G.configuration.name == name]
    assert modelled == pytest.approx(model, rel=1e-9)
    with np.errstate(divide="ignore"):
        return {
            "magnitude": {
                "measured": 20 * np.log10(np.abs(measured.G)),
                "model": 20 * np.log10(np.abs(model)),
                "|measured − model|": 20 * np.log10(np.abs(measured.G - model)),
            },
            "phase": {"measured": np.degrees(np.angle(measured.G)), "model": np.degrees(np.angle(model))},
            "coherence": {"coherence": measured.quality.coherence},
            "frequency": measured.freq_hz,
        }


def compare(drawn: dict[str, Any], known: dict[str, Any], quantity: str, output: int, source: int) -> None:
    """What a plot shows on the measured lines is what the files hold there."""
    x = np.array(drawn["curves"]["frequency"])
    lines = np.searchsorted(x, known["frequency"] * (1 - 1e-5))
    assert x[lines] == pytest.approx(known["frequency"], rel=1e-5)
    for label, values in known[quantity].items():
        shown = np.array([np.nan if v is None else v for v in drawn["curves"][label]], dtype=float)[lines]
        there = np.isfinite(shown)  # a phase is not drawn across the ends of its circle
        assert there.mean() > 0.9, (quantity, label)
        # Numbers of 32 bits: a difference of two that are 65 dB larger is known to 0.01 dB.
        within = 0.01 if "−" in label else 2e-3
        assert shown[there] == pytest.approx(values[:, output, source][there], abs=within), (quantity, label)


@pytest.mark.slow
@pytest.mark.parametrize("tab", [0, 1])
def test_explorer_choices_draw_numbers_of_files(opened, folder, tab):
    """Both configurations, each quantity as a matrix and each element alone, logarithmic and linear."""
    opened.locator("#explorer [role=tab]").nth(tab).click()
    known = expected(folder, opened.locator("#explorer [role=tab]").nth(tab).inner_text().split(" (")[0])
    quantity, element, scale = (opened.locator("#explorer select").nth(i) for i in range(3))
    kinds = quantity.evaluate("select => [...select.options].map((one) => one.value)")
    assert kinds == ["magnitude", "phase", "coherence", "ratio"]
    for axis in ("log", "linear"):
        scale.select_option(axis)
        for kind in kinds[:3]:
            quantity.select_option(kind)
            plots = opened.evaluate(DRAWN)
            assert [plot["logarithmic"] for plot in plots] == 4 * [axis == "log"]
            for e, plot in enumerate(plots):
                compare(plot, known, kind, *divmod(e, 2))
    for e in range(4):
        element.select_option(str(e))
        plots = opened.evaluate(DRAWN)
        assert len(plots) == len(kinds)
        for kind, plot in zip(kinds[:3], plots[:3], strict=True):
            compare(plot, known, kind, *divmod(e, 2))


def test_legend_switches_hide_and_show_curves(opened):
    """In the explorer and on the first screen; a phase never crosses the ends of its circle in a line."""
    n_switches = []
    for place in (opened.locator("#explorer"), opened.locator("#worst")):
        before, switches = place.evaluate(CLICK_SWITCHES)
        n_switches.append(len(switches))
        for text, states in switches:
            label = text.split(" ", 1)[1]
            assert [pressed for pressed, _ in states] in ([True, False], [False, True])
            assert [label in shown for _, shown in states] == [pressed for pressed, _ in states]
            assert states[1][1] == before
    assert n_switches[0] > 2
    opened.locator("#explorer select").first.select_option("phase")
    for plot in opened.evaluate(DRAWN):
        model = np.array([np.nan if v is None else v for v in plot["curves"]["model"]], dtype=float)
        assert not np.any(np.abs(np.diff(model)) > 180)


def test_the_table_holds_the_numbers_of_the_csv_file(opened, folder):
    """Estimate and interval of every identified number, sorted by either; the copied text has a row for each."""
    with (folder / "export" / "csv" / "parameters.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    result = read_fit(folder / "fit.h5")
    known = {row["parameter"]: float(row["value"]) for row in rows}
    names = opened.locator("#numbers-table tbody td:first-child b").all_inner_texts()
    assert names == list(result.parameters.free_names)
    head = opened.locator("#numbers-table th", has_text="estimate").first
    head.locator("button").click()
    shown = opened.evaluate(
        "() => [...document.querySelectorAll('#numbers-table tbody tr')].map((row) => "
        "[row.querySelector('b').textContent, Number(row.querySelector('td[data-value]').dataset.value)])"
    )
    assert [value for _, value in shown] == sorted(value for _, value in shown)
    assert dict(shown) == pytest.approx({name: known[name] for name in names}, rel=1e-5)
    assert head.get_attribute("aria-sort") == "ascending"


def test_modes_of_chosen_configuration_are_of_fit(opened, folder):
    """One drawing at a time, of the configuration whose tab is chosen; Hz as `result.model` has them."""
    result = read_fit(folder / "fit.h5")
    for tab in range(2):
        opened.locator("#mode-tabs [role=tab]").nth(tab).click()
        name = opened.locator("#mode-tabs [role=tab]").nth(tab).inner_text()
        visible = opened.locator("tr[data-mode]:visible")
        shown = [float(text) for text in visible.locator("td:nth-child(3)").all_inner_texts()]
        frequencies = np.asarray(result.model(name).modes().freq_hz)
        for value in shown:
            assert np.abs(frequencies / value - 1).min() < 1e-3
        assert opened.locator("tr.mode-drawing").count() == 1
        assert opened.locator("tr.mode-drawing p").first.inner_text().startswith(name)
        for i in range(visible.count()):
            if visible.nth(i).locator("button").get_attribute("aria-expanded") == "false":
                visible.nth(i).locator("button").click()
            assert opened.locator("tr.mode-drawing svg path[d]").count() > 0
    opened.locator("#mode-viewer button").click()


def test_folded_parts_open_and_links_resolve(opened):
    for i in range(opened.locator("details").count()):
        opened.locator("details summary").nth(i).click()
        assert opened.locator("details").nth(i).evaluate("one => one.open && one.scrollHeight > 40")
    dead = opened.evaluate(
        "() => [...document.querySelectorAll('a[href^=\"#\"]')].filter((a) => !document.querySelector(a.hash)).length"
    )
    assert dead == 0
    for i in range(opened.locator(".strip button").count()):
        opened.locator(".strip button").nth(i).click()
        label_text = opened.locator(".strip button").nth(i).get_attribute("aria-label")
        name, element = label_text.rsplit(": ", 1)[0].split(", ", 1)
        assert opened.locator("#worst .title").inner_text() == f"{name}: {element}"


def test_page_without_data_is_small_and_prints_short(opened, folder):
    """Scripts, styles, tables and texts below 150 kB; no table or drawing is wider than the paper."""
    text = (folder / "report.html").read_text(encoding="utf-8")
    data = re.findall(r'<script type="application/json".*?</script>|<img [^>]*>', text, re.DOTALL)
    assert len(data) >= 2
    assert len(text.encode()) - len("".join(data).encode()) < 150_000
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", opened.pdf(prefer_css_page_size=True))) <= 12
    opened.set_viewport_size({"width": 688, "height": 1000})  # A4 within its margins
    opened.emulate_media(media="print")
    wide = (
        "() => [...document.querySelectorAll('table, figure')].filter((one) => one.getBoundingClientRect().right > 690)"
    )
    assert opened.evaluate(f"({wide})().map((one) => one.outerHTML.slice(0, 80))") == []
