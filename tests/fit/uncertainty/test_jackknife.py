"""The find_two_groups of configurations: the jackknife over them."""

import numpy as np
import pytest
from scipy.stats import t as student

from elastid.fit.result import is_in_error
from elastid.fit.uncertainty.jackknife import jackknife_variance
from elastid.fit.uncertainty.line_sums import Blocks, LineSums


def evidence_of(J, r) -> LineSums:
    """A configuration of real residuals r (N,) with slopes J (N, n_x)."""
    pull = (J * r[:, None]).T
    return LineSums(np.ones(len(r)), J, r[:, None] + 0j, pull, Blocks(pull.T, None), None, None, 0.0, {})


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
    found = jackknife_variance(parts, sum(J.T @ J for J in blocks))
    scatter = left_out(blocks, y)
    expected = (Q - 1) / Q * np.sum((scatter - scatter.mean(axis=0)) ** 2, axis=0)
    t = student.ppf(0.975, Q - 1) / student.ppf(0.975, np.inf)
    np.testing.assert_allclose(found, t**2 * expected, rtol=1e-8)


@pytest.mark.parametrize("Q", [3, 5, 10])
def test_where_each_configuration_errs_by_itself_95_percent_hold_the_truth(Q):
    """Balanced configurations, each with a number of its own: Student's interval is exact; 4000 draws."""
    rng = np.random.default_rng(Q)
    J = np.array([[1.0, 0.3], [1.0, -0.5], [0.2, 1.0], [0.4, -0.8]])
    held = []
    for _ in range(4000):
        own = rng.standard_normal((Q, 2))
        x = own.mean(axis=0)
        parts = [evidence_of(J, J @ (x - one)) for one in own]
        held.append(np.abs(x) < 1.959964 * np.sqrt(jackknife_variance(parts, Q * J.T @ J)))
    assert np.mean(held) == pytest.approx(0.95, abs=0.01)


def test_what_only_one_configuration_informs_has_no_scatter():
    """Two configurations more know nothing of the second parameter."""
    one, other = np.array([[1.0, 0.5], [0.0, 1.0]]), np.array([[1.0, 0.0], [2.0, 0.0]])
    r = np.array([0.3, -0.1])
    found = jackknife_variance([evidence_of(J, r) for J in (one, other, other)], one.T @ one + 2 * other.T @ other)
    assert np.all(np.isfinite(found))
    assert np.all(jackknife_variance([evidence_of(one, r)] * 2, 2 * one.T @ one) == 0)


def test_a_model_is_in_error_where_noise_does_not_explain_the_cost():
    """Of 3000 draws of V with 500 degrees of freedom, about 5 in 1000 lie above three standard deviations."""
    draws = np.random.default_rng(0).chisquare(500, 3000)
    assert np.mean([is_in_error(V, 500.0, 500) for V in draws]) < 0.008
    assert is_in_error(700.0, 500.0, 500)
