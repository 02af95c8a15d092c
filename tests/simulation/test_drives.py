"""Encoders count and ripple; drives clip, lag and ripple."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from plants.two_links import (
    arm,
    loop,
    quiet,
)

from elastid.model.formulation import serial
from elastid.simulation.closed_loop import simulate
from elastid.simulation.controller import tune
from elastid.simulation.drives import Drives, Lag, Ripple


def test_encoders_count() -> None:
    """Readings are whole counts, at most half a count from the angle."""
    model, count, q0 = serial(arm(damping=20.0)), 3e-5, np.zeros(4)
    torque = 80 * np.sin(np.arange(400) / 10)[:, None] * [1, -1]
    run = simulate(loop(model, count=count), tune(model, q0, 3.0, 0.8), quiet(model, q0, 400, torque), q0)
    counts = run.reading / count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(run.reading - run.q[:, 2:]).max() <= count / 2 * (1 + 1e-9)
    assert len(np.unique(np.round(counts))) > 10


def test_drives_clip_to_both_sides() -> None:
    """A drive without a limit takes every command."""
    drives = Drives(np.zeros(3), np.array([2.0, 2.0, np.inf]))
    assert np.array(ca.DM(drives.clipped(ca.SX([-5.0, 5.0, 9.0])))).ravel().tolist() == [-2.0, 2.0, 9.0]


def test_ripple_is_a_sine_of_the_angle_with_its_phase() -> None:
    """Of the torque, and of the reading before it is counted."""
    ripple = Ripple(np.array([0.1]), np.array([12.0]), np.array([0.4]))
    drives = Drives(np.zeros(1), np.array([np.inf]), (ripple,), (ripple,))
    expected = 0.1 * np.sin(12.0 * 0.3 + 0.4)
    np.testing.assert_allclose(float(ca.DM(drives.on_motors(ca.SX(2.0), ca.SX(0.3)))), 2.0 + expected)
    np.testing.assert_allclose(float(ca.DM(drives.reading(ca.SX(0.3), ca.SX(0.01)))), 0.31 + expected)


@pytest.mark.parametrize("coefficients", [(1.0,), (1.4, 1.0), (2.0, 2.0, 1.0), (0.6, 0.5)])
def test_a_lag_answers_a_step_as_its_transfer_function_does(coefficients: tuple[float, ...]) -> None:
    """1 / P(s T) against the step response by residues; at constant torque nothing moves."""
    T, h = 0.01, 0.003
    lag = Lag(coefficients, T)
    drives = Drives(np.zeros(1), np.array([np.inf]), lag=lag)
    poles = np.roots([*coefficients[::-1], 1.0])
    P_slope = np.polyval(np.polyder([*coefficients[::-1], 1.0]), poles)
    w, u = ca.SX(drives.n_states, 1), ca.SX(3.0)
    for k in range(1, 6):
        torque, w = drives.lagged(w, u, h)
        answer = 3.0 * (1 + np.sum(np.exp(poles * k * h / T) / (poles * P_slope)).real)
        np.testing.assert_allclose(float(ca.DM(torque)), answer, rtol=1e-9)
    held, _ = drives.lagged(ca.SX(drives.start(np.array([3.0]))), u, h)
    np.testing.assert_allclose(float(ca.DM(held)), 3.0)
