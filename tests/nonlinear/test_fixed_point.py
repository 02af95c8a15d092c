"""Fixed points that repetition reaches slowly or never."""

import numpy as np

from elastid.nonlinear.reconstruct import fixed_point


def test_a_map_that_throws_its_point_back_and_forth_ends_there() -> None:
    """x -> b - A x with eigenvalues of A of 0.1 to 1.2, of which repetition never ends; solved to 1e-6 in ten steps."""
    rng = np.random.default_rng(5)
    V = np.linalg.qr(rng.normal(size=(40, 40)))[0]
    A = V @ np.diag(np.repeat([0.1, 0.4, 0.8, 1.2], 10)) @ V.T
    b = rng.normal(size=40) + 1j * rng.normal(size=40)
    evaluations = []

    def mapped(x: np.ndarray) -> np.ndarray:
        evaluations.append(x)
        return np.asarray(b - A @ x)

    found = fixed_point(mapped, np.zeros(40, complex), 1e-6, 10)
    expected = np.linalg.solve(np.eye(40) + A, b)
    assert len(evaluations) <= 10
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_it_stops_where_it_is_told() -> None:
    """After three evaluations, at x -> 2 x + 1, which leaves nothing to do after two."""
    evaluations = []

    def mapped(x: np.ndarray) -> np.ndarray:
        evaluations.append(x)
        return np.asarray(2 * x + 1)

    np.testing.assert_allclose(fixed_point(mapped, np.zeros(3, complex), 1e-9, 3), -1, atol=1e-9)
    assert len(evaluations) <= 3
