"""The tests of residuals raise as many false alarms on noise as they say."""

import math

import numpy as np
import pytest
from plants.two_mass import circular
from scipy.stats import norm

from elastid.validation.residual_tests import LAGS, NORMALITY_95, autocorrelation, inside_expected, normality


@pytest.mark.parametrize("dof", [1, 5, math.inf])
def test_the_expected_share_inside_two_sigma_is_that_of_a_true_model(dof):
    """1 - (1 + 4/nu)^-nu equals the share in 200 000 draws of noise over its estimated sigma."""
    rng = np.random.default_rng(1)
    variance = np.ones(200_000) if math.isinf(dof) else rng.gamma(dof, 1 / dof, 200_000)
    share = np.mean(np.abs(circular(rng, 200_000)) ** 2 <= 4 * variance)
    assert inside_expected(dof) == pytest.approx(share, abs=0.003)


@pytest.mark.parametrize("scatter", [None, 2])
def test_five_percent_of_the_autocorrelations_of_white_residuals_are_beyond_their_bound(scatter):
    """For known sigma and for sigma of two degrees of freedom: 5 % of 6000 tests, within 4 standard deviations."""
    rng = np.random.default_rng(5)
    e = circular(rng, (150, 2000, 1))
    if scatter is not None:
        e = e / np.sqrt(rng.gamma(scatter, 1 / scatter, e.shape))
    r, bound = autocorrelation(e)
    assert r.shape == bound.shape == (3, 2000, 1)
    assert np.mean(r > bound) == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / 6000))


@pytest.mark.parametrize("lines", [40, 300])
def test_five_percent_of_normal_residuals_are_called_not_normal(lines):
    """Whatever their level: 5 % of 3000 residuals, within 4 standard deviations; so the test can be believed."""
    rng = np.random.default_rng(7)
    statistic = normality(3.7 * circular(rng, (lines, 3000, 1)))
    assert np.mean(statistic > NORMALITY_95) == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / 3000))


def test_a_few_lines_far_off_are_not_normal():
    """Five per cent of the lines ten times as far off as the rest are found in every of 200 residuals."""
    rng = np.random.default_rng(8)
    e = circular(rng, (240, 200, 1))
    e[::20] *= 10
    assert np.all(normality(e) > NORMALITY_95)
    assert np.isnan(normality(e[:7])).all()


def test_autocorrelations_and_their_bounds_are_those_of_the_equations():
    """Sums over lines, written out; a line with e = 0 is not counted."""
    e = circular(np.random.default_rng(1), (12, 1, 1))
    e[4] = 0
    r, bound = autocorrelation(e)
    x, total = e[:, 0, 0], np.sum(np.abs(e) ** 2)
    for i, lag in enumerate(LAGS):
        pairs = [(x[k], x[k + lag]) for k in range(12 - lag)]
        assert r[i, 0, 0] == pytest.approx(abs(sum(np.conj(a) * b for a, b in pairs)) / total)
        variance = sum(abs(a) ** 2 * abs(b) ** 2 for a, b in pairs) / total**2
        assert bound[i, 0, 0] == pytest.approx(math.sqrt(-math.log(0.05) * variance))


def test_the_statistic_of_normality_is_that_of_scipy():
    """With the factor for an estimated mean and variance (Stephens 1974)."""
    e = circular(np.random.default_rng(2), (40, 3, 1))
    for i in range(3):
        x = np.concatenate([e[:, i, 0].real, e[:, i, 0].imag])
        z = np.sort((x - x.mean()) / x.std(ddof=1))
        A2 = sum((2 * k - 1) * (norm.logcdf(z[k - 1]) + norm.logsf(z[80 - k])) for k in range(1, 81)) / -80 - 80
        assert normality(e)[i, 0] == pytest.approx(A2 * (1 + 0.75 / 80 + 2.25 / 80**2))


def test_a_sigma_of_few_degrees_of_freedom_is_allowed_for():
    """Noise over a sigma of five degrees of freedom is rarely called not normal, unless they are taken for infinite."""
    rng = np.random.default_rng(3)
    e = circular(rng, (300, 300, 1)) / np.sqrt(rng.gamma(5, 1 / 5, (300, 300, 1)))
    assert np.mean(normality(e, 5) > NORMALITY_95) < 0.08
    assert np.mean(normality(e) > NORMALITY_95) > 0.5
