"""The `estimator` section refuses values without a meaning and counts the experiments that a method needs."""

import pytest

from elastid.frf.spec import EstimatorSpec


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"band_hz": (20.0, 10.0)}, r"give \[lowest, highest\]"),
        ({"local_order": 7}, "it must be 1 to 6"),
        ({"transient_periods": -1}, "must not be negative"),
        ({"resolution_hz": 0.0}, "resolution_hz is 0; it must be positive"),
        ({"segment": -1.0}, "segment is -1 s; it must be positive"),
        ({"outlier_sigma": 0.0}, "outlier_sigma is 0; it must be positive"),
    ],
)
def test_values_without_a_meaning_are_refused(changes: dict[str, object], says: str) -> None:
    """With the value and its limits."""
    with pytest.raises(ValueError, match=says):
        EstimatorSpec(**changes)  # type: ignore[arg-type]


def test_the_least_values_with_a_meaning_are_taken() -> None:
    """Of all keys at once."""
    spec = EstimatorSpec(local_order=1, transient_periods=0, resolution_hz=0.1, segment=0.1, outlier_sigma=0.1)
    assert spec.resolution_hz == 0.1


@pytest.mark.parametrize(("method", "count"), [("arithmetic", 6), ("h1", 2), ("local_rational", 1), ("auto", 1)])
def test_experiments_of_each_realisation_that_a_method_needs(method: str, count: int) -> None:
    """Six inputs and four realisations: all inputs for a mean, a share for a pooled method, one for a local one."""
    assert EstimatorSpec(method=method).experiments_needed(6, 4) == count  # type: ignore[arg-type]
