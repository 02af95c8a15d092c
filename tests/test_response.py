"""Responses: the covariance in its forms, lines and quantities, and shapes that disagree."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.base.errors import UnknownNameError
from elastid.record import Configuration
from elastid.response import Covariance, Response, in_quantity

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
        Response(freq_hz, G, ("motor 1",), ("motor 1",), "acceleration", HOME)


def test_another_quantity_scales_the_response_and_its_variance() -> None:
    """By (j omega)^k and omega^2k; there and back is the response itself."""
    G, places = np.array([[[2.0 + 1j]]]), ("motor 1",)
    response = Response(np.array([3.0]), G, places, places, "position", HOME, Covariance(np.ones((1, 1, 1)), 4.0))
    response = replace(
        response, total=Covariance(np.ones((1, 1, 1)), 4.0, np.full((1, 1, 1), 2.0), np.full((1, 1, 1), 0.5))
    )
    omega = 6 * np.pi
    acceleration = in_quantity(response, "acceleration")
    np.testing.assert_allclose(acceleration.G, -(omega**2) * G)
    np.testing.assert_allclose(acceleration.noise.variance, omega**4)
    np.testing.assert_allclose(acceleration.total.full(), omega**4)
    np.testing.assert_allclose(in_quantity(acceleration, "position").G, G)


def test_places_choose_elements_and_their_covariance() -> None:
    """Outputs first, as python-control indexes; every form of the covariance is cut as its full matrix is."""
    rng = np.random.default_rng(3)
    F, n_y, n_u = 4, 3, 2

    def positive(n: int) -> np.ndarray:
        root = rng.normal(size=(F, n, n)) + 1j * rng.normal(size=(F, n, n))
        return root @ root.conj().transpose(0, 2, 1)

    left, right = positive(n_u), positive(n_y)
    variance = np.einsum("fbb,faa->fab", left, right).real
    kronecker = Covariance(variance, 10.0, left, right)
    full = Covariance(variance, 10.0, matrix=kronecker.full())
    G = rng.normal(size=(F, n_y, n_u)) + 0j
    outputs, inputs = ("motor 1", "motor 2", "joint 1"), ("motor 1", "motor 2")
    response = Response(np.arange(1.0, 5.0), G, inputs, outputs, "acceleration", HOME, noise=kronecker, total=full)
    part = response[("joint 1", "motor 1"), "motor 2"]
    assert (part.outputs, part.inputs) == (("joint 1", "motor 1"), ("motor 2",))
    np.testing.assert_array_equal(part.G, G[:, [2, 0]][:, :, [1]])
    kept = [2 + 3, 0 + 3]  # of the column-stacked response
    expected = kronecker.full()[:, kept][:, :, kept]
    for covariance in (part.noise, part.total):
        np.testing.assert_allclose(covariance.full(), expected)
    np.testing.assert_allclose(part.std[:, :, 0] ** 2, np.einsum("faa->fa", expected).real)
    with pytest.raises(UnknownNameError, match="no output motor 9; there are motor 1, motor 2, joint 1"):
        response["motor 9", "motor 1"]
    with pytest.raises(TypeError, match='response\\["joint 1", "motor 1"\\]'):
        response["motor 1"]
    with pytest.raises(ValueError, match="home: it has no coherence"):
        _ = response.coherence
