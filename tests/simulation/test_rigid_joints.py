"""Rigid joints under commands against closed forms and SciPy's integration."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elastid.base.arrays import FloatArray
from elastid.simulation import rigid_joints
from elastid.simulation.rigid_joints import PARAMETERS, CommandedJoints

J, f, kp, kd = 0.02, 0.1, 20.0, 1.0


def joints(reference: FloatArray, held: bool = True) -> CommandedJoints:
    """One joint at rest at 0 under references (n,)."""
    one, zero = np.ones(1), np.zeros(1)
    command = kp * reference[:, None]
    return CommandedJoints(200.0, command, kp * one, kd * one, zero, zero, 0 * command, zero, held)


def simulate(commanded: CommandedJoints, numbers: list[list[float]], delay_s: list[float]) -> FloatArray:
    """Simulate positions (n, K) of one joint for candidates, first parameters (K, up to 12) and delays (K,)."""
    rows = np.array([row + [0.0] * (len(PARAMETERS) - len(row)) for row in numbers])[:, None]
    return commanded.simulate(rows, np.array(delay_s), commanded.steps_per_sample(rows))[..., 0]


@pytest.mark.parametrize("delay_s", [0.0, 0.0013, 0.0172])
def test_delayed_step_response_agrees_with_closed_form(delay_s: float) -> None:
    """A fraction of a sample counts as such: the poles of J s^2 + (f + k_d) s + k_p after the delay."""
    reference = np.where(np.arange(200) >= 20, 1.0, 0.0)
    moved = simulate(joints(reference), [[J, f]], [delay_s])[:, 0]
    t = np.maximum(np.arange(200) / 200 - 0.1 - delay_s, 0.0)
    decay, beat = (f + kd) / (2 * J), math.sqrt(kp / J - ((f + kd) / (2 * J)) ** 2)
    exact = 1 - np.exp(-decay * t) * (np.cos(beat * t) + decay / beat * np.sin(beat * t))
    assert np.max(np.abs(moved - exact)) < 3e-3
    assert moved[-1] == pytest.approx(1.0, abs=1e-6)


def test_linear_commands_agree_with_integration_by_scipy() -> None:
    """With gravity, an offset and a load, under a sine that is linear between its samples."""
    t = np.arange(400) / 200
    reference, load = 0.3 * np.sin(2 * np.pi * t), 0.2 * t
    commanded = joints(reference, held=False)
    object.__setattr__(commanded, "load", load[:, None])
    moved = simulate(commanded, [[J, f, 0, 0.05, 0.4, 0.7]], [0.004])[:, 0]

    def rate(time: float, x: FloatArray) -> list[float]:
        r = float(np.interp(time - 0.004, t, reference))
        torque = kp * (r - x[0]) - kd * x[1] - 0.2 * time - 0.05 - 0.4 * math.cos(x[0]) - 0.7 * math.sin(x[0])
        return [x[1], (torque - f * x[1]) / J]

    exact = solve_ivp(rate, (0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.005).y[0]
    assert np.max(np.abs(moved - exact)) < 2e-4


def test_a_joint_sticks_where_its_command_is_below_coulomb_friction() -> None:
    """Exactly, without creep; beyond it the joint ends where friction holds the rest of the command."""
    reference = np.full(400, 0.02)
    moved = simulate(joints(reference), [[J, f, 0.41], [J, f, 0.1]], [0.0, 0.0])
    assert np.all(moved[:, 0] == 0)
    assert 0.015 <= moved[-1, 1] <= 0.025


def test_a_joint_that_sticks_softly_creeps_at_a_constant_velocity() -> None:
    """c T / J = (1 - c) v / tau under a constant torque T below Coulomb friction; the joint is at rest for c = 0."""
    T, tau, c = 0.2, 0.02, 0.1
    commanded = replace(joints(np.full(2000, T / kp)), kp=np.full(1, 1e-9))
    numbers = [[J, 0, 2 * T, 0, 0, 0, tau, creep] for creep in (c, 0.0)]
    moved = simulate(replace(commanded, kd=np.zeros(1)), numbers, [0.0, 0.0])
    velocity = (moved[-1] - moved[1000]) / (999 / 200)
    assert velocity == pytest.approx([c * T / J * tau / (1 - c), 0.0], rel=0.1)


@pytest.mark.parametrize(("T", "F_s"), [(0.0, 0.2), (0.01, 0.2), (0.01, 0.3)])
def test_bristles_agree_with_integration_by_scipy(T: float, F_s: float) -> None:
    """The LuGre model with compliance s and damping time T before sliding, and stiction F_s."""
    F_c, s, nu_s, t = 0.2, 0.02, 0.05, np.arange(400) / 200
    reference = 0.05 * np.sin(2 * np.pi * t)

    def rate(time: float, x: FloatArray) -> list[float]:
        change = (x[1] - abs(x[1]) * x[2] / (F_c + (F_s - F_c) * math.exp(-((x[1] / nu_s) ** 2)))) / s
        torque = kp * (reference[min(int(time * 200 + 1e-9), 399)] - x[0]) - (kd + f) * x[1]
        return [x[1], (torque - x[2] - T * change) / J, change]

    exact = solve_ivp(rate, (0, t[-1]), [0.0] * 3, t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.001).y[0]
    moved = simulate(joints(reference), [[J, f, F_c, 0, 0, 0, 0, 0, s, T, F_s - F_c, nu_s]], [0.0])[:, 0]
    assert np.max(np.abs(moved - exact)) < 0.01 * np.max(np.abs(exact))


def test_stiff_bristles_stick_exactly() -> None:
    """The limit without compliance is the joint that sticks exactly."""
    reference = 0.05 * np.sin(np.arange(400) / 30)
    moved = simulate(joints(reference), [[J, f, 0.2, 0, 0, 0, 0, 0, s, 0] for s in (1e-7, 0.0)], [0.0, 0.0])
    assert np.max(np.abs(moved[:, 0] - moved[:, 1])) < 1e-5


def test_candidates_move_as_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates are the same together, alone and without a C compiler; means over windows are means of samples."""
    commanded = joints(0.3 * np.sin(np.arange(300) / 15))
    rows = [[J, f, 0.1, 0, 0, 0, 0.01, 0.1, 0, 0, 0, 0], [J / 4, 2 * f, 0.2, 0, 0.3, 0, 0, 0, 0.01, 0.001, 0.1, 0.2]]
    numbers, delays = np.array(rows)[:, None], [0.0, 0.01]
    steps = commanded.steps_per_sample(numbers)
    together = commanded.simulate(numbers, np.array(delays), steps)
    with monkeypatch.context() as without_compiler:
        without_compiler.setattr(rigid_joints, "is_compiled", lambda: False)
        by_casadi = commanded.simulate(numbers, np.array(delays), steps)
    np.testing.assert_allclose(by_casadi, together, atol=1e-12)
    for k in range(2):
        alone = commanded.simulate(numbers[k : k + 1], np.array(delays[k : k + 1]), steps)
        np.testing.assert_allclose(together[:, k], alone[:, 0], atol=1e-14)
    means = commanded.simulate(numbers, np.array(delays), steps, window=5)
    np.testing.assert_allclose(means, together.reshape(60, 5, 2, 1).mean(axis=1), atol=1e-14)
