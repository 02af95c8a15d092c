"""The tests of residuals raise as many false alarms on noise as they say."""

import math

import numpy as np
import pytest
from plants.two_mass import circular
from scipy.stats import norm

from elastid.fit.problem.smoothed_noise import smooth_noise
from elastid.frf.covariance import kronecker
from elastid.record import Configuration
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import (
    FALSE_ALARM,
    LAGS,
    NORMALITY_95,
    autocorrelation,
    exceeds_by_chance,
    falls_short_by_chance,
    inside_expected,
    normality,
    power_over_noise,
    together,
    white_by_chance,
    whitening,
    without_shifts,
)


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


@pytest.mark.parametrize("scatter", [0.0, 0.7])
def test_white_residuals_are_called_coloured_as_often_as_the_test_says(scatter):
    """100 draws, of a level that is known or scatters from line to line: 5 % below 0.05, 1 % below 0.01."""
    rng = np.random.default_rng(0)
    p = np.array(
        [white_by_chance(np.exp(scatter * rng.standard_normal((60, 1))) * circular(rng, (60, 4))) for _ in range(100)]
    )
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.05)
    assert np.mean(p < FALSE_ALARM) < 0.04
    assert np.mean([together(some) < 0.05 for some in p.reshape(20, 5)]) < 0.21


def test_the_tail_is_that_of_random_phases():
    """Seven elements of one error beside five of their own, 60 lines: of 10000 draws 5 and 1 % have such p or less."""
    rng, p = np.random.default_rng(4), []
    for _ in range(4):
        z = np.concatenate([np.repeat(circular(rng, (60, 1)), 7, axis=1), circular(rng, (60, 5))], axis=1)
        turns = np.exp(2j * np.pi * rng.random((10000, 60, 1)))
        T = np.zeros(10000)
        for lag in (1, 2, 3):
            product = z[:-lag].conj() * z[lag:]
            turned = (turns[:, :-lag, 0].conj() * turns[:, lag:, 0]) @ product
            T += np.sum(np.abs(turned) ** 2 / np.sum(np.abs(product) ** 2, axis=0), axis=1)
        p.append([white_by_chance(turns[i] * z) for i in np.argsort(T)[[-500, -100]]])
    assert np.mean(p, axis=0) == pytest.approx([0.05, 0.01], rel=0.2)


def test_power_is_beyond_chance_as_often_as_the_test_says():
    """400 ratios of powers with 300 and 600 degrees of freedom: 5 % on either side."""
    rng = np.random.default_rng(2)
    ratio = rng.chisquare(300, 400) / 300 / (rng.chisquare(600, 400) / 600)
    dof = 2 / (2 / 300 + 2 / 600)
    for test in (exceeds_by_chance, falls_short_by_chance):
        assert np.mean([test(one, dof) < 0.05 for one in ratio]) == pytest.approx(0.05, abs=0.03)
    assert math.isnan(exceeds_by_chance(2.0, 0.0))


def test_errors_of_parameters_within_their_uncertainty_are_no_residual():
    """z = B c + noise with c as uncertain as stated: the distance is that of noise, in 200 draws 100 +- 1 complex."""
    rng = np.random.default_rng(3)
    shifts = 3 * circular(rng, (3, 50, 2))
    found = []
    for _ in range(200):
        z = np.tensordot(rng.standard_normal(3), shifts, axes=1) + circular(rng, (50, 2))
        left, beside = without_shifts(z, shifts)
        found.append(np.sum(np.abs(left) ** 2) + beside)
        B = np.concatenate([shifts.real, shifts.imag], axis=1).reshape(3, -1)
        y = np.concatenate([z.real, z.imag]).ravel()
        exact = y @ np.linalg.solve(np.eye(200) / 2 + B.T @ B, y) / 2
        assert found[-1] == pytest.approx(exact)
    assert np.mean(found) == pytest.approx(100, abs=2.5)


def test_nothing_is_tested_where_nothing_is_known():
    """Too few lines, and no p at all."""
    assert math.isnan(white_by_chance(np.zeros((3, 2), complex)))
    assert math.isnan(together([math.nan]))


@pytest.mark.parametrize(("n_y", "n_u", "dof"), [(2, 2, 1), (3, 2, 2), (3, 2, 4), (6, 6, 3)])
def test_power_over_a_covariance_of_few_degrees_of_freedom_is_beyond_chance_as_often_as_the_test_says(n_y, n_u, dof):
    """200 draws of errors and their scatter, of noise on each output that grows with the fourth power of frequency."""
    rng, freq_hz = np.random.default_rng(0), np.linspace(1.0, 40.0, 40)
    std = (freq_hz / 40)[:, None, None] ** 2
    mixed = np.eye(n_y) + 0.5 * rng.standard_normal((n_y, n_y))
    names = tuple(f"motor {i + 1}" for i in range(n_y))
    p, ratios = [], []
    for _ in range(200):
        E, D = (std * (mixed @ circular(rng, (40, n_y, n))) for n in (n_u, dof))
        total = kronecker(np.eye(n_u) * np.ones((40, 1, 1)) + 0j, D @ D.conj().swapaxes(1, 2) / dof, dof)
        where = Configuration("c", np.zeros(n_u))
        noise = smooth_noise(FrequencyResponse(freq_hz, 9 + E, names[:n_u], names, "acceleration", where, total=total))
        whiten = whitening(noise)
        z = (whiten @ E.swapaxes(1, 2).reshape(40, -1, 1))[:, :, 0]
        ratios.append(power_over_noise(z, whiten, noise))
        p.append(exceeds_by_chance(*ratios[-1]))
    assert np.mean(ratios, axis=0)[0] == pytest.approx(1, abs=0.05)
    assert np.mean(np.array(p) < 0.05) < 0.1
