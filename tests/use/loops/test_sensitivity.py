"""Sensitivity, poles and bandwidths of sampled loops against python-control and closed forms."""

from __future__ import annotations

import control
import numpy as np
import pytest
from plants.arm import result

from elastid.linear.linear_model import DELAY
from elastid.record import Configuration, JointLoop
from elastid.use.closed_loops import Plants, PostureFamily, Scene, _sampled, closed_loop_poles, scaled
from elastid.use.loops import Cascade, assess, design
from elastid.use.map import largest_gain

RATE_HZ = 400.0
CASCADE = Cascade(
    np.array([8.0, 12.0]), np.array([700.0, 300.0]), np.array([120.0, 90.0]), 1, np.array([[18.0, 0.8, 0.3]]), (1,)
)  # fmt: skip


def plants() -> Plants:
    """Of two postures."""
    postures = [Configuration("a", np.array([0.3, 0.5])), Configuration("b", np.array([0.5, -1.2]))]
    return PostureFamily.of(result(), postures, RATE_HZ).estimate


def controller(cascade: Cascade) -> control.StateSpace:
    """The cascade by python-control: its integral, its difference, its filters and its delay."""
    T = 1 / RATE_HZ
    z = control.tf([1, 0], [1], T)
    axes = []
    for i in range(2):
        p, v = cascade.position_gain[i], cascade.velocity_gain[i]
        F = v * (p + (1 - 1 / z) / T) * (1 + p * T / (z - 1)) / z**cascade.delay
        for b0, b1, b2, a0, a1, a2 in cascade.filters(RATE_HZ).sections[i]:
            F = F * control.tf([b0, b1, b2], [a0, a1, a2], T)
        axes.append(control.tf2ss(F))
    return control.append(*axes)


def test_poles_and_sensitivity_are_those_of_python_control() -> None:
    """Of the coupled loops; poles that cancel may differ, the largest does not."""
    own = plants()
    freq_hz = np.geomspace(0.3, 190, 40)
    both = np.tile(freq_hz, (2, 1))
    S = CASCADE.on(Scene(own, both, own.response(both))).S
    poles = closed_loop_poles(own, CASCADE.gains, CASCADE.filters(RATE_HZ))
    for i in range(2):
        plant = control.ss(own.A[i], own.B[i], own.C[i], np.zeros((2, 2)), 1 / RATE_HZ)
        closed = control.feedback(control.ss([], [], [], np.eye(2), 1 / RATE_HZ), controller(CASCADE) * plant)
        np.testing.assert_allclose(closed(np.exp(2j * np.pi * freq_hz / RATE_HZ)).transpose(2, 0, 1), S[i], rtol=1e-6)
        assert np.abs(poles[i]).max() == pytest.approx(np.abs(closed.poles()).max(), rel=1e-6)


def test_an_ideal_cascade_has_the_bandwidth_of_its_position_gain() -> None:
    """E = s / (s + K_p) of a motor alone whose velocity loop is fast: -3 dB at K_p / 2 pi."""
    rate, J, K_p = 2e4, 3.0, 5.0
    A, B = np.array([[1, 1 / rate], [0, 1]]), np.array([[0.5 / rate**2], [1 / rate]]) / J
    motor = Plants(rate, A[None], B[None], np.array([[[1.0, 0.0]]]), np.array([[J]]))
    freq_hz = np.geomspace(0.05, 500, 2000)[None]
    gains = JointLoop(np.array([K_p * 2e3]), np.array([2e3]), np.zeros(1))
    closed = Scene(motor, freq_hz, motor.response(freq_hz)).closed(gains, None)
    assert closed.bandwidth_hz[0, 0] == pytest.approx(K_p / (2 * np.pi), rel=0.02)


def test_the_scaled_peak_bounds_each_axis_and_is_the_same_in_other_units() -> None:
    """Torques of a sliding axis in kN instead of N change the singular values of S, not of the scaled one."""
    own = plants()
    closed = CASCADE.on(Scene.of(own))
    S, size = closed.S, closed.size
    assert np.all(size[..., None] >= np.abs(np.einsum("nfii->nfi", S)) * (1 - 1e-9))
    unit = np.array([1.0, 1e-3])
    other = S * unit[:, None] / unit
    np.testing.assert_allclose(largest_gain(scaled(other, own.inertia * unit**2)), size, rtol=1e-8)
    assert np.abs(largest_gain(other) / largest_gain(S) - 1).max() > 0.1


@pytest.mark.parametrize("delay_s", [0.0013, 0.0025, 0.006])
def test_a_delay_of_the_fit_is_part_of_the_sampled_plant(delay_s: float) -> None:
    """Of half a sample and of more than two: as the difference of two held torques, and late by whole samples."""
    own = PostureFamily.of(result(), [Configuration("a", np.array([0.3, 0.5]))], RATE_HZ)
    linear, known = own.models[0].linear, own.models[0].theta
    theta = known.copy()
    theta[list(linear.parameters).index(DELAY)] = delay_s
    A, B, C = _sampled(linear, theta, RATE_HZ)
    whole = round(delay_s * RATE_HZ * 1000)
    fine = _sampled(linear, known, RATE_HZ * 1000)
    n = 12
    u = np.repeat([1.0] + [0.0] * (n - 1), 1000)
    x, y = np.zeros(len(fine[0])), []
    late = np.concatenate([np.zeros(whole), u])[: len(u)]
    for k, torque in enumerate(late):
        if k % 1000 == 0:
            y.append(fine[2][0] @ x)
        x = fine[0] @ x + fine[1][:, 0] * torque
    x, sampled = np.zeros(len(A)), []
    for k in range(n):
        sampled.append(C[0] @ x)
        x = A @ x + B[:, 0] * (k == 0)
    np.testing.assert_allclose(sampled, y, rtol=1e-6, atol=1e-12 * np.abs(y).max())


def test_a_peak_is_traced_to_the_mode_that_makes_it(family: PostureFamily) -> None:
    """Gains near those at which the first mode rings: its frequency, and the spring with most of its energy."""
    cascade = next(design(Scene.of(family.estimate), 9.0, 1))
    state = assess("own", family, family.draws(result(), 10, 1), cascade.gains, cascade.filters(250.0))
    assert any(f"mode at {mode.freq_hz:.3g} Hz, {mode.spring}" in " ".join(state.limited_by)
               for own in family.modes for mode in own)  # fmt: skip
    assert np.all(state.peak_low <= state.peak_high)
