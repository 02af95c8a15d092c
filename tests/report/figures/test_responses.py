"""Figures of the responses: every curve is the data that was given, in dB or degrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.report_values import FREQ_HZ, lines_of, pair

from elastid.report.figures.responses import PanelMatrix, coherence, frf_magnitude, frf_phase, levels, singular_values
from elastid.report.page.page import rendered
from elastid.response import Covariance, Levels, Quality
from elastid.validation.residual_tests import above_2sigma, sigma_of


def read_off(axes, label, shape, i, j):
    """Frequencies and values of a curve in panel i, j, by the numbers on the axes: NaN where it is broken."""
    line = lines_of(axes)[label]
    numbers = [text for text in axes.texts if text.get_text().replace("−", "").replace(".", "").isdigit()]
    scales = []
    for side, along, place, count in (("center", 0, j, shape[1]), ("right", 1, i, shape[0])):
        own = [text for text in numbers if text.get_ha() == side]
        own = own[place * len(own) // count : (place + 1) * len(own) // count]
        at = [text.get_position()[along] for text in own]
        values = [float(text.get_text().replace("−", "-")) for text in own]
        scales.append(np.polyfit(at, values if along else np.log(values), 1))
    x, y = line.get_data()
    if np.isnan(x).any():  # a curve, element by element
        own = np.cumsum(np.isnan(x)) == i * shape[1] + j
        own &= ~np.isnan(x)
    else:
        matrix = PanelMatrix(FREQ_HZ, (0.0, 1.0), *shape)
        (left, bottom), (width, height) = matrix.corners, matrix.panel
        own = (abs(x - left[j] - width / 2) < width / 2) & (abs(y - bottom[i] - height / 2) <= height / 2)
    return np.exp(np.polyval(scales[0], x[own])), np.polyval(scales[1], y[own])


@pytest.mark.parametrize(("n_u", "n_y"), [(1, 1), (3, 3), (2, 3)])
def test_the_magnitude_figure_shows_the_data_of_every_element(n_u, n_y):
    """Read off by the numbers on the axes: measured points and model are 20 log10 of what was given, on one range."""
    measured, modelled = pair(n_u, n_y)
    (axes,) = frf_magnitude(measured, modelled, "c1").axes
    above = above_2sigma(measured)
    assert {"std of noise", "std of noise + nonlinear", "|measured − model|"} <= set(lines_of(axes))
    for i, j in np.ndindex(n_y, n_u):
        f, values = read_off(axes, "measured", (n_y, n_u), i, j)
        np.testing.assert_allclose(f, FREQ_HZ[above[:, i, j]], rtol=1e-6)
        np.testing.assert_allclose(values, 20 * np.log10(np.abs(measured.G[above[:, i, j], i, j])), atol=1e-6)
        f, values = read_off(axes, "fitted model", (n_y, n_u), i, j)
        lines = np.searchsorted(FREQ_HZ, f[np.isfinite(values)] * (1 - 1e-6))
        assert len(lines) > 0.8 * len(FREQ_HZ)
        expected = 20 * np.log10(np.abs(modelled.G[lines, i, j]))
        seen = values[np.isfinite(values)]
        np.testing.assert_allclose(seen, np.maximum(expected, seen.min()), atol=1e-6)


def test_the_uncertainty_of_the_model_is_a_band_about_it_and_a_level():
    """2 standard deviations up and down; a level that is the standard deviation itself."""
    measured, modelled = pair(1)
    std = 0.05 * np.abs(modelled.G)
    axes = frf_magnitude(measured, modelled, "c1", std).axes[0]
    G_db = 20 * np.log10(np.abs(modelled.G[:, 0, 0]))
    _, level = read_off(axes, "std of the model", (1, 1), 0, 0)
    np.testing.assert_allclose(level[np.isfinite(level)].max(), G_db.max() + 20 * np.log10(0.05), atol=1e-6)
    (band,) = [one for one in axes.collections if one.get_alpha() == 0.25]
    height = np.ptp(np.concatenate([path.vertices[:, 1] for path in band.get_paths()]))
    scale = np.ptp(lines_of(axes)["fitted model"].get_ydata()[:-1]) / np.ptp(G_db)
    assert height == pytest.approx(scale * (np.ptp(G_db) + 20 * np.log10(1.1 / 0.9)))
    rendered(frf_magnitude(measured, modelled, "c1", np.full(std.shape, np.inf)), "png")


def test_the_phase_figure_shows_the_wrapped_phase_and_breaks_its_line_at_the_wraps():
    """The model's points are those given; between two of them on either side of 180 degrees there is no line."""
    measured, modelled = pair(2)
    (axes,) = frf_phase(measured, modelled, "c1").axes
    for i, j in np.ndindex(2, 2):
        _, phase = read_off(axes, "fitted model", (2, 2), i, j)
        given = np.degrees(np.angle(modelled.G[:, i, j]))
        np.testing.assert_allclose(phase[::2], given, atol=1e-6)
        assert np.nanmax(np.abs(np.diff(phase))) <= 180
        np.testing.assert_array_equal(np.isnan(phase[1:-1:2]), np.abs(np.diff(given)) > 180)


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


def test_the_singular_values_are_those_of_both_matrices():
    """Points and lines at 20 log10 of NumPy's singular values."""
    measured, modelled = pair(3)
    axes = singular_values(measured, modelled, "c1").axes[0]
    lines = [line for line in axes.get_lines() if line.get_label() == "fitted model"]
    s = np.linalg.svd(modelled.G, compute_uv=False)
    np.testing.assert_allclose(np.stack([line.get_ydata() for line in lines], axis=1), 20 * np.log10(s))


def test_singular_values_below_twice_the_norm_of_sigma_are_grey():
    """Sigma of the whole matrix is the Frobenius norm of its elements' standard deviations."""
    measured, modelled = pair(3)
    drawn = list(singular_values(measured, modelled, "c1").axes[0].get_lines())
    sigma = np.linalg.norm(sigma_of(measured)[0], axis=(1, 2))
    s = np.linalg.svd(measured.G, compute_uv=False)
    grey = sum(len(line.get_xdata()) for line in drawn if line.get_label() == "measured, below 2 sigma")
    assert grey == np.sum(s < 2 * sigma[:, None])
    (noise,) = [line for line in drawn if line.get_label() == "sigma of the matrix"]
    np.testing.assert_allclose(noise.get_ydata(), 20 * np.log10(sigma))


def test_the_range_holds_the_points_and_at_most_30_dB_below_them():
    """Noise far below does not squeeze the curves."""
    measured, modelled = pair(1)
    quiet = replace(measured, noise=Covariance(np.full(measured.G.shape, 1e-30), 11))
    axes = frf_magnitude(quiet, modelled, "c1").axes[0]
    _, points = read_off(axes, "measured", (1, 1), 0, 0)
    _, level = read_off(axes, "std of noise + nonlinear", (1, 1), 0, 0)
    db = 20 * np.log10(np.abs(measured.G))
    assert points.max() == pytest.approx(db.max())
    assert np.percentile(db, 1) - 35 < np.nanmin(level)


RESPONSE = pair(2, 4)[0]
N = len(RESPONSE.freq_hz)


def db(values):
    return 20 * np.log10(values)


def made_up():
    """Two inputs, four outputs; two even and three odd detection lines."""
    rng = np.random.default_rng(0)

    def level(n):
        return Levels(np.arange(3.0, 3.0 + n), 2 + rng.random((n, 4)), rng.random((n, 4)))

    return Quality(
        coherence=rng.random((N, 4, 2)),
        multiple_coherence=0.5 + 0.5 * rng.random((N, 4)),
        singular_values=rng.random((N, 2)),
        input_singular_values=np.tile([3.0, 2.0], (N, 1)),
        input_noise=rng.random((N, 2)),
        output_noise=rng.random((N, 4)),
        excited=level(N),
        stochastic=rng.random((N, 4)),
        even=level(2),
        odd=level(3),
    )


def test_the_levels_of_every_output_are_drawn_and_noise_is_taken_off_the_detection_lines():
    """In power, at the detection lines' own frequencies; a spare panel is empty."""
    quality = made_up()
    panels = levels(RESPONSE, quality, "c1").axes
    assert [axes.axison for axes in panels] == [True] * 4 + [False] * 2
    for i, axes in enumerate(panels[:4]):
        drawn = lines_of(axes)
        np.testing.assert_allclose(drawn["excited lines"].get_ydata(), db(quality.excited.amplitude[:, i]))
        np.testing.assert_allclose(drawn["noise"].get_ydata(), db(quality.excited.noise[:, i]))
        np.testing.assert_allclose(drawn["stochastic nonlinear"].get_ydata(), db(quality.stochastic[:, i]))
        for name, found in (("even", quality.even), ("odd", quality.odd)):
            level = np.sqrt(found.amplitude[:, i] ** 2 - found.noise[:, i] ** 2)
            np.testing.assert_allclose(drawn[f"nonlinear, {name}"].get_ydata(), db(level))
            np.testing.assert_allclose(drawn[f"nonlinear, {name}"].get_xdata(), found.freq_hz)


def test_the_coherence_figure_shows_the_unexplained_share_and_singular_values():
    """One curve an output, two singular values of G and of the inputs, their condition in the title."""
    quality = made_up()
    lost, gains, inputs = coherence(RESPONSE, quality, "c1").axes
    shown = [line.get_ydata() for line in lost.get_lines()]
    np.testing.assert_allclose(shown, 1 - quality.multiple_coherence.T)
    np.testing.assert_allclose([line.get_ydata() for line in gains.get_lines()], db(quality.singular_values.T))
    np.testing.assert_allclose([line.get_ydata() for line in inputs.get_lines()], db(quality.input_singular_values.T))
    assert inputs.get_title().endswith("condition 1.5")
