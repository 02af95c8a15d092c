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
