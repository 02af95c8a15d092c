"""Kinematics, Newton's law and energy distinguish quantity, unit and sign of channels."""

import numpy as np
import pytest

from elastid.recorded.evidence import (
    derivative,
    motion_relations,
    torque_relation,
    travel,
)

RATE = 500.0
J, F, COULOMB = 3.0, 8.0, 5.0


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity, acceleration (n,) of four sines for 20 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(10_000) / RATE
    omega, phase = 2 * np.pi * rng.uniform(0.2, 2, 4), rng.uniform(0, 6, 4)
    parts = [
        [w ** (k - 1) * np.sin(w * t + p + k * np.pi / 2) for w, p in zip(omega, phase, strict=True)] for k in range(3)
    ]
    return tuple(np.sum(part, axis=0) * 0.2 for part in parts)  # type: ignore[return-value]


def torque(seed: int = 0) -> np.ndarray:
    _, v, a = motion(seed)
    return J * a + F * v + COULOMB * np.sign(v) + 0.1 * np.random.default_rng(9).standard_normal(len(v))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_derivative_of_a_sine_is_damped_as_the_gaussian_says(order: int) -> None:
    """omega^k exp(-(s omega)^2 / 2), with a phase of k quarter turns."""
    omega, width = 2 * np.pi * 20 / RATE, 8.0
    t = np.arange(2000)
    expected = (omega * RATE) ** order * np.exp(-((width * omega) ** 2) / 2) * np.sin(omega * t + order * np.pi / 2)
    assert derivative(np.sin(omega * t), order, RATE, width) == pytest.approx(expected[48:-48], abs=1e-6 * RATE**order)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 0), (0, 2), (1, 1)])
def test_the_order_between_two_motions_and_their_gain_are_found(first: int, second: int) -> None:
    """With an encoder of 4096 counts, and speed in rpm."""
    signals = [np.round(x * 650) / 650 for x in motion()]
    gain = 60 / (2 * np.pi)
    relations = list(motion_relations(signals[first], -gain * signals[second], RATE))
    best = max(relations, key=lambda r: abs(r.correlation))
    assert best.order == second - first
    assert best.gain == pytest.approx(-gain, rel=0.03)
    assert best.correlation < -0.99


def test_motions_of_two_joints_have_no_relation() -> None:
    assert all(abs(r.correlation) < 0.9 for r in motion_relations(motion(1)[0], motion(2)[1], RATE))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_newtons_law_has_the_inertia_of_the_joint_from_each_motion(order: int) -> None:
    relation = torque_relation(torque(), motion()[order], order, RATE)
    assert relation.explained > 0.99
    assert relation.inertia == pytest.approx(J, rel=0.03)
    assert relation.dissipated > 0
    assert not relation.is_against_motion


def test_travel_leaves_a_single_spike_out() -> None:
    x = np.concatenate([np.linspace(0, 1, 5000), [1e6]])
    assert travel(x) == pytest.approx(1.0, rel=0.01)
