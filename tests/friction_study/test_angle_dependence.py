"""Friction that changes with the angle is said, and noise, ripple and gravity are not taken for it."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.friction_study.pass_checks import angle_note
from elastid.friction_study.passes import Pass


def passes(depth: float, seed: int, noise: float = 0.3) -> list[Pass]:
    """Eight speeds over 1 rad, friction of about 10 Nm under 40 Nm of gravity and ripple."""
    rng, rate, found = np.random.default_rng(seed), 250.0, []
    for v in np.geomspace(0.1, 1.0, 8):
        t = np.arange(int(rate / v)) / rate
        for s in (1.0, -1.0):
            q = s * (v * t - 0.5)
            friction = (9.0 + 2.0 * v) * (1 + depth * np.cos(6 * q))
            u = s * friction + 40 * np.sin(q) + 0.5 * np.cos(60 * q) + noise * rng.standard_normal(len(t))
            found.append(Pass("joint 1", f"{v:.3f}", rate, q, np.full(len(t), s * v), np.zeros(len(t)), u))
    return found


def test_a_tenth_of_friction_is_said_and_half_a_percent_is_not() -> None:
    note = angle_note(passes(0.1, 1), 0.0)
    assert note is not None
    assert "friction changes by" in str(note)
    assert angle_note(passes(0.005, 1), 0.0) is None


@pytest.mark.parametrize("noise", [0.05, 1.0])
def test_friction_that_does_not_change_is_not_said_to(noise: float) -> None:
    """Fifty sets of passes under gravity, ripple and noise: no note."""
    assert not any(angle_note(passes(0.0, seed, noise), 0.0) for seed in range(50))


def test_too_few_pairs_say_nothing() -> None:
    assert angle_note(passes(0.3, 0)[:6], 0.0) is None
