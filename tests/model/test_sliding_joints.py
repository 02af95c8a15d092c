"""Joints that slide: closed forms of their dynamics, units in a study, elastic translations beside a driven joint."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

FREQ = np.linspace(1, 80, 60)


def slide(**changes: object) -> Robot:
    """A carriage of 40 kg on a screw of 5 mm pitch, a load of 25 kg behind an elastic translation."""
    screw = 2 * np.pi / 0.005  # rad of the motor per m
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, screw, 1e-4), 20.0, motion="translation")
    elastic = Joint("e", (1, 0, 0), Spring(8e5, 100.0), motion="translation")
    bodies = (Body("carriage", joints=(joint,), mass=40), Body("load", "carriage", joints=(elastic,), mass=25))
    return Robot("slide", bodies, **changes)  # type: ignore[arg-type]


def test_a_driven_slide_is_the_chain_of_three_masses_that_it_looks_like():
    """M, D, K by hand: the rotor as ratio^2 J in kg, springs in N/m between positions."""
    model = serial(slide())
    linear = linearise(model, Configuration("c", [0.3]), model.theta, ("motor x",), "acceleration")
    rotor, damper = 2e-3 * (2 * np.pi / 0.005) ** 2, 1e-4 * (2 * np.pi / 0.005) ** 2
    # Of coordinates x (carriage), e (load on the carriage), x_m (motor, along the slide).
    np.testing.assert_allclose(linear.M, [[65, 25, 0], [25, 25, 0], [0, 0, rotor]], rtol=1e-12)
    np.testing.assert_allclose(linear.K, [[5e6, 0, -5e6], [0, 8e5, 0], [-5e6, 0, 5e6]], rtol=1e-12)
    np.testing.assert_allclose(linear.D, [[320, 0, -300], [0, 100, 0], [-300, 0, 300 + damper]], rtol=1e-12)
    high = frequency_response(linear, linear.theta_ref, np.array([1e5]))[0, 0, 0]
    assert high.real == pytest.approx(1 / rotor, rel=1e-4)
    found = {name: unit for name, (_, unit) in slide().parameters().items() if not name.startswith(("I", "c", "m"))}
    assert found == {
        "k_x": "N/m", "d_x": "N*s/m", "f_x": "N*s/m", "Jm_x": "kg*m^2", "fm_x": "N*m*s/rad",
        "k_e": "N/m", "d_e": "N*s/m", "f_e": "N*s/m",
    }  # fmt: skip


def test_a_bead_on_a_turning_rod_feels_coriolis_and_centrifugal_forces():
    """M = diag(m r^2 + I, m), forces 2 m r r' w on the turn and -m r w^2 on the slide."""
    turn = Joint("t", "z", motor=Motor(1e-300))
    rod = Body("rod", joints=(turn,), inertia=0.0)
    bead = Body("bead", "rod", joints=(Joint("r", "x", motion="translation"),), mass=3.0, inertia=0.5)
    model = serial(Robot("rod", (rod, bead), gravity=(0, 0, 0)))
    q, v = np.array([0.4, 0.7]), np.array([2.0, -1.5])
    np.testing.assert_allclose(model.mass(q, model.theta).full(), np.diag([3 * 0.49 + 0.5, 3]), atol=1e-12)
    force = [2 * 3 * 0.7 * -1.5 * 2.0, -3 * 0.7 * 4.0]
    np.testing.assert_allclose(model.force(q, v, model.theta).full()[:, 0], force, rtol=1e-12)


def arm(further: tuple[Joint, ...], base: tuple[Joint, ...] = ()) -> Robot:
    """One driven axis; further elastic joints behind it, elasticity of the base before it."""
    driven = Joint("1", "z", Spring(2e5, 120), Motor(5e-3, 100, 2e-3))
    fore = Joint("2", "y", Spring(6e4, 50), Motor(3e-3, 80, 2e-3))
    foot = Body("foot", joints=base, mass=30, inertia=(1, 1, 1)) if base else Body("foot")
    return Robot(
        "arm",
        (
            foot,
            Body("upper", "foot", joints=(driven, *further), mass=60, center_of_mass=(0.1, 0, 0.2), inertia=(3, 3, 4)),
            Body("fore", "upper", Placement((0.3, 0, 0.5)), (fore,), 25, (0.4, 0.02, 0.05), (0.4, 2, 2)),
        ),
    )


def elastic(k: float, turning: str) -> tuple[Joint, ...]:
    """Elastic along every axis and about some, stiffness k."""
    turns = tuple(Joint(f"r{axis}", axis, Spring(k)) for axis in turning)
    return (*turns, *(Joint(f"t{axis}", axis, Spring(10 * k), motion="translation") for axis in "xyz"))


def response(robot: Robot) -> np.ndarray:
    """Motor accelerations per torque."""
    model = serial(robot)
    linear = linearise(model, Configuration("c", [0.3, -0.6]), model.theta, model.inputs, "acceleration")
    return frequency_response(linear, linear.theta_ref, FREQ)


@pytest.mark.parametrize("where", ["joint", "base"])
def test_stiffer_and_stiffer_elastic_joints_become_the_flexible_joint_model(where):
    """K_na -> inf: the difference falls as 1 / K_na, for rotations and translations, at a joint and at the base."""
    rigid = response(arm(()))
    errors = []
    for k in (1e8, 1e9, 1e10):
        robot = arm(elastic(k, "xy")) if where == "joint" else arm((), elastic(k, "xyz"))
        errors.append(np.abs(response(robot) - rigid).max() / np.abs(rigid).max())
    assert errors[0] > errors[1] > errors[2]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 10, rtol=0.2)
    assert errors[2] < 1e-3
