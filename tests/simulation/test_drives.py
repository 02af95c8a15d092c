"""Encoders count; drives clip, lag and ripple."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from plants.two_mass_gear import RATIO, Gear, robot

from elastid.base.arrays import FloatArray
from elastid.friction.dynamic import Bristle, Stop
from elastid.friction.robot_friction import frictions
from elastid.friction.static import Curve
from elastid.friction.stop_operator import Path, bristle, stop
from elastid.model.formulation import formulate
from elastid.robot import Friction, GearRipple, Joint, Robot, TransmissionError
from elastid.robot import Gear as GearSection
from elastid.robot.simplified import with_joints
from elastid.simulation.contacts import contacts
from elastid.simulation.drives import Drives, Lag, gear_forces
from elastid.simulation.dynamics import free_acceleration


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


def stated(gear: Gear, section: GearSection) -> Robot:
    """The plant as a robot's file states it."""

    def changed(joint: Joint) -> Joint:
        assert joint.motor is not None
        assert joint.spring is not None
        motor = replace(joint.motor, coulomb=gear.F_m / RATIO)
        spring = replace(joint.spring, cubic=gear.k_3)
        behind = Friction(gear.F_l) if gear.F_l else None
        return replace(joint, motor=motor, spring=spring, friction=behind, gear=section)

    return with_joints(robot(gear), changed)


def test_accelerations_are_those_of_an_outside_plant() -> None:
    """Transmission error, hardening and friction on both sides, at random states."""
    gear = Gear(F_m=20.0, F_l=12.0, k_3=4e9, error=5e-5)
    model = formulate(stated(gear, GearSection(transmission_error=(TransmissionError(5e-5),))))
    q, v, u = ca.SX.sym("q", 2), ca.SX.sym("v", 2), ca.SX.sym("u")
    sliding = contacts(model, frictions(model.robot))
    force = ca.DM(model.B) @ u - sliding.torque(v, ca.SX(0, 1), ca.SX(sliding.curves)) - gear_forces(model, q, v)
    acceleration = ca.Function("a", [q, v, u], [free_acceleration(model)(q, v, force)])
    place = [model.index("motor 1"), model.index("joint 1")]
    random = np.random.default_rng(3)
    for _ in range(20):
        angle, rate = random.normal(0, 2e-3, 2), random.normal(0, 5e-3, 2)
        torque = float(random.normal(0, 200))
        mine = np.zeros((2, 2))
        mine[0, place], mine[1, place] = angle, rate
        found = np.asarray(acceleration(mine[0], mine[1], torque)).ravel()[place]
        state = np.concatenate([angle, rate, [0.0]])
        expected = gear.slopes(state, torque)[2:4]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_friction_by_load_and_ripple_brake_the_motor_alone() -> None:
    """By the torque that the gear has at that moment, and by the motor's own angle."""
    section = GearSection(load=0.1, ripple=(GearRipple(3.0, 6.0, 0.4),))
    model = formulate(stated(Gear(), section))
    q, v = ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    force = ca.Function("f", [q, v], [gear_forces(model, q, v)])
    motor, link = model.index("motor 1"), model.index("joint 1")
    angle, rate = np.zeros(2), np.zeros(2)
    angle[motor], rate[motor] = 1.5e-3, 0.4
    found = np.asarray(force(angle, rate)).ravel()
    tau = 2e5 * 1.5e-3 + 60.0 * 0.4
    assert found[motor] == pytest.approx(0.1 * tau + 3.0 * np.sin(6 * RATIO * 1.5e-3 + 0.4))
    assert found[link] == 0.0


@pytest.mark.parametrize(("law", "operator"), [(Stop(5e4), stop), (Bristle(5e4), bristle)], ids=["stop", "bristle"])
def test_hysteresis_of_the_rig_is_that_of_the_search(
    law: Stop | Bristle, operator: Callable[[Path, float], FloatArray]
) -> None:
    """Along the same deflection, element by element: torque 5 Nm, bending over 1e-4 rad."""
    x = 3e-4 * np.sin(np.linspace(0, 4 * np.pi, 801))
    z, torque, curve = ca.SX(0.0), [], Curve(ca.SX(5.0), ca.SX(5.0), ca.SX(0.0))
    step = ca.Function("step", [s := ca.SX.sym("z"), w := ca.SX.sym("v")], [law.advanced(w, s, curve, 1.0)])
    for change in np.diff(x):
        z = step(z, change)
        torque.append(5e4 * float(z))
    expected = 5.0 * operator(Path.of(x), 1e-4) / 1e-4
    np.testing.assert_allclose(torque, expected[1:], atol=0.1)
