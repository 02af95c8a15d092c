"""Passes in the log of any motion, and their signals, harmonics and noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plants.cogged_joint import CoggedJoint, logged, simulated
from plants.friction_logs import RATE, RATIO, sliding_torque, trapezoids
from plants.refusals import advised, refused

from elastid.base.arrays import FloatArray
from elastid.friction_record import FrictionRecord
from elastid.friction_study.constant_velocity import Pass, PassRegression, estimate_friction_curve, passes_of
from elastid.friction_study.motion_signals import Motion, MotionSignals, detect_passes
from elastid.model.formulation import ElasticJoint


def record(q: FloatArray, **changes: Any) -> FrictionRecord:
    """A log with a 16-bit encoder on the motor."""
    count = 2 * np.pi / RATIO / 65536
    return FrictionRecord("log", "1", "motion", RATE, np.round(q / count) * count, sliding_torque(q), **changes)


def test_a_log_of_one_speed_gives_its_own_passes_alone() -> None:
    found = detect_passes(record(trapezoids((0.2, 0.5, 0.2)), speed=0.2), True)
    assert [each.speed for each in found] == pytest.approx([0.2, 0.2], rel=0.01)


def test_a_motion_without_plateaus_has_no_passes() -> None:
    t = np.arange(5000) / RATE
    assert detect_passes(record(0.5 * np.sin(2 * np.pi * 0.4 * t)), True) == ()


@pytest.mark.parametrize("position", [trapezoids((0.5,), travel=0.05), trapezoids((0.5,))[: round(2.1 * RATE)]])
def test_a_log_without_its_pass_is_refused(position: FloatArray) -> None:
    """Too short a way, and no way back."""
    with refused("friction/constant-velocity-runs", holds="0.5 rad/s"):
        detect_passes(record(position, speed=0.5), True)


def test_ways_whose_speed_wanders_with_the_cogging_are_passes() -> None:
    """15 Nm of cogging on 115 Nm: twelve speeds of twelve, levels within 0.5 %, a slope of 12 % between directions."""
    joint = CoggedJoint(uneven=0.12 * 60)
    speeds = np.geomspace(0.05, 1.0, 12)
    ends = simulated([joint] * 12, [trapezoids((speed,), 0.5, 1000.0) for speed in speeds], 1e-3)
    logs = [replace(logged(*end, 1e-3, i), name=f"log {i}") for i, end in enumerate(ends)]
    wander = np.gradient(ends[0][0])[3000:9000]
    assert wander.std() > 0.1 * wander.mean()
    passes = [each for log in logs for each in detect_passes(log, True)]
    assert [each.speed for each in passes] == pytest.approx(speeds, rel=0.02)
    levels = estimate_friction_curve([one for each in passes for one in passes_of(each)], True, 2 * np.pi / RATIO)
    truth = [float(joint.level(v, s)) for v, s in zip(levels.speed, levels.direction, strict=True)]
    assert set(levels.direction) == {-1.0, 1.0}
    assert levels.torque == pytest.approx(truth, rel=5e-3)


def regression(noise: np.ndarray, ripple: float) -> PassRegression:
    """Both ways over ten turns of the motor at one speed; ripple: of the fifth harmonic, Nm."""
    n = len(noise) // 2
    q, one = np.linspace(0, 10.0, n), np.ones(n)
    passes = [
        Pass("joint 1", "a", way, s * one, 0 * one, 3.0 * s + ripple * np.cos(2 * np.pi * 5 * way) + part)
        for s, way, part in ((1.0, q, noise[:n]), (-1.0, q[::-1], noise[n:]))
    ]
    return PassRegression.of(passes, False, 1.0)


def test_outstanding_harmonic_joins_regression() -> None:
    """The fifth of a motor turn; the level is that of the truth either way."""
    noise = 0.01 * np.random.default_rng(1).standard_normal(8000)
    for ripple, names in ((0.5, {"ripple.5c", "ripple.5s"}), (0.0, set())):
        found = regression(noise, ripple)
        further = {name for name in found.shared if name.startswith("ripple") and name[7:-1] not in ("1", "2")}
        assert further == names
        assert found.solve()[0][0] == pytest.approx(3.0, abs=2e-3)


def test_torque_variance_counts_noise_correlation() -> None:
    """sigma^2 / n (1 + phi) / (1 - phi) of noise x_k+1 = phi x_k + e, var e = sigma^2 (1 - phi^2)."""
    phi, n = 0.5, 14_000
    e = np.random.default_rng(2).standard_normal(n) * np.sqrt(1 - phi**2)
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + e[k]
    assert regression(x, 0.0).solve()[1][0, 0] == pytest.approx((1 + phi) / (1 - phi) / n, rel=0.15)


def test_inertia_is_at_instant_of_held_torque() -> None:
    """Within a ramp of 2 rad/s^3 half a sample of 10 ms changes an acceleration by 0.01 rad/s^2."""
    rate = 100.0
    t = np.arange(200) / rate
    one = FrictionRecord(
        "a", "elbow", "constant_velocity", rate, t**3 / 3, np.zeros(200), velocity=t**2, there=(50, 150),
        torque_delay_s=5e-3,
    )  # fmt: skip
    (held,), (read,) = passes_of(one), passes_of(replace(one, torque_delay_s=0.0))
    (short,) = passes_of(replace(one, there=(100, 110)))
    assert len(short.position) == 8  # a tenth at each end may hold its ramps
    np.testing.assert_allclose((held.acceleration - read.acceleration)[20:-20], 0.01, rtol=0.02)
    np.testing.assert_allclose((held.velocity - read.velocity)[20:-20], 5e-3 * read.acceleration[20:-20], rtol=0.02)


def test_signals_are_filtered_to_3_db_with_position_noise():
    """Half of the power at the end of the passband; noise of velocity and acceleration through the same filter."""
    rate, passband_hz = 500.0, 20.0
    t, noise = np.arange(20_000) / rate, 1e-4 * np.random.default_rng(0).standard_normal(20_000)
    to_and_fro, forth = 0.5 * np.sin(2 * np.pi * 0.3 * t), 0.2 * t + 0.05 * np.sin(t)
    signals = MotionSignals.of(Motion("joint 1", rate, to_and_fro + noise, to_and_fro), passband_hz)
    taps = signals.taps
    assert abs(np.exp(-2j * np.pi * passband_hz / rate * np.arange(len(taps))) @ taps) == pytest.approx(
        0.5**0.5, rel=0.01
    )
    smooth = np.convolve(noise, taps, "valid")
    powers = np.var(np.gradient(smooth)[1:-1] * rate), np.var(np.diff(smooth, 2) * rate**2)
    np.testing.assert_allclose(signals.noise_powers, powers, rtol=0.05)
    one_way = MotionSignals.of(Motion("joint 1", rate, forth, forth), passband_hz)
    assert [each.moves(way) for each in (signals, one_way) for way in (1, -1)] == [True, True, True, False]
    assert sum(signals.seconds.values()) == pytest.approx(40.0)
    with refused("friction/motion", place="motion of joint 1", holds="it lasts 1 s at 500 Hz") as caught:
        MotionSignals.of(Motion("joint 1", rate, forth[:500], forth[:500]), passband_hz)
    enough = forth[: round(advised(caught, "Hz takes") * rate)]
    assert MotionSignals.of(Motion("joint 1", rate, enough, enough), passband_hz).moves(1)


def test_inertial_acceleration_weighs_motor_and_link() -> None:
    """At 5 Hz, with a gear resonance of 8 Hz, the link moves by H = (d s + k) / (J_l s^2 + d s + k)."""
    rate, omega, joint = 500.0, 2 * np.pi * 5.0, ElasticJoint(2.0, 3.0, 3.0 * (2 * np.pi * 8) ** 2, 30.0)
    t = np.arange(8_000) / rate
    motion = Motion("joint 1", rate, 0.1 * np.sin(omega * t), np.sin(omega * t), spring=joint)
    signals, s = MotionSignals.of(motion, 20.0), 1j * omega
    H = (joint.damping * s + joint.stiffness) / (joint.link_inertia * s**2 + joint.damping * s + joint.stiffness)
    expected = (0.1 * s**2 * (2 + 3 * H) / 5 * np.exp(s * t)).imag
    inner = slice(4_000, -1_000)
    np.testing.assert_allclose(signals.inertial_acceleration[inner], expected[inner], atol=3e-3 * 0.1 * omega**2)
    rigid = MotionSignals.of(replace(motion, spring=None), 20.0).inertial_acceleration
    np.testing.assert_allclose(rigid[inner], (0.1 * s**2 * np.exp(s * t)).imag[inner], atol=3e-3 * 0.1 * omega**2)
