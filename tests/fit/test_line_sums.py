"""Blocks of a configuration and a band: their scatter states the variance, their disagreement an error of the model."""

import numpy as np
import pytest
from scipy.stats import t as student

from elastid.fit.line_sums import (
    LineSums,
    autocovariance,
    block_variance,
    disagreement,
    jackknife_variance,
    sum_blocks,
)
from elastid.fit.result import is_in_error, largest_by_chance

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
        pull = (J * (r - J @ x)[:, None]).T
        blocks, _, parts = sum_blocks(pull, J[:, None] + 0j, 2 * np.ones((F, 1, 1), complex), band / 2)
        found.append(x)
        stated.append(block_variance([pull.T if band == 1 else blocks], A_inverse))
        parted.append(disagreement([parts], N_X))
    return np.array(found), np.array(stated), parted


def test_of_white_residuals_blocks_state_the_scatter_and_agree() -> None:
    """Variances to 15 %, T = 1.00 to 2 %, whatever the blocks."""
    x, variance, parted = drawn(np.random.default_rng(0), 1, 12)
    np.testing.assert_allclose(variance.mean(axis=0), x.var(axis=0), rtol=0.2)
    assert np.mean(parted) == pytest.approx(1.0, abs=0.02)
    assert max(parted) < 1.8


@pytest.mark.slow
def test_of_correlated_residuals_long_blocks_state_the_scatter_and_single_lines_do_not() -> None:
    """Noise averaged over ten lines: single lines state a fraction of the variance, blocks of thirty nearly all."""
    x, variance, parted = drawn(np.random.default_rng(1), 10, 30)
    x_again, single, _ = drawn(np.random.default_rng(1), 10, 1)
    np.testing.assert_array_equal(x, x_again)
    place = int(np.argmax(x.var(axis=0)))
    assert variance[:, place].mean() > 0.7 * x[:, place].var()
    assert single[:, place].mean() < 0.5 * x[:, place].var()
    assert np.mean(parted) > 2


def test_few_blocks_and_unknown_noise_say_nothing() -> None:
    """One block has no scatter; pulls without a covariance do not disagree."""
    assert not block_variance([np.ones((1, 2))], np.eye(2)).any()
    assert np.isnan(disagreement([sum_blocks(np.ones((2, 20)), np.ones((20, 1, 2)) + 0j, None, 2.0)[2]], 2))


def evidence_of(J, r) -> LineSums:
    """A configuration of real residuals r (N,) with slopes J (N, n_x)."""
    pull = (J * r[:, None]).T
    lags, unknown = autocovariance(r[:, None] + 0j), (np.nan, np.nan, np.inf, 0.0, {}, {})
    return LineSums(np.ones(len(r)), J, J**2, lags, len(r), pull, pull.T, None, (0.0, 0), *unknown)


def left_out(blocks, y):
    """Least-squares estimates without each block in turn."""
    found = []
    for i in range(len(blocks)):
        rest = [j for j in range(len(blocks)) if j != i]
        found.append(np.linalg.lstsq(np.vstack([blocks[j] for j in rest]), np.concatenate([y[j] for j in rest]))[0])
    return np.array(found)


@pytest.mark.parametrize("Q", [3, 5, 40])
def test_of_a_linear_model_it_is_that_of_fits_without_each(Q):
    rng = np.random.default_rng(Q)
    blocks, y = [rng.standard_normal((6, 3)) * (1, 1e4, 1e-5) for _ in range(Q)], rng.standard_normal((Q, 6))
    x = np.linalg.lstsq(np.vstack(blocks), np.concatenate(y))[0]
    parts = [evidence_of(J, J @ x - one) for J, one in zip(blocks, y, strict=True)]
    found = jackknife_variance(parts, sum(J.T @ J for J in blocks), np.eye(3))
    scatter = left_out(blocks, y)
    expected = (Q - 1) / Q * np.sum((scatter - scatter.mean(axis=0)) ** 2, axis=0)
    t = student.ppf(0.975, Q - 1) / student.ppf(0.975, np.inf)
    np.testing.assert_allclose(found, t**2 * expected, rtol=1e-8)


def test_what_only_one_configuration_informs_has_no_scatter():
    """Two configurations more know nothing of the second parameter."""
    one, other = np.array([[1.0, 0.5], [0.0, 1.0]]), np.array([[1.0, 0.0], [2.0, 0.0]])
    r = np.array([0.3, -0.1])
    found = jackknife_variance(
        [evidence_of(J, r) for J in (one, other, other)], one.T @ one + 2 * other.T @ other, np.eye(one.shape[1])
    )
    assert np.all(np.isfinite(found))
    assert np.all(jackknife_variance([evidence_of(one, r)] * 2, 2 * one.T @ one, np.eye(one.shape[1])) == 0)


@pytest.mark.parametrize("dof", [8, 500])
def test_a_model_is_in_error_where_noise_does_not_explain_the_cost(dof: int):
    """Once in 700 draws of V, of few degrees of freedom, whose distribution is skew, as of many."""
    draws = np.random.default_rng(0).chisquare(dof, 700_000)
    assert np.mean(draws > dof * largest_by_chance(dof)) == pytest.approx(1 / 700, rel=0.1)
    assert is_in_error(1.4 * 500.0, 500.0, 500)
