"""What innovations do not show, the followed numbers do."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_study.extended_kalman_filter import Estimate, Track, consistency
from elastid.friction_study.follow import _noise
from tests.plants.warm_joint import FOLLOWED

RATE_HZ, N, STD, DRIFT = 200.0, 8000, 0.02, 0.01


def track(coulomb: FloatArray, innovation: FloatArray) -> Track:
    """A filter with white S = 1, whose joint moves a second each way, with rests of a second between."""
    x = np.zeros((N, len(FOLLOWED.states)))
    cycle = np.repeat([1.0, 0.0, -1.0, 0.0], round(RATE_HZ))
    x[:, FOLLOWED.states.index("v_m")] = np.resize(cycle, N)
    x[:, FOLLOWED.states.index("Fc")] = coulomb
    covariance = np.tile(STD**2 * np.eye(3), (N, 1, 1))
    last = Estimate(x[-1], np.eye(x.shape[1]))
    ones = np.ones(N)
    return Track(
        FOLLOWED, RATE_HZ, x, np.full_like(x, STD), covariance, innovation, ones, last, np.full(3, DRIFT), ones > 0
    )  # fmt: skip


def white(seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(N)


def test_a_number_that_moves_by_more_than_its_band_is_restless() -> None:
    """Coulomb friction that jumps by 15 std every three seconds; one that stays is honest."""
    judged = consistency(track(0.3 * np.resize(np.repeat([1.0, -1.0], 600), N), white()), 1.0)
    assert [movement.name for movement in judged.restless] == ["Fc"]
    assert not judged.is_honest
    assert any("Fc changes by" in note.text for note in _noise("joint 1", judged))
    assert consistency(track(np.zeros(N), white()), 1.0).is_honest
