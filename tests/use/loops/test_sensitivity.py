"""Sensitivity, poles and bandwidths of sampled loops against python-control and closed forms."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants.arm import RATIO, closed_form, result
from plants.fitted_models import DELAY as FITTED_DELAY_S
from plants.fitted_models import fitted_model

from elastid.parameters import DELAY
from elastid.record import Configuration
from elastid.use.cascade import Cascade
from elastid.use.closed_loops import Scene, bandwidths, closed_loop_matrices, scaled
from elastid.use.draws import draw_robots
from elastid.use.gain_design import design
from elastid.use.loops import assess
from elastid.use.plants import Plants, PostureFamily, _sampled
from elastid.use.posture_values import largest_gain

RATE_HZ = 400.0
CASCADE = Cascade(
    np.array([8.0, 12.0]), np.array([700.0, 300.0]), np.array([120.0, 90.0]), 1, np.array([[18.0, 0.8, 0.3]]), (1,)
)  # fmt: skip


def plants() -> Plants:
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
    for i, A in enumerate(closed_loop_matrices(own, CASCADE.gains, CASCADE.filters(RATE_HZ))):
        plant = control.ss(own.A[i], own.B[i], own.C[i], np.zeros((2, 2)), 1 / RATE_HZ)
        closed = control.feedback(control.ss([], [], [], np.eye(2), plant.dt), controller(CASCADE) * plant)
        np.testing.assert_allclose(closed(np.exp(2j * np.pi * freq_hz / RATE_HZ)).transpose(2, 0, 1), S[i], rtol=1e-6)
        assert np.abs(np.linalg.eigvals(A)).max() == pytest.approx(np.abs(closed.poles()).max())


@given(K_p=st.floats(1.0, 20.0))
def test_an_ideal_cascade_has_the_bandwidth_of_its_position_gain(K_p: float) -> None:
    """|E| of s / (s + K_p) rises to -3 dB at K_p / 2 pi, between two lines, or beyond the ends of the grid."""
    freq_hz = np.geomspace(0.05, 50, 40)[None]
    s = 2j * np.pi * freq_hz[..., None]
    E = s / (s + K_p * np.array([1.0, 1e-3, 1e4]))
    np.testing.assert_allclose(bandwidths(E, freq_hz)[0], [K_p / (2 * np.pi), 0.05, 50.0], rtol=0.01)


def test_axis_inertia_includes_motor_and_carried_bodies() -> None:
    """Of the arm at rest, in closed form."""
    for inertia, posture in zip(plants().inertia, ([0.3, 0.5], [0.5, -1.2]), strict=True):
        np.testing.assert_allclose(inertia, np.diag(closed_form(np.array(posture))[0]) + 2e-3 * RATIO**2, rtol=1e-6)


def test_scaled_peak_bounds_axes_in_any_units() -> None:
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
def test_fitted_delay_is_part_of_sampled_plant(delay_s: float) -> None:
    """Of half a sample and of more than two: a step of torque moves the motor as much later."""
    own = PostureFamily.of(result(), [Configuration("a", np.array([0.3, 0.5]))], RATE_HZ)
    linear, known = own.models[0].linear, own.models[0].theta
    theta = np.where(np.array(linear.parameters) == DELAY, delay_s, known)
    answers = []
    for numbers, rate_hz in ((theta, RATE_HZ), (known, 25 * RATE_HZ)):
        A, B, C = _sampled(linear, numbers, rate_hz)
        x, y = np.zeros(len(A)), []
        for _ in range(300):
            y.append(C[0] @ x)
            x = A @ x + B[:, 0]
        answers.append(np.array(y))
    sampled, prompt = answers[0][:12], answers[1]
    times = 25 * np.arange(12) - round(25 * RATE_HZ * delay_s)
    np.testing.assert_allclose(sampled, prompt[np.maximum(times, 0)], rtol=1e-6, atol=1e-12 * prompt.max())


def test_delays_around_a_sample_give_plants_of_equal_size() -> None:
    """The delay of the fit is one sample: draws need one, or a part of another; each responds as it does alone."""
    fitted = fitted_model("scara")
    own, rate_hz = replace(fitted.result, robot=fitted.model.robot), 1 / FITTED_DELAY_S
    postures = [Configuration("a", np.array([joint.start for joint in own.robot.driven]))]
    family, freq_hz = PostureFamily.of(own, postures, rate_hz), np.geomspace(2.0, 900.0, 20)[None]
    drawn, states = family.draws(own, 6, 1), set()
    for i, x in enumerate(draw_robots(own, 6, 1).x):
        linear, estimated = family.models[0].linear, family.models[0].estimated
        A, B, C = (part[None] for part in _sampled(linear, estimated.theta(x), rate_hz))
        alone, among = Plants(rate_hz, A, B, C, drawn.inertia[:1]), slice(i, i + 1)
        states.add(A.shape[-1])
        each = Plants(rate_hz, drawn.A[among], drawn.B[among], drawn.C[among], drawn.inertia[among])
        np.testing.assert_allclose(each.response(freq_hz), alone.response(freq_hz), rtol=1e-9, atol=1e-15)
    assert len(states) > 1


def test_a_peak_is_traced_to_the_mode_that_makes_it(family: PostureFamily) -> None:
    """Gains near those at which the first mode rings: its frequency, and the spring with most of its energy."""
    cascade = next(design(Scene.of(family.estimate), 9.0, 1))
    state = assess("own", family, family.draws(result(), 10, 1), cascade.gains, cascade.filters(250.0))
    assert any(f"mode at {mode.freq_hz:.3g} Hz, {mode.spring}" in " ".join(state.limited_by)
               for own in family.modes for mode in own)  # fmt: skip
    assert np.all(state.peak_low <= state.peak_high)
