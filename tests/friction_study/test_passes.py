"""Passes from records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elastid.friction_study.levels import Pass, PassRegression, passes_of
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


def regression(noise: np.ndarray, ripple: float) -> PassRegression:
    """Both ways over ten turns of the motor at one speed; ripple: of the fifth harmonic, Nm."""
    n = len(noise) // 2
    q, one = np.linspace(0, 10.0, n), np.ones(n)
    passes = [
        Pass("joint 1", "a", way, s * one, 0 * one, 3.0 * s + ripple * np.cos(2 * np.pi * 5 * way) + part)
        for s, way, part in ((1.0, q, noise[:n]), (-1.0, q[::-1], noise[n:]))
    ]
    return PassRegression.of(passes, False, 1.0)


def test_a_harmonic_that_stands_out_of_the_residuals_joins_the_regression() -> None:
    """The fifth of a motor turn; the level is that of the truth either way."""
    noise = 0.01 * np.random.default_rng(1).standard_normal(8000)
    for ripple, names in ((0.5, {"ripple.5c", "ripple.5s"}), (0.0, set())):
        found = regression(noise, ripple)
        further = {name for name in found.shared if name.startswith("ripple") and name[7:-1] not in ("1", "2")}
        assert further == names
        assert found.solve()[0][0] == pytest.approx(3.0, abs=2e-3)


def test_the_variance_of_a_level_counts_the_correlation_of_the_noise() -> None:
    """sigma^2 / n (1 + phi) / (1 - phi) of noise x_k+1 = phi x_k + e, var e = sigma^2 (1 - phi^2)."""
    phi, n = 0.5, 14_000
    e = np.random.default_rng(2).standard_normal(n) * np.sqrt(1 - phi**2)
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + e[k]
    variance = regression(x, 0.0).solve()[1][0, 0]
    assert variance == pytest.approx((1 + phi) / (1 - phi) / n, rel=0.15)


def test_inertia_is_that_of_the_instant_at_which_a_held_torque_acts() -> None:
    """Within a ramp of 2 rad/s^3 half a sample of 10 ms changes an acceleration by 0.01 rad/s^2."""
    rate = 100.0
    t = np.arange(200) / rate
    one = FrictionRecord(
        "a", "elbow", "passes", rate, t**3 / 3, np.zeros(200), velocity=t**2, there=(50, 150), torque_delay_s=5e-3
    )
    (held,), (read,) = passes_of(one), passes_of(replace(one, torque_delay_s=0.0))
    np.testing.assert_allclose((held.acceleration - read.acceleration)[20:-20], 0.01, rtol=0.02)
    np.testing.assert_allclose((held.velocity - read.velocity)[20:-20], 5e-3 * read.acceleration[20:-20], rtol=0.02)
