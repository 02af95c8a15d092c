"""Responses: the covariance in its forms, lines and quantities, and shapes that disagree."""

import numpy as np
import pytest

from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse, in_quantity

HOME = Configuration("home", np.zeros(1))


def test_the_kronecker_covariance_is_that_of_the_column_stacked_response() -> None:
    """full() of left (x) right equals the sample covariance of vec(R A L^T), column-major."""
    rng = np.random.default_rng(1)
    left_root = rng.normal(size=(2, 2)) + 1j * rng.normal(size=(2, 2))
    right_root = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    left, right = left_root @ left_root.conj().T, right_root @ right_root.conj().T
    white = (rng.normal(size=(200000, 3, 2)) + 1j * rng.normal(size=(200000, 3, 2))) / np.sqrt(2)
    samples = (right_root @ white @ left_root.T).transpose(0, 2, 1).reshape(-1, 6)
    sampled = samples.T @ samples.conj() / len(samples)
    variance = np.einsum("bb,aa->ab", left, right).real
    covariance = Covariance(variance[None], 10.0, left[None], right[None])
    np.testing.assert_allclose(covariance.full()[0], sampled, atol=0.03 * np.abs(sampled).max())
    np.testing.assert_allclose(np.diag(covariance.full()[0]).real, variance.T.ravel())


@pytest.mark.parametrize(
    ("freq_hz", "G", "says"),
    [
        (np.array([1.0, 1.0]), np.ones((2, 1, 1)), "do not increase"),
        (np.array([1.0, 2.0]), np.array([[[1.0]], [[np.nan]]]), "not finite at 1 lines, first 2 Hz"),
        (np.array([1.0, 2.0]), np.ones((2, 2, 1)), r"expected \(F, n_y, n_u\)"),
    ],
)
def test_a_response_refuses_what_is_not_one(freq_hz: np.ndarray, G: np.ndarray, says: str) -> None:
    """Frequencies that do not increase, NaN, a wrong shape."""
    with pytest.raises(ValueError, match=says):
        FrequencyResponse(freq_hz, G, ("motor 1",), ("motor 1",), "acceleration", HOME)


def test_lines_cuts_the_covariance_with_the_response() -> None:
    """Cutting a response cuts its covariances with it."""
    G = np.arange(3).reshape(3, 1, 1) + 1.0
    response = FrequencyResponse(
        np.array([1.0, 2.0, 3.0]), G, ("motor 1",), ("motor 1",), "acceleration", HOME, Covariance(G.real, 4.0)
    )
    cut = response.lines(np.array([True, False, True]))
    assert cut.freq_hz.tolist() == [1.0, 3.0]
    assert cut.noise is not None
    assert cut.noise.variance.ravel().tolist() == [1.0, 3.0]
    assert cut.uncertainty is cut.noise


def test_another_quantity_scales_the_response_and_its_variance() -> None:
    """By (j omega)^k and omega^2k; there and back is the response itself."""
    G, places = np.array([[[2.0 + 1j]]]), ("motor 1",)
    response = FrequencyResponse(
        np.array([3.0]), G, places, places, "position", HOME, Covariance(np.ones((1, 1, 1)), 4.0)
    )
    omega = 6 * np.pi
    acceleration = in_quantity(response, "acceleration")
    np.testing.assert_allclose(acceleration.G, -(omega**2) * G)
    assert acceleration.noise is not None
    np.testing.assert_allclose(acceleration.noise.variance, omega**4)
    np.testing.assert_allclose(in_quantity(acceleration, "position").G, G)
