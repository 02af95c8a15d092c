"""Records cannot be edited, refuse shapes that disagree, and count their periods."""

import numpy as np
import pytest

from elastid.record import Configuration, Record

HOME = Configuration("home", np.zeros(1))


def record(n: int = 100, period: int = 50, **changes: object) -> Record:
    """A record of one input and one output."""
    values = {
        "u": np.ones((n, 1)),
        "y": np.ones((n, 1)),
        "inputs": ("motor 1",),
        "outputs": ("motor 1",),
        "quantities": ("position",),
    }
    return Record("test", HOME, 0, 0, 1000.0, period, **(values | changes))


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
        record(**changes)


def test_zero_order_hold_is_half_sample_and_sinc() -> None:
    """At a tenth of the rate: 18 degrees late, 1.6 % weaker; the DFT of a held cosine over many samples agrees."""
    H = record(hold="zero-order").hold_response(np.array([100.0]))[0, 0]
    assert np.degrees(np.angle(H)) == pytest.approx(-18)
    held = np.repeat(np.cos(2 * np.pi * 0.1 * np.arange(50)), 1000)
    by_dft = np.mean(2 * held * np.exp(-2j * np.pi * 0.1e-3 * (np.arange(50000) + 0.5)))
    np.testing.assert_allclose(H, by_dft, atol=1e-6)
