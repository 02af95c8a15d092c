"""Quantiles and tests as SciPy's distributions and the definitions have them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from elastid.base.statistics import (
    QUANTILE_95,
    chi_square_limit,
    chi_square_tail,
    discoveries,
    f_test,
    small_sample_factor,
)


def test_quantiles_are_those_of_the_distributions() -> None:
    """Normal, Student's t over it, and chi-square, to six digits."""
    assert stats.norm.ppf(0.975) == pytest.approx(QUANTILE_95, abs=1e-6)
    assert small_sample_factor(5) == pytest.approx(stats.t.ppf(0.975, 4) / stats.norm.ppf(0.975))
    assert small_sample_factor(100_000) == pytest.approx(1.0, abs=1e-4)
    assert chi_square_limit(3, 0.01) == pytest.approx(stats.chi2.isf(0.01, 3))
    assert chi_square_tail(chi_square_limit(7, 0.2), 7) == pytest.approx(0.2)


def test_the_f_test_rejects_a_column_without_effect_as_often_as_it_says() -> None:
    """Of 4000 regressions on noise 5 % have a p-value below 0.05."""
    rng = np.random.default_rng(0)
    J, y = rng.standard_normal((30, 3)), rng.standard_normal((30, 4000))
    left = [np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2, axis=0) for A in (J[:, :2], J)]
    p = np.array([f_test(before - after, 1, after, 27) for before, after in zip(*left, strict=True)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.012)


def test_false_discoveries_stay_below_their_rate() -> None:
    """Twenty effects among 200 tests, 300 times: 5 % of the discoveries are false at most, and most effects found."""
    rng = np.random.default_rng(2)
    shares, powers = [], []
    for _ in range(300):
        z = rng.standard_normal(200)
        z[:20] += 4.0
        named = discoveries(2 * stats.norm.sf(np.abs(z)), 0.05)
        shares.append(named[20:].sum() / max(named.sum(), 1))
        powers.append(named[:20].mean())
    assert np.mean(shares) < 0.055
    assert np.mean(powers) > 0.8
