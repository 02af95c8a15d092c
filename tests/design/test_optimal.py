"""Optimal design: closed forms, certificates, whole experiments."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, minimize

from elastid.base.arrays import FloatArray
from elastid.design.optimal import (
    DesignCriterion,
    PowerSource,
    best_experiments,
    best_powers,
    even_powers,
    optimal_weights,
)


def random_information(seed: int, S: int = 1, Q: int = 30, d: int = 4, rank: int = 2) -> FloatArray:
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((1, Q, d, rank)) + 0.3 * rng.standard_normal((S, Q, d, rank))
    return J @ np.swapaxes(J, -1, -2)


@settings(max_examples=40, deadline=None)
@given(s=st.integers(1, 3), seed=st.integers(0, 1000))
def test_criterion_equals_covariance_form_and_its_gradient(s: int, seed: int) -> None:
    """ln det of K^T M^-1 K, the mean over guesses; slopes by differences."""
    rng = np.random.default_rng(seed)
    M, K = random_information(seed, S=2, Q=8).sum(axis=1), np.eye(4)[:, :s]
    criterion, C = DesignCriterion(K), K.T @ np.linalg.inv(M) @ K
    phi = -np.linalg.slogdet(C)[1] / s
    value, gradient = criterion.slope(M)
    assert float(criterion.value(M)) == pytest.approx(phi.mean(), rel=1e-9, abs=1e-9)
    assert value == pytest.approx(phi.mean(), rel=1e-9, abs=1e-9)
    step = rng.standard_normal(M.shape)
    step = 1e-6 * (step + np.swapaxes(step, 1, 2))
    change = float(criterion.value(M + step) - criterion.value(M - step))
    assert np.sum(gradient * step) == pytest.approx(change / 2, rel=1e-3, abs=1e-9)


def test_whole_experiments_come_close_to_the_best_of_all_combinations() -> None:
    """Four of nine candidates, by brute force."""
    criterion = DesignCriterion(np.eye(3))
    for seed in range(4):
        H = random_information(seed, Q=9, d=3)
        numbers, _ = best_experiments(H, 4, criterion, np.zeros((1, 3, 3)))
        every = combinations_with_replacement(range(9), 4)
        best = max(float(criterion.value(H[:, list(four)].sum(axis=1))) for four in every)
        assert float(criterion.value(np.einsum("q,sqij->sij", numbers, H))) >= best - 1e-6


def test_what_is_known_already_is_not_measured_again() -> None:
    """Two candidates, one for each parameter: knowledge about the first moves all weight to the second."""
    H = np.array([[[[1.0, 0], [0, 0]], [[0, 0], [0, 1.0]]]])
    criterion, nothing = DesignCriterion(np.eye(2)), np.zeros((1, 2, 2))
    np.testing.assert_allclose(optimal_weights(H, criterion, nothing).P.ravel(), [0.5, 0.5], atol=1e-3)
    assert best_experiments(H, 2, criterion, np.array([[[5.0, 0], [0, 1e-9]]]))[0].tolist() == [0, 2]


Groups = list[list[list[PowerSource]]]


def drawn(seed: int, groups: int, guesses: int = 1, lines: int = 12, n_u: int = 2) -> Groups:
    """Random sources with coupled inputs, outputs of unlike noise, and a floor that power does not lower."""
    rng = np.random.default_rng(seed)

    def source() -> PowerSource:
        J = rng.standard_normal((2, 4, lines, n_u, n_u)) * np.exp(rng.standard_normal((lines, 1, 1)))
        T = np.eye(n_u) + 0.4 * rng.random((lines, n_u, n_u))
        return PowerSource(
            J[0] + 1j * J[1],
            np.exp(rng.standard_normal((lines, n_u))),
            T**2,
            0.05 * rng.random((lines, n_u, n_u)),
            rng.random((lines, n_u, n_u)) > 0.1,
        )

    return [[[source() for _ in range(guesses)]] for _ in range(groups)]


def priced(seed: int, groups: int, lines: int = 12, n_u: int = 2) -> FloatArray:
    """A limit of each input's own power, and two in which both count, dearer towards one end of the band."""
    rng = np.random.default_rng([seed, 1])
    own = np.repeat(np.eye(n_u)[:, None, :], lines, axis=1)
    shared = np.exp(rng.standard_normal((2, 1, n_u))) * np.linspace(0.1, 3, lines)[:, None]
    return np.repeat(np.concatenate([own, shared])[None], groups, axis=0)


def information(groups: Groups, P: FloatArray, known: FloatArray) -> FloatArray:
    each = zip(groups, P, strict=True)
    return known + sum(np.stack([one.information(p) for one in group[0]]) for group, p in each)


def test_quadratic_regression_has_power_at_ends_and_middle() -> None:
    """One input, noise alone: lines are candidates, and a third of the power goes to -1, 0 and 1 each."""
    x = np.linspace(-1, 1, 201)
    one, J = np.ones((201, 1, 1)), np.vander(x, 3)
    source = PowerSource(J.T.reshape(3, 201, 1, 1).astype(complex), one[:, :, 0], one, 0 * one, one > 0)
    criterion, known = DesignCriterion(np.eye(3)), np.zeros((1, 3, 3))
    best = best_powers([[[source]]], one[None, None, :, :, 0], criterion, known, 0.01)
    shares = optimal_weights(J[None, :, :, None] * J[None, :, None], criterion, known)
    for found in (best, shares):
        assert found.gap < 0.01
        thirds = [found.P[0, where, 0].sum() for where in (x < -0.7, abs(x) < 0.3, x > 0.7)]
        assert thirds == pytest.approx([1 / 3] * 3, abs=0.02)
    assert best.P.min() == pytest.approx(0.01 / 201, rel=0.1)


@pytest.mark.parametrize("seed", range(2))
def test_an_independent_solver_finds_the_same(seed: int) -> None:
    """Two configurations, overlapping limits, a floor: within the certified gap of SciPy's trust-region optimum."""
    groups, cost = drawn(seed, 2), priced(seed, 2)
    criterion, known = DesignCriterion(np.eye(4)), np.zeros((1, 4, 4))
    best = best_powers(groups, cost, criterion, known, 0.1, 1e-3)
    even = even_powers(cost)

    def value(P: FloatArray) -> float:
        return -float(criterion.value(information(groups, P.reshape(even.shape), known)))

    rows = np.zeros((8, even.size))
    for k in range(2):
        rows[4 * k : 4 * k + 4, 24 * k : 24 * k + 24] = cost[k].reshape(4, -1)
    found = minimize(
        value,
        even.ravel(),
        method="SLSQP",
        bounds=[(0.1 * p, None) for p in even.ravel()],
        constraints=LinearConstraint(rows, -np.inf, 1.0),
        options={"maxiter": 500, "ftol": 1e-9},
    )
    assert best.gap < 2e-3
    assert best.value == pytest.approx(-found.fun, abs=3e-3)


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_nothing_within_the_limits_exceeds_the_certified_bound(seed: int) -> None:
    """Limits are kept, and every line keeps its least power."""
    groups, cost = drawn(seed, 2, guesses=3), priced(seed, 2)
    criterion, known = DesignCriterion(np.eye(4)[:, :3]), np.zeros((3, 4, 4))
    best = best_powers(groups, cost, criterion, known, 0.2)
    assert np.einsum("kofl,kfl->ko", cost, best.P).max() <= 1 + 1e-9
    assert np.min(best.P / (0.2 * even_powers(cost))) > 1 - 1e-9
    assert best.value >= criterion.value(information(groups, even_powers(cost), known))
    assert best.gap < 0.06
    rng = np.random.default_rng(seed)
    for spread in (0.1, 1.0, 3.0):
        free = best.P * np.exp(spread * rng.standard_normal(best.P.shape))
        least = 0.2 * even_powers(cost)
        room = 1 - np.einsum("kofl,kfl->ko", cost, least)
        P = least + free / (np.einsum("kofl,kfl->ko", cost, free) / room).max(axis=1)[:, None, None]
        assert criterion.value(information(groups, P, known)) <= best.value + best.gap + 1e-9


def test_even_powers_take_every_input_to_a_limit() -> None:
    """Of its own, or of a shared one that binds first."""
    cost = priced(7, 3)
    even = even_powers(cost)
    assert np.ptp(even, axis=1).max() == 0
    assert np.einsum("kofl,kfl->ko", cost, even).max(axis=1) == pytest.approx([1.0] * 3)
