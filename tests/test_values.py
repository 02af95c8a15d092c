"""Records and responses cannot be edited and refuse shapes that disagree."""

import numpy as np
import pytest

from elastid.record import Configuration, Record
from elastid.response import Covariance, FrequencyResponse

HOME = Configuration("home", np.zeros(1))


def record(n: int = 100, period: int = 50, **changes: object) -> Record:
    """A record of one input and one output."""
    values: dict[str, object] = {
        "u": np.ones((n, 1)),
        "y": np.ones((n, 1)),
        "inputs": ("motor 1",),
        "outputs": ("motor 1",),
        "quantities": ("position",),
    }
    return Record("test", HOME, 0, 0, 1000.0, period, **(values | changes))  # type: ignore[arg-type]


def test_a_record_counts_its_whole_periods() -> None:
    """A trailing part of a period does not count."""
    assert record(n=149).n_periods == 2
    assert record(period=100, is_periodic=False).n_periods == 1


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"n": 49}, "0.98 periods of 50"),
        ({"y": np.ones((100, 2))}, "y has shape"),
        ({"quantities": ()}, "1 outputs but 0 quantities"),
        ({"r": np.ones((3, 1))}, "r has shape"),
        ({"is_periodic": False}, "must be its length, 100 samples"),
    ],
)
def test_a_record_refuses_what_disagrees(changes: dict[str, object], says: str) -> None:
    """Too short, or shapes that do not fit the names."""
    with pytest.raises(ValueError, match=says):
        record(**changes)  # type: ignore[arg-type]


def test_a_held_torque_acts_half_a_sample_late_and_weaker_by_a_sinc() -> None:
    """At a tenth of the rate: 18 degrees late, 1.6 % weaker; the DFT of a held cosine over many samples agrees."""
    H = record(hold="zero-order").hold_response(np.array([100.0]))[0, 0]
    assert np.degrees(np.angle(H)) == pytest.approx(-18)
    held = np.repeat(np.cos(2 * np.pi * 0.1 * np.arange(50)), 1000)
    by_dft = np.mean(2 * held * np.exp(-2j * np.pi * 0.1e-3 * (np.arange(50000) + 0.5)))
    np.testing.assert_allclose(H, by_dft, atol=1e-6)


def test_values_cannot_be_edited_on_their_way() -> None:
    """Neither a field nor an array in it."""
    value = record()
    with pytest.raises(AttributeError):
        value.rate_hz = 1.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        value.u[0, 0] = 5.0


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


def test_lines_keeps_the_covariance_beside_its_lines() -> None:
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
