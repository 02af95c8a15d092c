"""The controller has its bandwidth, its feed-forward the inverse dynamics of the rigid robot."""

import math

import numpy as np
import pytest
from plants.arm import resting
from plants.two_links import FREE, arm, loop, motor, quiet, rough
from scipy import signal

from elastid.model.formulation import serial
from elastid.record import unit_delay
from elastid.simulation.closed_loop import Commands, closed_loop, simulate
from elastid.simulation.controller import (
    Filters,
    feed_forward,
    filters_of,
    gains_of,
    low_pass,
    notch,
    rigid_motion,
    tune,
)
from elastid.simulation.drives import Drives
from elastid.simulation.spec import ControllerSpec, GainsSpec, NotchSpec


def test_the_controller_has_its_bandwidth_and_damping() -> None:
    """A step of the reference overshoots by exp(-pi zeta / sqrt(1 - zeta^2)), after half a damped period."""
    model, zeta, bandwidth = serial(motor()), 0.5, 1.5
    gains = tune(model, np.zeros(1), bandwidth, zeta)
    z = np.zeros((1500, 1))
    run = simulate(loop(model), gains, Commands(z + 0.1, z, z, z, z), np.zeros(1))
    damped = math.sqrt(1 - zeta**2)
    np.testing.assert_allclose(run.q.max() / 0.1 - 1, math.exp(-math.pi * zeta / damped), rtol=0.03)
    np.testing.assert_allclose(run.q.argmax() / 1000, 1 / (2 * bandwidth * damped), rtol=0.01)


def test_gains_of_a_cascade_are_those_of_its_loops() -> None:
    """Position and velocity gain and integral time, one for both joints or one for each."""
    given = GainsSpec(position_gain=4.0, velocity_gain=(50.0, 20.0), integral_time=(0.5, 0.25))
    gains = gains_of(serial(arm()), np.zeros(2), ControllerSpec(kind="cascade", gains=given))
    np.testing.assert_array_equal([gains.kp, gains.kd, gains.ki], [[200.0, 80.0], [50.0, 20.0], [2.0, 4.0]])


def test_feed_forward_is_the_rigid_robots_inverse_dynamics() -> None:
    """Accelerating both motors from rest needs T^T M T q_a'' beyond the holding torque, springs out of it."""
    model = serial(arm(damping=20.0))
    point = resting(model, 0.3, -0.8)
    T, z, a = rigid_motion(model, point.q), np.zeros((1, 2)), np.array([[2.0, -1.0]])
    inertia = T.T @ model.mass(point.q, model.theta).full() @ T
    np.testing.assert_allclose(feed_forward(model, point.q, z, z, a)[0], point.u + inertia @ a[0], rtol=1e-9)
    turned = resting(model, 0.5, -0.7)
    there = feed_forward(model, point.q, np.array([[0.2, 0.1]]), z, z)[0]
    np.testing.assert_allclose(there, turned.u, rtol=2e-3)


RATE_HZ = 1000.0
SPEC = ControllerSpec(
    kind="cascade", delay_samples=1,
    gains=GainsSpec((12.0, 20.0), (900.0, 300.0), 0.1, (NotchSpec("2", 17.0, 0.8, 0.2),), (150.0, 200.0)),
)  # fmt: skip


def test_a_low_pass_is_that_of_scipy() -> None:
    """Butterworth's, by Tustin's rule."""
    np.testing.assert_allclose(low_pass(60.0, 500.0), signal.butter(2, 60.0, fs=500.0, output="sos")[0], rtol=1e-12)


def test_a_notch_leaves_its_depth_at_its_frequency() -> None:
    """And nothing at rest and at half the rate; its width is that between -3 dB points where its depth is 0."""
    filters = Filters(((notch(40.0, 0.5, 0.1, 500.0),),))
    H = np.abs(filters.response(unit_delay(np.array([1e-6, 40.0, 250.0]), 500.0))[:, 0])
    np.testing.assert_allclose(H, [1, 0.1, 1], atol=1e-9)
    narrow = Filters(((notch(5.0, 0.1, 0.0, 5000.0),),))
    ends = 5.0 * (np.array([-0.05, 0.05]) + np.sqrt(1 + 0.05**2))
    np.testing.assert_allclose(np.abs(narrow.response(unit_delay(ends, 5000.0))[:, 0]), np.sqrt(0.5), rtol=1e-4)


def test_states_have_the_response() -> None:
    """C (z - A)^-1 B + D, of a motor without filters, too."""
    filters = filters_of(("1", "2"), SPEC, RATE_HZ)
    A, B, C, D = filters.matrices
    freq_hz = np.array([3.0, 17.0, 120.0])
    H = np.stack([C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D for z in np.exp(2j * np.pi * freq_hz / RATE_HZ)])
    np.testing.assert_allclose(np.einsum("fii->fi", H), filters.response(unit_delay(freq_hz, RATE_HZ)), rtol=1e-9)
    assert np.abs(H[:, 0, 1]).max() == 0
    alone = Filters(((), ()), 0).matrices
    assert [part.shape for part in alone] == [(0, 0), (0, 2), (2, 0), (2, 2)]


def test_the_simulated_loop_filters_and_delays_its_feedback() -> None:
    """As SciPy filters the same errors, a sample later, sample by sample; what is injected passes at once."""
    model, n = serial(arm(damping=20.0)), 300
    point = resting(model, 0.3, -0.8)
    injected = np.random.default_rng(2).normal(0, 30, (n, 2))
    commands = quiet(model, point.q, n, injected)
    filters, gains = filters_of(("1", "2"), SPEC, RATE_HZ), gains_of(model, point.q, SPEC)
    loop = closed_loop(model, rough(model, 0.0), FREE[:2], RATE_HZ, 2, Drives(np.zeros(2), np.full(2, np.inf)),
                       filters=filters)  # fmt: skip
    run = simulate(loop, gains, commands, point.q)
    angle = run.reading - model.B.T @ point.q
    speed = np.diff(angle, axis=0, prepend=np.zeros((1, 2))) * RATE_HZ
    error = -gains.kp * angle - gains.kd * speed
    total = np.vstack([np.zeros((1, 2)), np.cumsum(error, axis=0)[:-1]]) / RATE_HZ
    feedback = error + gains.ki * total
    for axis in range(2):
        filtered = signal.sosfilt(np.array(filters.sections[axis]), feedback[:, axis])
        late = np.concatenate([[0.0], filtered[:-1]])
        np.testing.assert_allclose(run.u[:, axis] - commands.torque[:, axis], late, atol=1e-6)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"kind": "pd", "gains": GainsSpec(1.0, 1.0)}, "gains belong to kind: cascade"),
        ({"kind": "cascade", "integral_time": 0.4, "gains": GainsSpec(1.0, 1.0)}, "one of gains"),
        ({"delay_samples": 21}, "at most 20"),
    ],
)
def test_contradictions_are_refused(words: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        ControllerSpec(**words)
