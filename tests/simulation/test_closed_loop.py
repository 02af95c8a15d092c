"""The simulated robot obeys its equations, the integrator its order, the controller its bandwidth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.base.errors import DataError
from elastid.friction.robot_friction import PlacedLaw
from elastid.friction.static import SLIDING_VELOCITY, Tustin, coulomb
from elastid.linear.equilibrium import equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.robot import Body, Friction, Joint, Motor, Placement, Robot, Spring
from elastid.simulation.closed_loop import CHUNK_SAMPLES, ClosedLoop, Commands, closed_loop, simulate
from elastid.simulation.controller import Gains, feed_forward, rigid_motion, tune
from elastid.simulation.drives import Drives
from elastid.simulation.dynamics import acceleration, fastest_rate, runge_kutta
from elastid.simulation.friction_states import Contacts, contacts

FREE = np.array([[-np.inf, np.inf]] * 2)
LENGTH, MASS, OFFSET = 0.8, (30.0, 20.0), (0.4, 0.35)
STIFFNESS, NO_FRICTION = (4e4, 2e4), np.zeros(2)


def arm(damping: float = 0.0, gravity: float = -9.81) -> Robot:
    """Two links in a vertical plane, both joints elastic: modes at about 5 and 17 Hz."""
    joints = [Joint(str(i + 1), "y", Spring(STIFFNESS[i], damping), Motor(2e-3, 80.0)) for i in range(2)]
    return Robot(
        "arm",
        (
            Body("upper", joints=(joints[0],), mass=MASS[0], center_of_mass=(OFFSET[0], 0, 0), inertia=1.5),
            Body("fore", "upper", Placement((LENGTH, 0, 0)), (joints[1],), MASS[1], (OFFSET[1], 0, 0), 1.0),
        ),
        gravity=(0.0, 0.0, gravity),
    )


def motor(inertia: float = 2e-3) -> Robot:
    """A single motor on a weightless gear, 20 kg m^2 on the link side, and nothing else."""
    return Robot("motor", (Body("rotor", joints=(Joint("1", "z", motor=Motor(inertia, 100.0)),), mass=1.0),))


def energy(model: ElasticModel, q: np.ndarray, v: np.ndarray) -> float:
    """Kinetic, gravitational and elastic energy of the arm, heights and deflections written out."""
    a1, a2 = q[0], q[0] + q[1]
    heights = -OFFSET[0] * math.sin(a1), -LENGTH * math.sin(a1) - OFFSET[1] * math.sin(a2)
    gravitational = 9.81 * sum(m * h for m, h in zip(MASS, heights, strict=True))
    elastic = sum(k * (q[2 + i] - q[i]) ** 2 / 2 for i, k in enumerate(STIFFNESS))
    return float(v @ model.mass(q, model.theta).full() @ v / 2 + gravitational + elastic)


def path(model: ElasticModel, step: float, duration: float, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """States (n, 2 n_q) at the ends of n equal parts of `duration` s, with torque (n, n_u) held in each."""
    advance = runge_kutta(acceleration(model, NO_FRICTION), step, round(duration / len(torque) / step))
    states = []
    for u in torque:
        state = np.concatenate([part.full()[:, 0] for part in advance(*np.split(state, 2), u)])
        states.append(state)
    return np.array(states)


def quiet(model: ElasticModel, q0: np.ndarray, n: int, torque: np.ndarray | None = None) -> Commands:
    """Stay where you are: reference and holding torque of q0, n samples, `torque` added."""
    z = np.zeros((n, model.n_u))
    held = feed_forward(model, q0, z[:1], z[:1], z[:1])
    return Commands(z + model.B.T @ q0, z, z + held + (0 if torque is None else torque), z, z)


def rough(model: ElasticModel, level: float) -> Contacts:
    """Coulomb friction of so many Nm, link side, at every motor."""
    return contacts(model, [PlacedLaw(place, Tustin(), Friction(level), 1.0) for place in model.inputs if level])


def loop(model: ElasticModel, coulomb: float = 0.0, count: float = 0.0) -> ClosedLoop:
    """Closed at 1 kHz with two steps a sample, motors free to go anywhere."""
    n_u = model.n_u
    drives = Drives(np.full(n_u, count), np.full(n_u, np.inf))
    return closed_loop(model, rough(model, coulomb), FREE[:n_u], 1000.0, 2, drives)


@given(st.lists(st.floats(-1, 1), min_size=10, max_size=10))
@settings(deadline=None, max_examples=25)
def test_accelerations_solve_the_equations_of_motion(numbers: list[float]) -> None:
    """M q'' + f + B tau_f = B u, with M factorised in symbols, equals NumPy's pivoted solve."""
    model, F_c = serial(arm(damping=20.0)), np.array([5.0, 3.0])
    q, v, u = np.split(np.array(numbers), [4, 8])
    torque = model.B @ (u - coulomb(model.B.T @ v, F_c)) - model.force(q, v, model.theta).full()[:, 0]
    expected = np.linalg.solve(model.mass(q, model.theta).full(), torque)
    np.testing.assert_allclose(acceleration(model, F_c)(q, v, u).full()[:, 0], expected, rtol=1e-9, atol=1e-9)


def test_the_integrator_is_of_fourth_order_under_held_torque() -> None:
    """Halving the step divides the error by 16, torque jumping from sample to sample."""
    model = serial(arm(damping=20.0))
    start = np.concatenate([[0.3, -0.4, 0.3, -0.4], np.zeros(4)])
    torque = np.random.default_rng(1).normal(0, 200, (25, 2))
    paths = [path(model, step, 0.2, start, torque) for step in (2e-3, 1e-3, 5e-4, 6.25e-5)]
    errors = [np.linalg.norm(states - paths[-1]) for states in paths[:-1]]
    np.testing.assert_allclose(np.log2([errors[0] / errors[1], errors[1] / errors[2]]), 4.0, atol=0.05)


def test_energy_is_conserved_at_the_rate_of_the_order() -> None:
    """Undamped and unforced, the energy drifts by less than 1e-6 of what moves, 16 times less with half the step."""
    model = serial(arm())
    start = np.concatenate([[0.3, -0.4, 0.31, -0.39], [1.0, -2.0, 1.0, -2.0]])
    before, at_rest = energy(model, *np.split(start, 2)), np.zeros((4, 2))
    ends = [path(model, step, 0.4, start, at_rest)[-1] for step in (2e-3, 1e-3)]
    drift = [abs(energy(model, *np.split(end, 2)) - before) for end in ends]
    moving = start[4:] @ model.mass(start[:4], model.theta).full() @ start[4:] / 2
    assert drift[1] < 1e-6 * moving
    assert np.log2(drift[0] / drift[1]) > 3.65


def test_a_mode_gets_the_frequency_and_damping_error_that_the_docstring_states() -> None:
    """(omega h)^4 / 120 slower and (omega h)^5 / 144 more damped, read off the poles of the step."""
    robot, step = arm(gravity=0.0), 4e-3
    model = serial(replace(robot, bodies=robot.bodies[:1]))
    advance = runge_kutta(acceleration(model, np.zeros(1)), step, 1)
    columns = [np.concatenate([r.full()[:, 0] for r in advance(e[:2], e[2:], 0)]) for e in 1e-6 * np.eye(4)]
    poles = np.log(np.linalg.eigvals(np.array(columns).T / 1e-6).astype(complex)) / step
    pole = poles[np.argmax(poles.imag)]
    omega = fastest_rate(model, rough(model, 0.0), np.zeros(2))
    y = omega * step
    np.testing.assert_allclose(1 - pole.imag / omega, y**4 / 120, rtol=0.1)
    np.testing.assert_allclose(-pole.real / omega, y**5 / 144, rtol=0.1)


def test_the_fastest_rate_is_friction_at_standstill_or_the_stiffest_mode() -> None:
    """F_c / (v_s J) for a motor with friction; sqrt(k (1/J_m + 1/J)) for an elastic joint."""
    model = serial(motor())
    np.testing.assert_allclose(fastest_rate(model, rough(model, 10.0), np.zeros(1)), 10 / (SLIDING_VELOCITY * 20))
    robot = arm(gravity=0.0)
    single = serial(replace(robot, bodies=robot.bodies[:1]))
    J, J_m = 1.5 + MASS[0] * OFFSET[0] ** 2, 2e-3 * 80**2
    expected = math.sqrt(STIFFNESS[0] * (1 / J + 1 / J_m))
    np.testing.assert_allclose(fastest_rate(single, rough(single, 0.0), np.zeros(2)), expected)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_friction_brakes_a_motor_in_both_directions_and_then_holds_it(direction: float) -> None:
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


def test_gravity_is_held_from_the_start() -> None:
    """Started in its equilibrium with its holding torque the arm does not move, second after second."""
    model = serial(arm(damping=20.0))
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    commands = quiet(model, point.q, 2500)
    np.testing.assert_allclose(commands.torque[0], point.u, rtol=1e-9)
    run = simulate(loop(model), tune(model, point.q, 1.5, 0.8), commands, point.q)
    np.testing.assert_allclose(run.q, np.tile(point.q, (2500, 1)), atol=1e-10)


def test_the_loop_is_that_of_a_plain_python_loop() -> None:
    """Sample by sample with the controller written out, across the border of two chunks."""
    model, n = serial(arm(damping=20.0)), CHUNK_SAMPLES + 50
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    random = np.random.default_rng(2)
    torque, disturbance, noise = random.normal(0, [50, 5, 1e-5], (n, 2, 3)).transpose(2, 0, 1)
    commands = replace(quiet(model, point.q, n, torque), disturbance=disturbance, reading_noise=noise)
    gains = tune(model, point.q, 1.5, 0.8)
    run = simulate(loop(model, coulomb=4.0, count=2e-6), gains, commands, point.q)

    advance = runge_kutta(acceleration(model, np.full(2, 4.0)), 5e-4, 2)
    q, v, last = point.q, np.zeros(4), point.q[2:]
    for k in range(n):
        reading = 2e-6 * np.round((q[2:] + noise[k]) / 2e-6)
        u = commands.torque[k] + gains.kp * (point.q[2:] - reading) - gains.kd * (reading - last) * 1000
        np.testing.assert_allclose(run.q[k], q, atol=1e-9)
        np.testing.assert_allclose(run.u[k], u, atol=1e-3)
        q, v = (part.full()[:, 0] for part in advance(q, v, u + disturbance[k]))
        last = reading


def test_encoders_count() -> None:
    """Readings are whole counts, at most half a count from the angle."""
    model, count, q0 = serial(arm(damping=20.0)), 3e-5, np.zeros(4)
    torque = 80 * np.sin(np.arange(400) / 10)[:, None] * [1, -1]
    run = simulate(loop(model, count=count), tune(model, q0, 3.0, 0.8), quiet(model, q0, 400, torque), q0)
    counts = run.reading / count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(run.reading - run.q[:, 2:]).max() <= count / 2 * (1 + 1e-9)
    assert len(np.unique(np.round(counts))) > 10


def test_the_controller_has_its_bandwidth_and_damping() -> None:
    """A step of the reference overshoots by exp(-pi zeta / sqrt(1 - zeta^2)), after half a damped period."""
    model, zeta, bandwidth = serial(motor()), 0.5, 1.5
    gains = tune(model, np.zeros(1), bandwidth, zeta)
    z = np.zeros((1500, 1))
    run = simulate(loop(model), gains, Commands(z + 0.1, z, z, z, z), np.zeros(1))
    damped = math.sqrt(1 - zeta**2)
    np.testing.assert_allclose(run.q.max() / 0.1 - 1, math.exp(-math.pi * zeta / damped), rtol=0.03)
    np.testing.assert_allclose(run.q.argmax() / 1000, 1 / (2 * bandwidth * damped), rtol=0.01)


def test_feed_forward_is_the_rigid_robots_inverse_dynamics() -> None:
    """Accelerating both motors from rest needs T^T M T q_a'' beyond the holding torque, springs out of it."""
    model = serial(arm(damping=20.0))
    point = equilibrium(model, model.theta, Configuration("c", np.array([0.3, -0.8])))
    T, z, a = rigid_motion(model, point.q), np.zeros((1, 2)), np.array([[2.0, -1.0]])
    inertia = T.T @ model.mass(point.q, model.theta).full() @ T
    np.testing.assert_allclose(feed_forward(model, point.q, z, z, a)[0], point.u + inertia @ a[0], rtol=1e-9)
    turned = equilibrium(model, model.theta, Configuration("d", np.array([0.5, -0.7])))
    there = feed_forward(model, point.q, np.array([[0.2, 0.1]]), z, z)[0]
    np.testing.assert_allclose(there, turned.u, rtol=2e-3)


def test_a_lost_motor_is_named_with_the_time() -> None:
    """Gains that make the sampled loop unstable end in words, not in NaN."""
    model = serial(arm(damping=20.0))
    commands = quiet(model, np.zeros(4), 3000, np.ones((3000, 2)))
    with pytest.raises(DataError, match=r"motor [12] is lost 0\.\d+ s after the start"):
        simulate(loop(model), tune(model, np.zeros(4), 400.0, 0.8), commands, np.zeros(4))
    limited = replace(loop(model), limits=np.array([[-0.01, 0.01], [-9, 9]]))
    with pytest.raises(DataError, match=r"motor 1 is lost .* within \[-0.01, 0.01\] rad"):
        simulate(limited, Gains(np.zeros(2), np.zeros(2)), commands, np.zeros(4))
