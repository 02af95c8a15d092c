"""The report shows what it was given, all of it, escaped, reproducible, and needs nothing from outside."""

import io
import math
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from plants.report_values import FREQ_HZ, PARAMETERS, TRUTH, fit_result, pair, plan, report_content

from elastid.parameters import ParameterSet
from elastid.report.content import ModeRow
from elastid.report.figures.design import excitation
from elastid.report.figures.drawings import drawings
from elastid.report.figures.fit import identifiability, multistart
from elastid.report.figures.mode_shapes import mode_shapes
from elastid.report.figures.parameters import forest
from elastid.report.figures.responses import frf_magnitude, frf_phase, singular_values
from elastid.report.figures.validation import model_errors, replay_signals
from elastid.report.numbers import number
from elastid.report.page.explorer import explorer
from elastid.report.page.page import (
    MAX_FIGURE_BYTES,
    EmbeddedFigure,
    fewer_colors,
    html,
    rendered,
    within,
    write_report,
)
from elastid.report.parameter_rows import parameter_rows
from elastid.validation.agreement import validate
from elastid.validation.residual_tests import above_2sigma
from elastid.validation.results import Fold, Replay


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


def test_the_uncertainty_of_the_model_is_a_band_about_it_and_a_level():
    """2 standard deviations up and down; a level that is the standard deviation itself."""
    measured, modelled = pair(1)
    std = 0.05 * np.abs(modelled.G)
    axes = frf_magnitude(measured, modelled, "c1", std).axes[0]
    np.testing.assert_allclose(lines_of(axes)["std of the model"].get_ydata(), 20 * np.log10(std[:, 0, 0]))
    corners = axes.collections[0].get_paths()[0].vertices[:, 1]
    G_db = 20 * np.log10(np.abs(modelled.G[:, 0, 0]))
    assert corners.max() == pytest.approx(G_db.max() + 20 * np.log10(1.1))
    assert corners.min() == pytest.approx(G_db.min() + 20 * np.log10(0.9))
    unknown = frf_magnitude(measured, modelled, "c1", np.full(std.shape, np.inf))
    rendered(unknown, "png")


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
    for given in ("d_2", "2.000 × d_1", "mass", "25.000", "left out", "9.125", "4.000 %"):
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
    table = shown[
        shown.index("Repairs of the records") : shown.index("</table>", shown.index("Repairs of the records"))
    ]
    assert "<th>missing samples filled</th><th>spikes replaced</th>" in table
    assert "<td>c1</td><td>21</td><td>0</td>" in table
    assert "<td>c2</td><td>4</td><td>3</td>" in table
    assert "Repairs of the records" not in html(report_content(), [])


def test_the_page_needs_nothing_from_outside(tmp_path):
    """No script or style sheet but its own, no address but embedded images and places on the page."""
    source = write_report(report_content(), tmp_path, ()).read_text("utf-8")
    page = Page(source)
    assert 'src="http' not in source
    assert "<script src" not in source
    assert not {"link", "iframe", "object", "base"} & set(page.tags)
    assert page.tags.count("img") == 11
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
    assert len(files) == 2 + 2 * (3 * len(frf) + 5)


def test_the_same_content_gives_the_same_bytes(tmp_path):
    """Page, PNG and PDF: no date, no version, no random name."""
    folders = (tmp_path / "a", tmp_path / "b")
    for folder in folders:
        write_report(report_content(), folder, ("png", "pdf"))
    first, second = ({p.relative_to(f): p.read_bytes() for p in f.rglob("*") if p.is_file()} for f in folders)
    assert len(first) == 24
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


def modes(configuration="c1"):
    """Two modes of four coordinates, the second with damping that turns the phase."""
    return ModeRow(
        configuration,
        np.array([9.125, 14.2]),
        np.array([0.04, 0.06]),
        np.array([0.012, 0.1]),
        np.array([0.002, 0.01]),
        ("joint 1", "joint 2", "motor 1", "motor 2"),
        np.array([[1.0, 0.2], [-0.75, 1.0], [0.1, -0.4 + 0.1j], [0.0, 0.6]]),
    )


def replays(configuration="c1", seed=0):
    """Two records of two outputs, the model a tenth too small."""
    measured = np.random.default_rng(seed).standard_normal((400, 2))
    fit = np.array([[90.0, 89.5], [88.0, 91.0]])
    return Replay(
        configuration,
        ("r1", "r2"),
        ("place 1", "place 2"),
        "acceleration",
        ("rad/s^2", "m/s^2"),
        (2.0, 60.0),
        fit,
        np.array([[99.0, 98.0], [99.5, 97.0]]),
        0.1 * np.ones((2, 2)),
        "r2",
        250.0,
        True,
        measured,
        0.9 * measured,
    )


def full_content():
    """A report of everything."""
    content = report_content(modes=(modes("c1"), modes("c2")))
    content = replace(content, model_std=tuple(0.01 * np.abs(G.G) for _, G in content.frf))
    validation = replace(
        content.validation,
        cost="The cost is what the noise alone would leave.",
        replays=(replays("c1"), replays("c2", 1)),
        replayed="Replayed, the model explains 90 %.",
        folds=(Fold("c1", 1.21, 0.5, 2.5), Fold("c2", math.nan, math.nan, math.nan, "no start led anywhere")),
        folded="Left out in turn, 0.5 dB.",
    )
    return replace(content, validation=validation)


def test_the_heat_maps_show_every_error_where_it_belongs():
    """Configurations down, elements across, in the order of the validation, left-out ones marked."""
    validation = report_content().validation
    figure = model_errors(validation)
    maps = [axes for axes in figure.axes if axes.images and axes.get_title()]
    for axes, name in zip(maps, ("rms_log_db", "phase_rms_deg", "rms_sigma"), strict=True):
        given = np.stack([getattr(a, name).ravel() for a in validation.configurations])
        np.testing.assert_allclose(axes.images[0].get_array(), given)
    assert [label.get_text() for label in maps[0].get_yticklabels()] == ["c1", "c2, left out"]
    rightmost = [axes for axes in maps if axes.get_xticklabels()][-1]
    assert rightmost.get_xticklabels()[1].get_text() == "motor 2 → place 1"


def test_configurations_with_other_outputs_have_their_own_columns():
    """Two outputs here, three there: what was not measured stays empty."""
    pairs = [pair(2, 2, name="c1"), pair(2, 3, name="c2")]
    axes = model_errors(validate(*zip(*pairs, strict=True), left_out=[])).axes[0]
    shown = np.ma.filled(axes.images[0].get_array(), np.nan)
    assert shown.shape == (2, 6)
    np.testing.assert_array_equal(np.isnan(shown), [[False] * 4 + [True] * 2, [False] * 6])


@pytest.mark.parametrize(("n_u", "n_configurations"), [(1, 1), (6, 20)])
def test_the_heat_maps_fit_a_page_whatever_their_size(n_u, n_configurations):
    """One element of one configuration, and 36 of twenty."""
    pairs = [pair(n_u, name=f"c{i}") for i in range(n_configurations)]
    figure = model_errors(validate(*zip(*pairs, strict=True), left_out=[]))
    assert figure.get_figwidth() < 12
    rendered(figure, "png")


def test_the_singular_values_are_those_of_both_matrices():
    """Points and lines at 20 log10 of NumPy's singular values."""
    measured, modelled = pair(3)
    axes = singular_values(measured, modelled, "c1").axes[0]
    lines = [line for line in axes.get_lines() if line.get_label() == "fitted model"]
    s = np.linalg.svd(modelled.G, compute_uv=False)
    np.testing.assert_allclose(np.stack([line.get_ydata() for line in lines], axis=1), 20 * np.log10(s))


def test_the_replay_shows_measured_model_and_difference():
    """Close up at the sample where the difference is largest, with the fits of the record that is shown."""
    given = replays()
    figure = replay_signals(given)
    whole, close = figure.axes[0], figure.axes[1]
    drawn = lines_of(close)
    t = drawn["measured"].get_xdata()
    np.testing.assert_allclose(
        drawn["model under the measured torque"].get_ydata() / drawn["measured"].get_ydata(), 0.9
    )
    worst = np.abs(given.measured).max(axis=1).argmax() / given.rate_hz
    assert t[0] <= worst <= t[-1]
    np.testing.assert_allclose(lines_of(whole)["measured − model"].get_ydata(), 0.1 * given.measured[:, 0])
    assert "88.0 % explained (a true model: 99.5 %)" in close.get_title(loc="left")
    assert "2 to 60 Hz" in figure.texts[-1].get_text()


def test_the_bars_of_a_mode_are_its_shape():
    """A row a mode, a bar a coordinate, its height the real part."""
    row = modes()
    figure = mode_shapes(row, "c1", True)
    assert len(figure.axes) == 2
    for m, axes in enumerate(figure.axes):
        np.testing.assert_allclose([bar.get_height() for bar in axes.patches], row.shapes[:, m].real)
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == list(row.coordinates)


def test_the_page_shows_replays_folds_modes_and_the_reason_of_the_cost(tmp_path):
    """Each with its numbers; what moves in a mode is named, the furthest first."""
    text = Page(write_report(full_content(), tmp_path, ()).read_text("utf-8")).text
    for given in ("The cost is what the noise", "Replayed, the model explains 90 %", "Left out in turn, 0.5 dB"):
        assert given in text
    for given in ("no start led anywhere", "1.10", "joint 1 +1.00, joint 2 -0.75", "joint 2 +1.00, motor 2 +0.60"):
        assert given in text
    assert "9.125" in text
    assert "0.012" in text


def test_the_page_shows_further_intervals_and_what_informs_a_parameter():
    """Profile and bootstrap beside the interval; a dash where one was not asked for; the most telling configuration."""
    n = len(PARAMETERS.free)
    share = np.full((2, n), np.nan)
    share[:, :2] = [[0.3, 0.9], [0.7, 0.1]]
    profile = np.full((n, 2), np.nan)
    profile[0] = 2.91e5, 3.17e5
    result = replace(
        fit_result(),
        profile95=profile,
        bootstrap95=np.tile([1.0, 2.0], (n, 1)),
        configurations=("c1", "c2"),
        share=share,
        informing_hz=np.tile([12.0, 25.0], (n, 1)),
        weakest=np.ones(n),
    )
    text = html(report_content(result=result), [])
    assert "by profile" in text
    assert "291000 … 317000" in text
    table = text[text.index("Information on each parameter") :]
    table = table[: table.index("</table>")]
    assert table.count("<tr><td>") == 2
    assert '<td>k_1</td><td class="text">c2</td><td>70 %</td><td>12.0 … 25.0</td>' in table
    assert "by profile" not in html(report_content(), [])


def test_every_figure_of_a_full_report_is_drawn_once():
    """Names are file names and so unique; each belongs to a section of the page."""
    names = [drawing.name for drawing in drawings(full_content())]
    assert len(set(names)) == len(names)
    assert {"errors", "frf-c1-singular-values", "frf-c2-replay", "frf-c1-modes"} <= set(names)


def test_figures_without_room_on_the_page_are_linked_to():
    """The largest of single configurations first; others stay whatever they cost."""
    figures = [
        EmbeddedFigure("parameters", "parameters", "all", "x" * 900, "figures/parameters.png"),
        EmbeddedFigure("a", "configuration c1", "first", "x" * 500, "figures/a.png"),
        EmbeddedFigure("b", "configuration c1", "second", "x" * 100, "figures/b.png"),
    ]
    assert [bool(figure.png) for figure in within(figures, 1500)] == [True, True, True]
    assert [bool(figure.png) for figure in within(figures, 1499)] == [True, False, True]
    assert [bool(figure.png) for figure in within(figures, 10)] == [True, False, False]
    page = Page(html(report_content(), within(figures, 1000)))
    assert "figures/a.png" in page.addresses
    assert "report.formats" in html(report_content(), [replace(figures[1], png="", file="")])


def test_the_page_of_twenty_configurations_of_six_axes_stays_below_ten_megabytes(monkeypatch):
    """200 lines of 36 elements each, with every curve, beside as many figures as have room."""
    monkeypatch.setitem(globals(), "FREQ_HZ", np.arange(2.0, 102.0, 0.5))
    frf = [pair(6, name=f"c{i}", seed=i) for i in range(20)]
    data = explorer(frf, [], [0.01 * np.abs(G.G) for _, G in frf])
    assert len(data.data) + sum(map(len, data.scripts)) + MAX_FIGURE_BYTES < 9.9e6


def test_fewer_colors_are_the_same_picture():
    """No pixel of a figure is further off than the eye can see, half of the bytes are gone."""
    image = pytest.importorskip("PIL.Image")
    png = rendered(frf_magnitude(*pair(3), "c1"), "png")
    small = fewer_colors(png)
    assert len(small) < 0.5 * len(png)
    before, after = (np.asarray(image.open(io.BytesIO(data)).convert("RGB"), dtype=float) for data in (png, small))
    assert np.sqrt(np.mean((before - after) ** 2)) < 3


# In a real browser.
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


def test_the_browser_shows_the_uncertainty_of_the_model(browser, tmp_path):
    content = full_content()
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.goto(write_report(content, tmp_path, []).as_uri())
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
