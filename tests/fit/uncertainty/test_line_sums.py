"""Blocks of a configuration and a band: their scatter states the variance, their disagreement an error of the model."""

from itertools import pairwise

import numpy as np
import pytest

from elastid.fit.uncertainty.jackknife import block_variance, disagreement
from elastid.fit.uncertainty.line_sums import MAX_BANDS, MIN_BANDS, Blocks, bands

F, N_X, SETS = 240, 3, 400


def drawn(rng: np.random.Generator, length: int, band: int) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Estimates (SETS, N_X) of a line fit under noise averaged over `length` lines, their variances, and T."""
    J = rng.standard_normal((F, N_X)) + np.linspace(-1, 1, F)[:, None]
    A_inverse = np.linalg.inv(J.T @ J)
    found, stated, parted = [], [], []
    for _ in range(SETS):
        white = rng.standard_normal(F + length - 1)
        r = np.convolve(white, np.ones(length) / np.sqrt(length), "valid")
        x = A_inverse @ J.T @ r
        pull = (J * (r - J @ x)[:, None]).reshape(-1, band, N_X).sum(axis=1)
        known = np.einsum("kfi,kfj->kij", *2 * [J.reshape(-1, band, N_X)])
        blocks = [Blocks(pull, known)]
        found.append(x)
        stated.append(block_variance(blocks, A_inverse))
        parted.append(disagreement(blocks, A_inverse))
    return np.array(found), np.array(stated), parted


def test_of_white_residuals_blocks_state_the_scatter_and_agree() -> None:
    """Variances to 15 %, T = 1.00 to 2 %, whatever the blocks."""
    x, variance, parted = drawn(np.random.default_rng(0), 1, 12)
    np.testing.assert_allclose(variance.mean(axis=0), x.var(axis=0), rtol=0.2)
    assert np.mean(parted) == pytest.approx(1.0, abs=0.02)
    assert max(parted) < 1.8


def test_of_correlated_residuals_long_blocks_state_the_scatter_and_single_lines_do_not() -> None:
    """Noise averaged over ten lines: single lines state a fraction of the variance, blocks of thirty nearly all."""
    x, variance, parted = drawn(np.random.default_rng(1), 10, 30)
    x_again, single, _ = drawn(np.random.default_rng(1), 10, 1)
    np.testing.assert_array_equal(x, x_again)
    place = int(np.argmax(x.var(axis=0)))
    assert variance[:, place].mean() > 0.7 * x[:, place].var()
    assert single[:, place].mean() < 0.5 * x[:, place].var()
    assert np.mean(parted) > 2


def test_bands_are_twice_as_long_as_the_residuals_are_correlated() -> None:
    """Within limits; every line is in one of them."""
    for n_lines, length in ((60, 1.0), (240, 3.0), (240, 500.0), (3, 1.0)):
        edges = [(band.start, band.stop) for band in bands(n_lines, length)]
        assert edges[0][0] == 0
        assert edges[-1][1] == n_lines
        assert all(one[1] == other[0] for one, other in pairwise(edges))
        assert len(edges) == min(n_lines, int(np.clip(n_lines / (2 * length), MIN_BANDS, MAX_BANDS)))


def test_few_blocks_and_unknown_noise_say_nothing() -> None:
    """One block has no scatter; pulls without a covariance do not disagree."""
    assert not block_variance([Blocks(np.ones((1, 2)), None)], np.eye(2)).any()
    assert np.isnan(disagreement([Blocks(np.ones((5, 2)), None)], np.eye(2)))
