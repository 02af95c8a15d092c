"""A sign that turns along a velocity, against the law on many points."""

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.nonlinear.gear.effects import turning

PHASE = 2 * np.pi * np.arange(800) / 800


@pytest.mark.parametrize("scale", [0.0, 1e-3])
def test_reversals_between_points_turn_where_the_motion_is_bent(scale: float) -> None:
    """A velocity of 0.4 of its slope on one side of 0, against the law on 200 times as many points."""

    def bent(phase: FloatArray) -> FloatArray:
        return 0.1 * np.where(np.sin(phase) > 0, 1.0, 0.4) * np.sin(phase)

    dense = (np.arange(160_000) + 0.5) * np.pi / 80_000
    exact = np.mean((np.tanh(bent(dense) / scale) if scale else np.sign(bent(dense))) * np.exp(-1j * dense))
    for shift in np.linspace(0.0, 2 * np.pi / 800, 7):
        phi, slope = turning(bent(PHASE - shift), scale)
        assert np.mean(phi * np.exp(-1j * (PHASE - shift))) == pytest.approx(exact, abs=3e-4)
        assert np.all(slope >= 0)


def test_a_motion_that_stands_still_has_numbers() -> None:
    """Nothing moves, or it turns and then stands: no division by a step that is none."""
    still = np.zeros(100)
    stands = np.concatenate([np.full(30, -1.0), [-0.5, 0.5], np.zeros(68)])
    for v in (still, stands):
        phi, slope = turning(v, 0.1)
        assert np.all(np.isfinite(phi))
        assert np.all(np.isfinite(slope))
    assert np.all(turning(still, 0.1)[0] == 0)
