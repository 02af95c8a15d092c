"""Accelerations obey the equations of motion, the integrator its order."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.integration import acceleration, energy, runge_kutta
from plants.two_links import arm, motor

from elastid.friction.static import SLIDING_VELOCITY
from elastid.model.formulation import serial
from elastid.simulation.runge_kutta import CLASSICAL, FIFTH_ORDER, MAX_STEP_RATE, least_steps


@given(st.lists(st.floats(-1, 1), min_size=10, max_size=10))
@settings(deadline=None, max_examples=25)
def test_accelerations_solve_the_equations_of_motion(numbers: list[float]) -> None:
    """M q'' + f + B tau_f = B u, with M factorised in symbols, equals NumPy's pivoted solve."""
    model, F_c = serial(arm(damping=20.0)), np.array([5.0, 3.0])
    q, v, u = np.split(np.array(numbers), [4, 8])
    torque = (
        model.B @ (u - F_c * np.tanh(model.B.T @ v / SLIDING_VELOCITY)) - model.force(q, v, model.theta).full()[:, 0]
    )
    expected = np.linalg.solve(model.mass(q, model.theta).full(), torque)
    np.testing.assert_allclose(acceleration(model, F_c)(q, v, u).full()[:, 0], expected, rtol=1e-9, atol=1e-9)


@given(angle=st.floats(0.5 * np.pi, np.pi), rate=st.floats(1.0, 200.0), duration=st.floats(0.01, 0.5))
def test_steps_are_as_few_as_let_no_mode_grow(angle: float, rate: float, duration: float) -> None:
    """R(z) is exp(z) to its order; with one step less a mode grows of its own, or a step is too long."""
    pole = np.array([rate * np.exp(1j * angle)])
    for method, order in ((CLASSICAL, 4), (FIFTH_ORDER, 5)):
        z = 0.2 * pole / rate
        assert np.abs(method.amplification(z) - np.exp(z)) < 0.2 ** (order + 1) / math.factorial(order)

    def grows(n: int) -> bool:
        z = pole * duration / n
        return bool(np.abs(FIFTH_ORDER.amplification(z)) > 1 + 1e-9 or np.abs(z) > MAX_STEP_RATE)

    n = least_steps(pole, duration)
    assert not grows(n)
    assert n == 1 or grows(n - 1)


def test_energy_is_conserved_at_the_rate_of_the_order() -> None:
    """Undamped and unforced, the energy drifts by less than 1e-6 of what moves, 16 times less with half the step."""
    model = serial(arm())
    q, v, free = np.array([0.3, -0.4, 0.31, -0.39]), np.array([1.0, -2.0, 1.0, -2.0]), acceleration(model, np.zeros(2))
    ends = [runge_kutta(free, step, round(0.4 / step))(q, v, np.zeros(2)) for step in (2e-3, 1e-3)]
    states = np.array([(q, v), *(np.concatenate([part.full().T for part in end]) for end in ends)])
    E = energy(model, states[:, 0], states[:, 1])
    drift, moving = np.abs(E[1:] - E[0]), v @ model.mass(q, model.theta).full() @ v / 2
    assert drift[1] < 1e-6 * moving
    assert np.log2(drift[0] / drift[1]) > 3.65


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_friction_brakes_motor_and_sticks(direction: float) -> None:
    """J v' = -F_c sgn(v): the speed falls along a straight line to zero and stays there."""
    model, F_c, J = serial(motor()), np.array([10.0]), 20.0
    advance = runge_kutta(acceleration(model, F_c), 5e-4, 200)
    q, v = np.zeros(1), np.array([direction * 0.5])
    speeds = []
    for _ in range(15):
        q, v = (part.full()[:, 0] for part in advance(q, v, 0.0))
        speeds.append(v[0])
    line = np.maximum(0.5 - F_c[0] / J * 0.1 * np.arange(1, 16), 0)
    np.testing.assert_allclose(speeds, direction * line, atol=2 * SLIDING_VELOCITY)
