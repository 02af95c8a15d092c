"""The levels of shapes that fit alike are uncertain by the choice between them."""

import numpy as np

from elastid.nonlinear.choice import neighbours_of
from elastid.nonlinear.levels import NormalEquations

CHOSEN, EVERY = np.array([0]), np.arange(3)
F_C = 9.0


def sums(X: np.ndarray, e: np.ndarray) -> NormalEquations:
    """The sums of a regression of e (n,) on shapes X (3, n), complex, of variance 1, as one fold."""
    A, b = (X.conj() @ X.T).real, (X.conj() @ e).real
    return NormalEquations(A[None], b[None], np.array([[np.sum(np.abs(e) ** 2)]]), np.zeros((1, 1)), 1.0)


def shapes(alike: float, rng: np.random.Generator) -> np.ndarray:
    """Three shapes (3, 400): the second as the first but for a part, the third like neither."""
    X = (rng.standard_normal((3, 400)) + 1j * rng.standard_normal((3, 400))) / 10
    X[1] = X[0] + alike * X[1]
    return X


def regression(alike: float, seed: int, truth: tuple[float, float, float] = (F_C, 0.0, 0.0)) -> NormalEquations:
    rng = np.random.default_rng(seed)
    X = shapes(alike, rng)
    noise = (rng.standard_normal(400) + 1j * rng.standard_normal(400)) / np.sqrt(2)
    return sums(X, np.array(truth) @ X + noise)


def test_the_level_may_be_that_of_a_shape_that_fits_as_well() -> None:
    """Of two shapes that differ by a part of 0.001 one or the other has it all; the third has none of it."""
    found = neighbours_of(regression(1e-3, 0), CHOSEN, EVERY)
    np.testing.assert_array_equal(found.shapes, [0, 1])
    std = np.sqrt(np.diag(found.covariance))
    assert np.all(std > 0.5 * F_C)
    ones = np.ones(2)
    assert ones @ found.covariance @ ones < 0.01 * F_C**2


def test_a_choice_without_alternatives_adds_nothing() -> None:
    """Shapes that differ are distinguished."""
    found = neighbours_of(regression(1.0, 0), CHOSEN, EVERY)
    np.testing.assert_array_equal(found.shapes, CHOSEN)
    assert found.covariance[0, 0] == 0


def test_the_covariance_covers_what_other_data_would_choose() -> None:
    """Where two shapes share the friction and one is chosen, the sum is within its deviation in most data."""
    truth = (0.5 * F_C, 0.5 * F_C, 0.0)
    ratios = []
    for seed in range(40):
        equations = regression(0.25, seed, truth)
        found = neighbours_of(equations, CHOSEN, EVERY)
        alone = equations.b[0, 0] / equations.A[0, 0, 0]
        variance = found.covariance.sum() + 0.5 / equations.A[0, 0, 0]
        ratios.append((alone - F_C) / np.sqrt(variance))
    assert np.mean(np.abs(ratios) < 1.96) > 0.85
    assert np.std(ratios) > 0.4


def test_nothing_chosen_has_no_alternatives() -> None:
    """Of a motor that keeps its friction."""
    assert len(neighbours_of(regression(1e-3, 0), CHOSEN[:0], EVERY).shapes) == 0
