"""A spring between motor and link is found in what a rigid axis leaves."""

from __future__ import annotations

import re

import numpy as np

from elastid.friction_study.motion import regress_motion
from elastid.friction_study.motion_signals import Motion

J, VISCOUS, F_C = 12.0, 30.0, 40.0


def with_link(resonance_hz: float, share: float = 0.5) -> Motion:
    """A motor that moves a share of its inertia by a spring; resonance of the link with the motor held.

    Of a link's angle sum a sin(w t) the motor's is sum a (1 - w^2 / w_0^2) sin(w t).
    """
    rng, rate, w_0 = np.random.default_rng(0), 500.0, 2 * np.pi * resonance_hz
    t = np.arange(20_000) / rate
    a, w = np.array([[0.5], [0.15], [0.05]]), np.array([[0.8], [3.1], [7.5]])
    phase, motor = w * t + rng.uniform(0, 6, (3, 1)), 1 - (w / w_0) ** 2
    q, v = (a * motor * np.sin(phase)).sum(axis=0), (a * motor * w * np.cos(phase)).sum(axis=0)
    torque = -J * (a * w**2 * ((1 - share) * motor + share) * np.sin(phase)).sum(axis=0)
    torque += (F_C + VISCOUS * np.abs(v)) * np.sign(v) + 0.5 * rng.standard_normal(len(t))
    return Motion("joint 1", rate, np.round(q / 6e-6) * 6e-6, torque)


def test_a_spring_between_motor_and_link_is_a_misfit_and_a_stiff_one_is_none() -> None:
    """A link at 6 to 15 Hz; one at 1 kHz is rigid, though the noise of its angle is in acceleration and torque."""
    for resonance_hz in (6.0, 15.0):
        fit = regress_motion(with_link(resonance_hz))
        highest = float(re.findall(r"swings below ([0-9.]+) Hz", fit.misfit)[0])
        assert resonance_hz < highest < 1.6 * resonance_hz
        assert abs(fit.chosen["inertia"] - J) < 1.96 * fit.chosen.std("inertia")
    fit = regress_motion(with_link(1000.0))
    assert not fit.misfit
    assert abs(fit.chosen["inertia"] - J) < 3 * fit.chosen.std("inertia")
