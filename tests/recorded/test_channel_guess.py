"""Guesses of channels: by name, by unit, by Newton's law."""

import numpy as np
import pytest

from elastid.recorded.channel_guess import guess_log, is_clock
from elastid.recorded.channel_names import guess_by_name
from elastid.recorded.evidence import velocities

RATE = 500.0


def test_a_unit_that_the_file_states_counts_more_than_the_name() -> None:
    assert guess_by_name("channel_1", None, "deg/s").quantity == "velocity"


def test_the_unit_behind_a_name_is_no_part_of_a_place() -> None:
    assert guess_by_name("acc_a [m/s^2]", None).place == "acc_a"
    assert guess_by_name("x (left)", None).place == "x left"


def rows(n: int = 2) -> list[tuple[object, np.ndarray]]:
    """Torques and angles in deg of joints that move as different sines, with speeds in rad/s; angle 2 is mirrored."""
    t = np.arange(10_000) / RATE
    signals = []
    for k in range(n):
        omega = np.array([1.1, 2.3, 3.1]) * (1 + 0.37 * k)
        q, v, a = (sum(0.3 * w**m * np.sin(w * t + m * np.pi / 2) for w in omega) for m in range(3))
        signals += [(f"tau_{k + 1}", 3 * a + 5 * v + 2 * np.sign(v)), (f"w_{k + 1}", v)]
        signals += [(f"pos_{k + 1}", np.rad2deg(q) * (-1) ** k)]
    return [(guess_by_name(name, None), x) for name, x in signals]


def test_torques_and_motions_are_paired_with_unit_and_sign() -> None:
    guess = guess_log(rows()[::-1], RATE)
    assert guess is not None
    pairs = {joint.torque.name: joint.motion for joint in guess.joints}
    assert {name: motion.name for name, motion in pairs.items()} == {"tau_1": "pos_1", "tau_2": "pos_2"}
    assert pairs["tau_1"].unit == "deg"
    assert (pairs["tau_1"].sign, pairs["tau_2"].sign) == (1, -1)
    assert guess.is_motion


def test_one_signal_is_no_log_of_a_machine() -> None:
    assert guess_log(rows(1)[:1], RATE) is None


CONTENT_RATE = 250.0
T = np.arange(5000) / CONTENT_RATE


def joint(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and torque (n,), with gravity and friction, of a joint of its own motion."""
    omega = np.array([0.9, 2.1, 3.3]) * (1 + 0.31 * k)
    q, v, a = (sum(0.2 * w**m * np.sin(w * T + w * k + m * np.pi / 2) for w in omega) for m in range(3))
    noise = 0.05 * np.random.default_rng(k).standard_normal(len(T))
    return q, v, 3 * a + 5 * v + 4 * np.sign(v) + 30 * np.cos(q) + noise


def test_stamps_are_a_clock_and_a_motion_is_none() -> None:
    rng = np.random.default_rng(0)
    assert is_clock(1000 + np.cumsum(rng.choice([0.01, 0.012], 3000)))
    assert is_clock(T)
    assert not is_clock(joint(0)[0])
    assert not is_clock(np.cumsum(rng.exponential(1.0, 3000)))


def test_joints_are_found_among_columns_without_names() -> None:
    """In any order, next to temperatures and to a copy of each position; and the rate by velocities."""
    parts = [joint(k) for k in range(3)]
    columns = [*(u for *_, u in parts), *(q for q, *_ in parts), *(v for _, v, _ in parts)]
    columns += [*(q + 0.1 for q, *_ in parts), 30 + np.round(0.01 * T, 1)]
    guess = guess_log([(guess_by_name(f"column {i}", None), x) for i, x in enumerate(columns)], CONTENT_RATE)
    assert guess is not None
    pairs = [(each.torque.name, each.motion.name) for each in guess.joints]
    assert pairs == [("column 0", "column 3"), ("column 1", "column 4"), ("column 2", "column 5")]
    assert [rate for _, rate in velocities(columns).values()] == pytest.approx([1 / 250**-1] * 6, rel=1e-3)


def test_noise_is_no_joint() -> None:
    noise = np.random.default_rng(0).standard_normal((6, 4000))
    guess = guess_log([(guess_by_name(f"column {i}", None), x) for i, x in enumerate(noise)], 1.0)
    assert guess is not None
    assert "no name says it: the first column" in guess.joints[0].torque.why
