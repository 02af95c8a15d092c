"""Windows of bins about the lines of a local method, and the fits in them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants import local_plants as study
from scipy.stats import kstest

from elastid.frf.local import least_squares
from elastid.frf.local.least_squares import WindowTerms, fit_ladder, fitted_transient, windows
from elastid.frf.local.response import local_response


@given(count=st.integers(3, 60), n_w=st.integers(1, 40), line=st.integers(0, 200), seed=st.integers(0, 10**6))
@settings(deadline=None, max_examples=50)
def test_a_window_is_of_neighbours_and_holds_its_line_in_the_middle_or_at_an_end_of_the_band(
    count: int, n_w: int, line: int, seed: int
) -> None:
    """On any grid: contiguous, n_w of them, offsets within [-1, 1]; off centre only against an end."""
    available = np.sort(np.random.default_rng(seed).permutation(200)[:count])
    window = windows(available, np.array([line]), n_w)
    index = window.index[0]
    assert len(index) == min(n_w, count)
    assert np.all(np.diff(index) == 1)
    assert np.abs(window.offset).max() <= 1
    below, above = np.sum(available[index] < line), np.sum(available[index] > line)
    if index[0] > 0 and index[-1] < count - 1:
        assert abs(below - above) <= 1


def test_the_residual_of_local_fits_is_chi_square_with_its_degrees_of_freedom() -> None:
    """2 scatter / variance of each output has 2 dof real ones: Kolmogorov and Smirnov, and its mean to 2 %."""
    rng = np.random.default_rng(1)
    bins, n_u, n_z, E = 3000, 2, 3, 2
    Z = rng.normal(size=(E, bins, n_z)) + 1j * rng.normal(size=(E, bins, n_z))
    R = np.exp(2j * np.pi * rng.random((E, bins, n_u)))
    terms = WindowTerms(n_u, 2, 0, transient=True)
    n_w = terms.width(6, E, n_z)
    # Windows that share no bin.
    lines = np.arange(n_w, bins - n_w, n_w + 1)
    fit = fit_ladder(Z, R, windows(np.arange(bins), lines, n_w), [terms]).chosen
    statistic = np.einsum("fzz->fz", fit.scatter).real
    assert fit.dof == terms.degrees_of_freedom(n_w, E, n_z) == E * (n_w - 3) - 6
    assert statistic.mean() / fit.dof == pytest.approx(2, rel=0.02)
    assert kstest(statistic.ravel(), "chi2", args=(2 * fit.dof,)).pvalue > 0.01


def test_poles_that_fit_mere_noise_are_not_taken() -> None:
    """A rational fit of noise would leave 15 % too little residual; that of the ladder is true to 2 %."""
    rng = np.random.default_rng(2)
    bins = 20000
    Z = rng.normal(size=(1, bins, 1)) + 1j * rng.normal(size=(1, bins, 1))
    R = np.zeros((1, bins, 0), dtype=np.complex128)
    ladder = [WindowTerms(0, 2, poles, transient=True) for poles in (0, 2)]
    where = windows(np.arange(bins), np.arange(20, bins - 20, 4), ladder[1].width(6, 1, 1))
    greedy, careful = (fit_ladder(Z, R, where, steps).chosen for steps in (ladder[1:], ladder))
    assert np.mean(greedy.scatter.real) / greedy.dof < 2 * 0.9
    assert np.mean(careful.scatter.real) / careful.dof == pytest.approx(2, rel=0.02)


def test_blocks_of_lines_do_not_change_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line at a time equals all at once."""
    taken = study.TwoModes(N=512, lines=(6, 200)).from_rest(2, 60.0, np.random.default_rng(0))
    whole = local_response([taken], study.LRM)
    monkeypatch.setattr(least_squares, "_BLOCK_NUMBERS", 1)
    np.testing.assert_allclose(local_response([taken], study.LRM).G, whole.G, rtol=1e-9)


def test_a_transient_of_two_poles_is_recovered_at_the_lines_from_the_bins_between_them() -> None:
    """Exactly, for all signals at once; five bins are as many as its terms, and separate nothing."""
    bins = np.arange(1, 61)
    lines, rest = bins[bins % 3 == 0], bins[bins % 3 != 0]

    def transient(k: np.ndarray) -> np.ndarray:
        poles = (k[:, None] - 20 - 6j) * (k[:, None] - 45 + 5j) / 400
        return np.stack([1 + 0.01 * k, 2 - 0.02j * k], axis=1) / poles

    fit = fitted_transient(transient(rest), rest, lines, n_y=1)
    assert fit is not None
    np.testing.assert_allclose(fit.T[:, 0], transient(lines), rtol=1e-9)
    assert fitted_transient(transient(rest[:5]), rest[:5], lines, n_y=1) is None
    assert fitted_transient(transient(rest[:6]), rest[:6], lines, n_y=1) is not None
