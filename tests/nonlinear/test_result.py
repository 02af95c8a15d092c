"""FrictionTakenOut: the level in sliding of a motor with several shapes, and curves with their standard deviations."""

import numpy as np
import pytest

from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import Shape

FRICTION = FrictionTakenOut(
    places=("motor 1", "motor 2"),
    place_units=("N*m", "N*m"),
    shapes=(Shape("motor 1", "sign"), Shape("motor 1", "stop", 0.1), Shape("motor 1", "stribeck", 0.1)),
    levels=np.array([2.0, 3.0, 7.0]),
    covariance=np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 1.0]]),
    configurations=("a",),
    before=np.ones((1, 2)),
    after=np.ones((1, 2)),
    kept_share=np.ones(2),
    accelerance=np.zeros(2),
    highest_hz=np.array([60.0]),
)


def test_the_level_in_sliding_is_the_sum_of_signs_and_bristles_without_stribeck() -> None:
    """With the correlation of the levels; 0 of a motor that nothing was taken out of."""
    assert FRICTION.sliding_level("motor 1") == pytest.approx((5.0, np.sqrt(0.15)))
    assert FRICTION.sliding_level("motor 2") == (0.0, 0.0)
    assert FRICTION.taken_places() == ("motor 1",)


def test_a_reversal_runs_from_minus_to_plus_the_level_in_sliding() -> None:
    """The bristle bends over twice its threshold."""
    torque, std = FRICTION.reversal("motor 1", np.array([0.0, 0.1, 1.0]))
    np.testing.assert_allclose(torque, [-5.0, 2.0, 5.0])
    np.testing.assert_allclose(std, np.sqrt([0.15, 0.04, 0.15]))
