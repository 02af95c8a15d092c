"""Passes from records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elastid.friction_study.passes import passes_of
from elastid.record import FrictionRecord

RATE, SPEED, COUNT = 1000.0, 0.4, 2e-5


def record() -> FrictionRecord:
    """Half a second there and half a second back with ramps of 0.2 s; torque 3 Nm there and -2 Nm back."""
    ramp, steady = np.linspace(0, 1, 200), np.ones(500)
    way = np.concatenate([ramp, steady, ramp[::-1], np.zeros(100)])
    v = SPEED * np.concatenate([way, -way])
    torque = np.where(v > 0, 3.0, -2.0)
    q = np.round(np.cumsum(v) / RATE / COUNT) * COUNT
    T = np.where(np.arange(len(v)) < len(way), 30.0, np.nan)
    return FrictionRecord(
        "a", "elbow", "passes", RATE, q, torque, temperature=T, there=(200, 700), back=(1200, 1700), load_torque=5.0
    )


def test_a_pair_has_both_plateaus_with_their_velocity() -> None:
    """Differentiated from 0.4 mrad a sample behind an encoder of 0.02 mrad; at rest the acceleration is nothing."""
    there, back = passes_of(record())
    assert (there.place, there.pair, back.pair, there.load) == ("joint elbow", "a", "a", 5.0)
    assert (there.direction, back.direction) == (1.0, -1.0)
    inside = slice(50, -50)
    np.testing.assert_allclose(there.velocity[inside], SPEED, rtol=0.01)
    assert np.abs(there.acceleration[inside]).max() < 0.5
    assert set(there.torque.tolist()) == {3.0}
    assert there.temperature == 30.0
    assert np.isnan(back.temperature)


def test_a_measured_velocity_is_taken_and_one_way_stays_alone() -> None:
    one = record()
    (there,) = passes_of(replace(one, velocity=np.full(len(one.position), 0.7), back=None))
    assert there.velocity.mean() == pytest.approx(0.7)
    assert there.temperature == 30.0
