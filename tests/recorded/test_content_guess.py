"""What signals are by what they hold: rows of a sample, clocks, derivatives and torques."""

import numpy as np
import pytest

from elastid.recorded.content_guess import is_clock, motions_in, rows_of_a_sample

RATE = 250.0
T = np.arange(5000) / RATE


def joint(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and torque (n,), with gravity and friction, of a joint of its own motion."""
    omega = np.array([0.9, 2.1, 3.3]) * (1 + 0.31 * k)
    q, v, a = (sum(0.2 * w**m * np.sin(w * T + w * k + m * np.pi / 2) for w in omega) for m in range(3))
    noise = 0.05 * np.random.default_rng(k).standard_normal(len(T))
    return q, v, 3 * a + 5 * v + 4 * np.sign(v) + 30 * np.cos(q) + noise


@pytest.mark.parametrize("n", [1, 3, 7])
def test_signals_one_below_the_other_are_counted(n: int) -> None:
    table = np.stack([joint(k)[0] + 0.3 * k for k in range(n)], axis=1).reshape(-1, 1)
    assert rows_of_a_sample(table) == n


def test_noise_and_a_multisine_have_one_row_a_sample() -> None:
    rng = np.random.default_rng(0)
    lines = np.arange(1, 400)
    multisine = np.cos(2 * np.pi * np.outer(np.arange(4000) / 2000, lines) + rng.uniform(0, 6, len(lines))).sum(axis=1)
    assert rows_of_a_sample(rng.standard_normal((4000, 3))) == 1
    assert rows_of_a_sample(multisine[:, None]) == 1


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
    found, rates_hz = motions_in(columns)
    assert [(guess.torque, guess.position, guess.velocity) for guess in found] == [(0, 3, 6), (1, 4, 7), (2, 5, 8)]
    assert rates_hz == pytest.approx([RATE] * 6, rel=1e-3)


def test_noise_is_no_joint() -> None:
    assert motions_in(list(np.random.default_rng(0).standard_normal((6, 4000)))) == ((), ())
