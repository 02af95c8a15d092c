"""Optimal design: closed forms, certificates, whole experiments."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.base.arrays import FloatArray
from elastid.design.optimal import (
    DesignCriterion,
    relaxed_design,
    whole_experiments,
)


def random_information(seed: int, S: int = 1, Q: int = 30, d: int = 4, rank: int = 2) -> FloatArray:
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((1, Q, d, rank)) + 0.3 * rng.standard_normal((S, Q, d, rank))
    H: FloatArray = J @ np.swapaxes(J, -1, -2)
    return H


@settings(max_examples=40, deadline=None)
@given(s=st.integers(1, 3), seed=st.integers(0, 1000))
def test_the_criterion_is_that_of_the_covariance_and_has_its_gradient(s: int, seed: int) -> None:
    """ln det of K^T M^-1 K, the mean over guesses; slopes by differences."""
    rng = np.random.default_rng(seed)
    M, K = random_information(seed, S=2, Q=8).sum(axis=1), np.eye(4)[:, :s]
    criterion, C = DesignCriterion(K), K.T @ np.linalg.inv(M) @ K
    phi = -np.linalg.slogdet(C)[1] / s
    slope = criterion.slope(M)
    assert float(criterion.value(M)) == pytest.approx(phi.mean(), rel=1e-9, abs=1e-9)
    assert slope.value == pytest.approx(phi.mean(), rel=1e-9, abs=1e-9)
    step = rng.standard_normal(M.shape)
    step = 1e-6 * (step + np.swapaxes(step, 1, 2))
    change = criterion.slope(M + step).value - criterion.slope(M - step).value
    assert np.sum(slope.gradient * step) == pytest.approx(change / 2, rel=1e-3, abs=1e-9)


@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 10**6),
    guesses=st.integers(1, 3),
    wanted=st.integers(1, 4),
)
def test_no_design_exceeds_the_certified_bound(seed: int, guesses: int, wanted: int) -> None:
    """Random shares, sparse and dense, on any subset and number of guesses."""
    H = random_information(seed, guesses)
    criterion = DesignCriterion(np.eye(4)[:, :wanted])
    found = relaxed_design(H, criterion)
    rng = np.random.default_rng(seed + 1)
    for concentration in (0.03, 0.1, 1.0):
        shares = rng.dirichlet(np.full(H.shape[1], concentration), 20)
        values = [float(criterion.value(np.einsum("q,sqij->sij", one, H) + 1e-12 * np.eye(4))) for one in shares]
        assert max(values) <= found.bound + 1e-6
    assert found.value <= found.bound + 1e-12
    assert found.weights.sum() == pytest.approx(1)
    assert found.gap <= 1e-3


def test_size_of_the_published_study_is_certified_to_a_thousandth_and_rounded_to_97_percent() -> None:
    """7920 candidates, 12 parameters, 15 whole experiments."""
    H = random_information(0, Q=7920, d=12, rank=3)
    criterion = DesignCriterion(np.eye(12))
    found = relaxed_design(H, criterion)
    assert found.excess <= 1e-3
    assert np.count_nonzero(found.weights > 1e-6) <= 12 * 13 / 2 + 1
    numbers = whole_experiments(H, found.weights, 15, criterion)
    assert numbers.sum() == 15
    assert np.exp(criterion.value(np.einsum("q,sqij->sij", numbers, H) / 15) - found.bound) >= 0.97


def test_whole_experiments_come_close_to_the_best_of_all_combinations() -> None:
    """Four of nine candidates, by brute force."""
    criterion = DesignCriterion(np.eye(3))
    for seed in range(4):
        H = random_information(seed, Q=9, d=3)
        numbers = whole_experiments(H, relaxed_design(H, criterion).weights, 4, criterion)
        every = combinations_with_replacement(range(9), 4)
        best = max(float(criterion.value(H[:, list(four)].sum(axis=1))) for four in every)
        assert float(criterion.value(np.einsum("q,sqij->sij", numbers, H))) >= best - 1e-6


def test_what_is_known_already_is_not_measured_again() -> None:
    """Two candidates, one for each parameter: knowledge about the first moves all weight to the second."""
    H = np.array([[[[1.0, 0], [0, 0]], [[0, 0], [0, 1.0]]]])
    criterion = DesignCriterion(np.eye(2))
    np.testing.assert_allclose(relaxed_design(H, criterion).weights, [0.5, 0.5], atol=1e-3)
    known = np.array([[[5.0, 0], [0, 1e-9]]])
    assert whole_experiments(H, relaxed_design(H, criterion, known / 2).weights, 2, criterion, known).tolist() == [0, 2]
