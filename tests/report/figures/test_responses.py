"""Figures of the responses: every curve is the data that was given, in dB or degrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.report_values import FREQ_HZ, lines_of, pair

from elastid.report.figures.responses import frf_magnitude, frf_phase, singular_values
from elastid.report.page.page import rendered
from elastid.response import Covariance
from elastid.validation.residual_tests import above_2sigma, sigma_of


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
    low, high = frf_magnitude(quiet, modelled, "c1").axes[0].get_ylim()
    db = 20 * np.log10(np.abs(measured.G))
    assert high > db.max()
    assert np.percentile(db, 1) - 35 < low < np.percentile(db, 1) - 29
