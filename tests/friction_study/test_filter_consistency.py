"""What innovations do not show, the followed numbers and the stops do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_study.extended_kalman_filter import Estimate, Track
from elastid.friction_study.filter_consistency import consistency
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


def test_a_pattern_that_repeats_at_stops_is_named_by_direction() -> None:
    """Half a std at each sample of 0.2 s after stops, forwards alone."""
    innovation = white()
    for start in range(0, N, round(4 * RATE_HZ)):
        innovation[start : start + round(0.2 * RATE_HZ)] += 1.0
    judged = consistency(track(np.zeros(N), innovation), 1.0)
    assert not judged.is_honest
    assert [pattern.kind for pattern in judged.at_stops if pattern.repeats] == ["after stops, forwards"]
    (note,) = (note for note in _noise("joint 1", judged) if note.code == "filter/at-stops")
    assert "after stops, forwards, the joint goes farther than predicted" in note.text


def test_a_motion_without_stops_has_no_pattern_at_them() -> None:
    """Nor is one judged on fewer events than four."""
    moving = track(np.zeros(N), white())
    x = moving.x.copy()
    x[:, FOLLOWED.states.index("v_m")] = 1.0
    assert consistency(replace(moving, x=x), 1.0).at_stops == ()
