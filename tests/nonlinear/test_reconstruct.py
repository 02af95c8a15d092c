"""Reversals under dry friction are found where they are, between the samples of a motor whose torque is held."""

from dataclasses import replace
from functools import cache

import numpy as np

from elastid.nonlinear.friction import FrictionTakenOut, Shape
from elastid.nonlinear.motion import CELLS, Motion, motion_of
from elastid.nonlinear.take_out import TURNING_ERROR, net_record
from elastid.record import Configuration, Record

RATE, N, PERIODS = 100.0, 200, 3
J, K, D, COULOMB = 1.0, 900.0, 6.0, 0.25
STEPS = 512


@cache
def simulated() -> tuple[Record, np.ndarray]:
    """A mass on a spring with Coulomb friction, its torque held over each sample; times at which it turns back."""
    t = np.arange(N) / RATE
    phases = np.random.default_rng(3).uniform(0, 2 * np.pi, 12)
    u = np.sum([np.sin(2 * np.pi * k * RATE / N * t + p) for k, p in zip(range(3, 27, 2), phases, strict=True)], axis=0)
    q = v = 0.0
    angles, turning, dt = [], [], 1 / (RATE * STEPS)
    for i in range(2 * PERIODS * N):
        angles.append(q)
        for step in range(STEPS):
            before, a = v, (u[i % N] - K * q - D * v - COULOMB * (1.0 if v > 0 else -1.0)) / J
            v += dt * a
            q += dt * (before + v) / 2
            if before * v < 0:
                turning.append((i + (step + before / (before - v)) / STEPS) / RATE - PERIODS * N / RATE)
    configuration = Configuration("c", np.zeros(1))
    record = Record(
        "c", configuration, 0, 0, RATE, N, ("motor 1",), ("motor 1",), ("position",), np.tile(u, PERIODS)[:, None],
        np.array(angles)[PERIODS * N :, None], hold="zero-order",
    )  # fmt: skip
    return record, np.array([time for time in turning if time > 0])


def friction_of(accelerance: float) -> FrictionTakenOut:
    return FrictionTakenOut(
        ("motor 1",), ("N*m",), (Shape("motor 1", "sign"),), np.array([COULOMB]), np.eye(1), ("c",), np.ones((1, 1)),
        np.ones((1, 1)), np.ones(1), np.array([accelerance]),
    )  # fmt: skip


def lateness(motion: Motion) -> np.ndarray:
    """By how many samples each true reversal is found late."""
    _, turning = simulated()
    v = motion.velocity
    at = np.flatnonzero(v[1:] * v[:-1] < 0)
    found = (at + v[at] / (v[at] - v[at + 1])) / CELLS
    late = np.array([found[np.argmin(np.abs(found - RATE * time))] - RATE * time for time in turning])
    # Those that stick for a moment have no time of their own.
    return late[np.abs(late) < 0.5]


def test_reversals_are_late_between_samples_by_what_the_errors_of_responses_have() -> None:
    record, _ = simulated()
    late = lateness(friction_of(1 / J).motion(record, "motor 1"))
    assert len(late) > 50
    assert 0.5 * TURNING_ERROR < late.mean() < 1.5 * TURNING_ERROR


def test_reversals_under_noise_are_found_by_the_torque_above_the_excited_lines() -> None:
    """Noise of 1 % of the angle: they are off by less than 0.7 of what they are by the angle alone."""
    record, _ = simulated()
    noise = 0.01 * np.std(record.y) * np.random.default_rng(4).standard_normal(record.y.shape)
    record = replace(record, y=record.y + noise)
    by_angle, by_torque = motion_of(record, "motor 1"), friction_of(1 / J).motion(record, "motor 1")
    assert np.mean(lateness(by_torque) ** 2) < 0.7**2 * np.mean(lateness(by_angle) ** 2)


def test_friction_of_level_0_leaves_the_torque() -> None:
    """And the motion, to the last bit."""
    record, _ = simulated()
    net = net_record(record, replace(friction_of(1 / J), levels=np.zeros(1)))
    np.testing.assert_array_equal(net.u, record.u)
    np.testing.assert_array_equal(net.y, record.y)
