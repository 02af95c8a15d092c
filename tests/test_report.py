"""The report shows what it was given, all of it, escaped, reproducible, and needs nothing from outside."""

import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from elastid.experiment.plan import Plan
from elastid.fit.result import FitResult, Start
from elastid.parameters import Parameter, ParameterSet, Tie
from elastid.record import Configuration
from elastid.report.content import ModeRow, ReportContent
from elastid.report.excitation_figures import excitation
from elastid.report.fit_figures import identifiability, multistart
from elastid.report.forest import forest
from elastid.report.frf_figures import frf_magnitude, frf_phase
from elastid.report.numbers import number
from elastid.report.page import html, rendered, write_report
from elastid.report.parameter_rows import parameter_rows
from elastid.response import Covariance, FrequencyResponse
from elastid.validation.frequency import validate
from elastid.validation.noise import above_2sigma

FREQ_HZ = np.arange(2.1, 60.0, 0.8)


def chain(n_u, n_y=None, stiffness=3e5):
    """Acceleration of the first n_y of n_u motors and as many links, each link hung on the next (F, n_y, n_u)."""
    n = 2 * n_u
    M, K, D = np.diag(np.r_[np.full(n_u, 30.0), np.full(n_u, 25.0)]), np.zeros((n, n)), 20.0 * np.eye(n)
    pairs = [(i, n_u + i) for i in range(n_u)] + [(n_u + i, n_u + i + 1) for i in range(n_u - 1)]
    for i, j in pairs:
        v = np.eye(n)[i] - np.eye(n)[j]
        K, D = K + stiffness * np.outer(v, v), D + 500 * np.outer(v, v)
    s = 2j * np.pi * FREQ_HZ[:, None, None]
    return (s**2 * np.linalg.inv(M * s**2 + D * s + K))[:, : n_y or n_u, :n_u]


def pair(n_u, n_y=None, name="c1", rate_is_known=True, seed=0):
    """A measured response with noise and total covariance, and a model that is a little off."""
    rng = np.random.default_rng(seed)
    G, model = chain(n_u, n_y), chain(n_u, n_y, 3.03e5)
    noise, total = np.full(G.shape, 4e-8), 4e-8 + (0.03 * np.abs(G)) ** 2
    Ghat = G + np.sqrt(total / 2) * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape))
    inputs = tuple(f"motor {i + 1}" for i in range(n_u))
    outputs = tuple(f"place {i + 1}" for i in range(G.shape[1]))
    common = (inputs, outputs, "acceleration", Configuration(name, np.radians([10.0] * n_u)))
    measured = FrequencyResponse(
        FREQ_HZ, Ghat, *common, Covariance(noise, 11), Covariance(total, 9), rate_is_known, (f"a note on {name}",)
    )
    return measured, FrequencyResponse(FREQ_HZ, model, *common, rate_is_known=rate_is_known)


PARAMETERS = ParameterSet(
    (
        Parameter("k_1", 2e5, "N*m/rad", 1e3, 1e7, log=True),
        Parameter("k_2", 4e5, "N*m/rad", 1e3, 1e7, log=True),
        Parameter("d_1", 300.0, "N*m*s/rad", 250.0, 1e5, log=True),
        Parameter("x_c", 0.1, "m", -1.0, 1.0),
        Parameter("d_2", 300.0, "N*m*s/rad", log=True, tie=Tie("d_1", 2.0)),
        Parameter("mass", 25.0, "kg", free=False),
    )
)
TRUTH = {"k_1": 3e5, "k_2": 3.1e5, "d_1": 400.0, "x_c": -0.02}


def fit_result(parameters=PARAMETERS, hits=3):
    n = len(parameters.free)
    x = np.array([math.log(3.02e5), math.log(3e5), math.log(250.0), -0.015])[:n]
    std = np.array([0.01, 0.02, 0.2, 0.004])[:n]
    r = np.eye(n)
    r[0, 1] = r[1, 0] = -0.97
    costs = (210.0, 210.0, 210.1, 900.0, 2000.0)
    return FitResult(
        parameters=parameters,
        x=x,
        covariance=r * np.outer(std, std),
        cost=210.0,
        dof=200,
        cost_expected=202.0,
        status="at_bound",
        message="The fit ended with d_1 at its lower bound.",
        starts=tuple(Start(parameters.x, x, cost, 20, cost < 1000, "") for cost in costs),
        hits=hits,
        at_bound=np.arange(n) == 2,
        singular_values=np.array([2.0, 1.0, 0.5, 0.01])[:n],
        criterion="complex",
        warnings=("d_1 is at its lower bound of 250 N*m*s/rad",),
    )


def plan(n_u=3):
    rng = np.random.default_rng(0)
    lines = np.arange(5, 150, 2)
    R = 30 * np.exp(2j * np.pi * rng.random((1, 2, n_u, len(lines), n_u)))
    inputs = tuple(f"motor {i + 1}" for i in range(n_u))
    return Plan((Configuration("c1", np.zeros(n_u)),), inputs, 250.0, 500, 2, 1, lines, R)


def report_content(**changes):
    frf = (pair(2, name="c1"), pair(2, name="c2", seed=1))
    content = ReportContent(
        title="A study",
        verdict="Every stiffness is within 3 % of the truth.",
        warnings=("c1: period 3 was left out", "k_1 and k_2 are nearly one parameter to the data"),
        result=fit_result(),
        frf=frf,
        validation=validate(*zip(*frf, strict=True), left_out=["c2"]),
        modes=(ModeRow("c1", np.array([9.125, 14.2]), np.array([0.04, 0.06])),),
        study_text="robot: arm.yml  # <the robot>\n",
        provenance={"elastid": "0.1.0", "seed": "17"},
        truth=TRUTH,
        plan=plan(2),
    )
    return replace(content, **changes)


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


def lines_of(axes):
    return {line.get_label(): line for line in axes.get_lines()}


@pytest.mark.parametrize(("n_u", "n_y"), [(1, 1), (1, 2), (3, 3), (2, 3)])
def test_the_magnitude_figure_shows_the_data_of_every_element(n_u, n_y):
    """n_y n_u panels; measured points, model and residual are 20 log10 of what was given, on one range."""
    measured, modelled = pair(n_u, n_y)
    panels = frf_magnitude(measured, modelled, "c1").axes
    assert len(panels) == n_y * n_u
    above = above_2sigma(measured)
    for panel, (i, j) in zip(panels, np.ndindex(n_y, n_u), strict=True):
        drawn, keep = lines_of(panel), above[:, i, j]
        np.testing.assert_array_equal(drawn["measured"].get_xdata(), FREQ_HZ[keep])
        np.testing.assert_allclose(drawn["measured"].get_ydata(), 20 * np.log10(np.abs(measured.G[keep, i, j])))
        np.testing.assert_allclose(drawn["fitted model"].get_ydata(), 20 * np.log10(np.abs(modelled.G[:, i, j])))
        E = np.abs(measured.G - modelled.G)[:, i, j]
        np.testing.assert_allclose(drawn["|measured − model|"].get_ydata(), 20 * np.log10(E))
        assert {"std of noise", "std of noise + nonlinear"} <= set(drawn)
        grey = drawn.get("measured, below 2 sigma")
        assert (0 if grey is None else len(grey.get_xdata())) == np.sum(~keep)
        assert panel.get_ylim() == panels[0].get_ylim()
        assert panel.get_xscale() == "log"


def test_the_phase_figure_shows_the_wrapped_phase_and_breaks_its_line_at_the_wraps():
    """The model's points are those given; between two of them on either side of 180 degrees there is no line."""
    measured, modelled = pair(2)
    for panel, (i, j) in zip(frf_phase(measured, modelled, "c1").axes, np.ndindex(2, 2), strict=True):
        phase = lines_of(panel)["fitted model"].get_ydata()
        np.testing.assert_allclose(phase[np.isfinite(phase)], np.degrees(np.angle(modelled.G[:, i, j])))
        steps = np.abs(np.diff(phase))
        assert np.nanmax(steps) <= 180


def test_frequencies_without_a_sampling_rate_are_labelled_as_such():
    """No Hz on the axis where the rate is not known."""
    known = frf_magnitude(*pair(1), "c1")
    unknown = frf_magnitude(*pair(1, rate_is_known=False), "c1")
    assert "Hz" in known.get_supxlabel()
    assert "Hz" not in unknown.get_supxlabel()


def test_a_response_without_uncertainty_is_drawn_without_noise():
    """Imported responses have no covariance: points, model and residual only."""
    measured, modelled = pair(1)
    drawn = lines_of(frf_magnitude(replace(measured, noise=None, total=None), modelled, "c1").axes[0])
    assert set(drawn) == {"measured", "fitted model", "|measured − model|"}


def test_the_forest_plot_shows_start_estimate_truth_and_bound_hits_as_ratios_to_the_truth():
    """Ratios on a logarithmic axis, one row a parameter, the one at its bound marked."""
    rows = parameter_rows(fit_result(), TRUTH)
    ratio, percent = forest(rows).axes
    drawn = lines_of(ratio)
    assert ratio.get_xscale() == "log"
    assert [label.get_text() for label in ratio.get_yticklabels()] == ["k_1", "k_2", "d_1", "x_c"]
    truth = np.array(list(TRUTH.values()))
    start = np.array([2e5, 4e5, 300.0, 0.1])
    np.testing.assert_allclose(drawn["start"].get_xdata(), start / truth)
    np.testing.assert_allclose(drawn["truth"].get_xdata(), [1, 1, 1, 1])
    np.testing.assert_allclose(drawn["estimate at its bound"].get_ydata(), [2])
    # x_c is negative: -0.015 lies above -0.02, by a quarter of it.
    np.testing.assert_allclose(lines_of(percent)["estimate"].get_xdata()[[0, 2]], [100 * (3.02 / 3 - 1), 25.0])
    np.testing.assert_allclose(lines_of(percent)["truth"].get_xdata(), 0.0, atol=1e-9)


def test_an_estimate_that_is_far_off_is_marked_at_the_edge_of_the_percent_axis():
    """Twenty times the truth: an arrow in its row instead of nothing."""
    _, percent = forest(parameter_rows(fit_result(), TRUTH | {"k_2": 1.5e4})).axes
    arrow = lines_of(percent)["estimate off the scale"]
    assert arrow.get_ydata().tolist() == [1.0]
    assert 0 < arrow.get_xdata()[0] < percent.get_xlim()[1]


def test_the_forest_plot_takes_the_estimate_as_reference_where_no_truth_is_known():
    """All estimates at 1; unreachable parameters, whose interval is infinite, and zeros do not break it."""
    result = fit_result()
    covariance = np.array(result.covariance)
    covariance[3, 3] = np.inf
    ratio, _ = forest(parameter_rows(replace(result, covariance=covariance), None)).axes
    np.testing.assert_allclose(lines_of(ratio)["estimate"].get_xdata(), [1, 1, 1])
    assert "estimate" in ratio.get_xlabel()
    zero = replace(result, x=np.array([0.0, 0.0, 0.0, 0.0]))
    rendered(forest(parameter_rows(zero, {"x_c": 0.0})), "png")


def test_rows_say_how_many_standard_deviations_the_estimate_is_from_the_truth():
    """In the solver's variable: ln p for a logarithmic parameter, p for a linear one; none without a truth."""
    rows = parameter_rows(fit_result(), {"k_1": 3e5, "x_c": -0.02})
    assert rows[0].deviation == pytest.approx(math.log(3.02 / 3) / 0.01)
    assert rows[1].deviation is None
    assert rows[3].deviation == pytest.approx(0.005 / 0.004)


def test_the_multistart_figure_tells_hits_from_other_endings():
    """Three hits, one that ended elsewhere, one that did not converge, each at its cost."""
    figure = multistart(fit_result())
    drawn = lines_of(figure.axes[0])
    np.testing.assert_allclose(drawn["reached the best cost"].get_ydata(), [210.0, 210.0, 210.1])
    np.testing.assert_allclose(drawn["ended elsewhere"].get_ydata(), [900.0])
    np.testing.assert_allclose(drawn["did not converge"].get_ydata(), [2000.0])
    assert "3 of 5" in figure.texts[0].get_text()


def test_the_identifiability_figure_writes_strong_correlations_into_the_matrix():
    """-0.97 twice, nothing else; the singular values beside it."""
    matrix, values, _ = identifiability(fit_result()).axes
    np.testing.assert_allclose(matrix.images[0].get_array(), fit_result().correlation)
    assert [text.get_text() for text in matrix.texts] == ["-0.97", "-0.97"]
    np.testing.assert_allclose(values.get_lines()[0].get_ydata(), [2.0, 1.0, 0.5, 0.01])


def test_the_excitation_figure_shows_one_period_of_every_input():
    """The torque that the plan injects in its first experiment, and its line amplitudes."""
    given = plan(3)
    panels = excitation(given).axes
    assert len(panels) == 6
    for j in range(3):
        spectrum, time = panels[2 * j], panels[2 * j + 1]
        np.testing.assert_allclose(spectrum.get_lines()[0].get_ydata(), 30.0)
        np.testing.assert_allclose(time.get_lines()[0].get_ydata(), given.torque(given.experiments[0])[:, j])


def test_the_page_shows_every_warning_parameter_and_configuration(tmp_path):
    """Warnings of the stages and of the fit, estimates with the truth, errors, modes, notes, study, provenance."""
    content = report_content()
    text = Page(write_report(content, tmp_path, ("png",)).read_text("utf-8")).text
    assert len(content.all_warnings) == 5
    for warning in content.all_warnings:
        assert text.count(warning) == 1
    for row in parameter_rows(content.result, TRUTH):
        assert row.name in text
        assert number(row.truth, 5) in text
    for given in ("d_2", "2.000 × d_1", "mass", "25.000", "left out", "9.125", "4.0 %"):
        assert given in text
    for given in (content.title, content.verdict, content.validation.verdict, content.study_text, "17"):
        assert given in text
    assert (
        text.index(content.warnings[0]) < text.index(content.verdict) < text.index("k_1", text.index("95 % interval"))
    )


def test_the_page_counts_what_was_mended_in_the_records():
    """A row for each configuration with repairs, a column for each kind; no table where nothing was mended."""
    (first, model), (second, other) = pair(1, name="c1"), pair(1, name="c2")
    first = replace(first, repairs={"missing samples filled": 21})
    second = replace(second, repairs={"spikes replaced": 3, "missing samples filled": 4})
    shown = html(report_content(frf=((first, model), (second, other))), [])
    table = shown[shown.index("What was mended") : shown.index("</table>", shown.index("What was mended"))]
    assert "<th>missing samples filled</th><th>spikes replaced</th>" in table
    assert "<td>c1</td><td>21</td><td>0</td>" in table
    assert "<td>c2</td><td>4</td><td>3</td>" in table
    assert "What was mended" not in html(report_content(), [])


def test_the_page_needs_nothing_from_outside(tmp_path):
    """No script or style sheet but its own, no address but embedded images and places on the page."""
    source = write_report(report_content(), tmp_path, ()).read_text("utf-8")
    page = Page(source)
    assert 'src="http' not in source
    assert "<script src" not in source
    assert not {"link", "iframe", "object", "base"} & set(page.tags)
    assert page.tags.count("img") == 8
    assert all(address.startswith(("data:image/png;base64,", "#")) for address in page.addresses)
    without_images = re.sub(r"base64,[A-Za-z0-9+/=]+|<script>.*?</script>", "", source, flags=re.DOTALL)
    assert "://" not in without_images
    assert "url(" not in without_images
    places = re.findall(r'id="([^"]+)"', without_images)
    assert {address[1:] for address in page.addresses if address.startswith("#")} <= set(places)


def test_hostile_names_are_shown_and_not_obeyed(tmp_path):
    """HTML, a formula, a path and a letter that the font lacks, as names: text on the page, files in the folder."""
    evil, formula = "<script>alert(1)</script>", r"$\frac{"
    parameters = ParameterSet(
        tuple(replace(p, name=new) for p, new in zip(PARAMETERS.free, (evil, formula, "度", 'a"b'), strict=True))
    )
    frf = (pair(1, name="../../" + evil), pair(1, name=".. .. script-alert-1-script-"), pair(1, name=formula + "度"))
    content = report_content(
        title=evil,
        warnings=(f"{evil} & 'quotes'",),
        result=fit_result(parameters),
        frf=frf,
        validation=validate(*zip(*frf, strict=True), left_out=[]),
        study_text=evil,
        provenance={evil: evil},
        truth=None,
    )
    page = Page(write_report(content, tmp_path / "run", ("png", "pdf")).read_text("utf-8"))
    assert page.tags.count("script") == 3  # the data, the plotting library, the page's own
    for name in (*parameters.names, *content.warnings, frf[0][0].configuration.name):
        assert name in page.text
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file())
    assert all(re.fullmatch(r"run/(report\.(html|pdf)|figures/[A-Za-z0-9_.-]+\.(png|pdf))", file) for file in files)
    assert len(files) == 2 + 2 * (2 * len(frf) + 4)


def test_the_same_content_gives_the_same_bytes(tmp_path):
    """Page, PNG and PDF: no date, no version, no random name."""
    folders = (tmp_path / "a", tmp_path / "b")
    for folder in folders:
        write_report(report_content(), folder, ("png", "pdf"))
    first, second = ({p.relative_to(f): p.read_bytes() for p in f.rglob("*") if p.is_file()} for f in folders)
    assert len(first) == 18
    assert first == second


def test_only_the_formats_asked_for_are_written(tmp_path):
    """PDF only: no PNG beside the page, which embeds its own."""
    write_report(report_content(), tmp_path, ("pdf",))
    assert {path.suffix for path in (tmp_path / "figures").iterdir()} == {".pdf"}


def test_a_report_that_cannot_be_written_leaves_the_last_one_whole(tmp_path, monkeypatch):
    """A full disk at the end of a file: the error is raised, the old page stays, no half file."""
    page = write_report(report_content(), tmp_path, ())
    before = page.read_bytes()

    def full(_):
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="no space"):
        write_report(report_content(title="Another"), tmp_path, ("png",))
    assert page.read_bytes() == before
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [page]


def test_options_load_neither_matplotlib_nor_jinja():
    """`elastid check` reads the sections of a study and must not pay for figures."""
    code = (
        "import sys, elastid.report.spec, elastid.validation.spec\n"
        "print([m for m in ('matplotlib', 'jinja2', 'scipy') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


# In a real browser. Without background traffic: a page that opens offline must not wait for anything.
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@pytest.fixture
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as engine:
        chromium = engine.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser, tmp_path):
    """The page of two configurations of a two-axis robot, and what its console said or it asked the network for."""
    path = write_report(report_content(), tmp_path, [])
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    complaints = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: complaints.append(request.url) if request.url.startswith("http") else None)
    page.goto(path.as_uri())
    yield page
    assert complaints == []


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


def test_the_page_fits_a_phone_and_paper(browser, tmp_path):
    path = write_report(report_content(), tmp_path, [])
    phone = browser.new_page(viewport={"width": 390, "height": 800})
    phone.goto(path.as_uri())
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    phone.emulate_media(media="print")
    assert not phone.locator("#explorer").is_visible()
    assert phone.pdf().startswith(b"%PDF")


def test_names_from_a_file_cannot_run_in_the_browser(browser, tmp_path):
    frf = (pair(2, name="</script><script>document.title='run'</script>"),)
    content = report_content(title="<img src=x onerror=alert(1)>", frf=frf)
    page = browser.new_page()
    page.goto(write_report(content, tmp_path, []).as_uri())
    assert page.title() == "<img src=x onerror=alert(1)>"
    assert "</script>" in page.locator("#explorer select").nth(0).inner_text()
